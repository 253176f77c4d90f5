"""What the tests of the studies have in common."""

import pytest
import study_lines


@pytest.fixture
def in_this_process(monkeypatch):
    """Cases are computed in this process, where a test can replace functions; also the function that does it."""

    def computed(function, cases, scheduler=None, workers=None):
        return map(function, cases)

    monkeypatch.setattr(study_lines, "computed", computed)
    return computed
