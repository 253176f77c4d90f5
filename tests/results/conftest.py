"""The result of the shipped flight, in memory and in a folder."""

import pytest

from edl_filter.results import Result
from edl_filter.workflow.run import write_outputs


@pytest.fixture(scope="session")
def tree(practice_06):
    """Result of the shipped flight."""
    return Result(practice_06).to_xarray()


@pytest.fixture(scope="session")
def written(practice_06, tmp_path_factory):
    """Files of the shipped flight's result, and the content of its summary."""
    return write_outputs(Result(practice_06), tmp_path_factory.mktemp("run"), figures=False)
