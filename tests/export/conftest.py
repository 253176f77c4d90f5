"""Results that the tests of this folder export."""

import pytest

from edl_filter.results import Result
from edl_filter.workflow.run import write_outputs


@pytest.fixture(scope="session")
def result(spirit, tmp_path_factory):
    """``result.nc`` of Spirit."""
    return write_outputs(Result(spirit), tmp_path_factory.mktemp("spirit"), figures=False)["result"]


@pytest.fixture(scope="session")
def practice_result(practice_06, tmp_path_factory):
    """``result.nc`` of the shipped flight, which has neither a clock nor an orientation in J2000."""
    return write_outputs(Result(practice_06), tmp_path_factory.mktemp("practice"), figures=False)["result"]
