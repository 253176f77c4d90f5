"""A linearised model that tests of several files use."""

import pytest
from late_torque import late_model_of


@pytest.fixture(scope="session")
def late_model(tmp_path_factory):
    return late_model_of(tmp_path_factory.mktemp("times"))
