"""Every file that this program reads, mutated: read, or refused with a sentence; never a crash, a hang or much memory.

`make fuzz` runs the same targets for longer, guided by coverage.
"""

import pytest
import targets
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

CHANGE = st.tuples(
    st.integers(0, 5), st.floats(0.0, 1.0, exclude_max=True), st.floats(0.0, 1.0), st.integers(0, 1 << 16)
)
#: Readers that need longer for each file.
SLOW = {"mission": 12, "log specification": 12, "log": 15}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def seeds(folder):
    return targets.seeds(folder)


@pytest.mark.parametrize("kind", [k for k in targets.READERS if k not in ("summary", "compact")])
def test_the_seed_of_the_mutations_is_valid(kind, seeds, folder):
    assert targets.read(kind, seeds[kind], folder) == "read"


@pytest.mark.parametrize("kind", targets.READERS)
def test_a_mutated_file_is_read_or_refused_with_a_sentence(kind, seeds, folder):
    @settings(max_examples=SLOW.get(kind, 40), suppress_health_check=list(HealthCheck), database=None)
    @given(st.lists(CHANGE, min_size=1, max_size=4))
    def check(changes):
        targets.read(kind, targets.mutated(seeds[kind], changes), folder)

    check()
