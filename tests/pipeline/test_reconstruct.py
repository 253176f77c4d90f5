"""Reconstructions of the shipped practice flight with either filter."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.ekf import ErrorStateEKF
from edl_filter.navigation.filter import new_filter
from edl_filter.pipeline.reconstruct import reconstruct


@pytest.fixture(scope="module")
def extended():
    """The practice flight as ``--set filter.method=ekf`` reconstructs it."""
    return reconstruct(Mission.load(shipped_mission("practice_mer"), ["filter.method=ekf"]))


def test_the_mission_chooses_the_filter(practice_06, extended):
    for reconstruction, filter_class in ((practice_06, CompiledUKF), (extended, ErrorStateEKF)):
        node = reconstruction.filter_pass.nodes[0]
        assert isinstance(new_filter(reconstruction.problem, node.state, node.covariance), filter_class)


def test_another_filter_is_refused():
    with pytest.raises(InputError, match=r"filter\.method: found .*enkf.*ukf.*ekf"):
        Mission.load(shipped_mission("practice_mer"), ["filter.method=enkf"])


def test_another_engine_is_refused():
    with pytest.raises(InputError, match=r"filter\.engine: found .*fast.*compiled.*filterpy"):
        Mission.load(shipped_mission("practice_mer"), ["filter.engine=fast"])
    assert Mission.load(shipped_mission("practice_mer"), ["filter.engine=filterpy"]).filter.engine == "filterpy"


def test_the_ekf_agrees_with_the_ukf(practice_06, extended):
    """All smoothed states to 0.05 of their sigmas, and the sigmas to 1e-3: the flight is nearly linear."""
    assert len(extended.smoothed.states) == len(practice_06.smoothed.states)
    for k, (state, twin) in enumerate(zip(extended.smoothed.states, practice_06.smoothed.states, strict=True)):
        sigma = np.sqrt(np.diag(practice_06.smoothed.covariance[k]))
        assert np.max(np.abs(state.minus(twin)) / sigma) < 0.05
        np.testing.assert_allclose(np.sqrt(np.diag(extended.smoothed.covariance[k])), sigma, rtol=1e-3)


def test_all_constraints_are_consistent_with_the_ekf(practice_06, extended):
    for check, twin in zip(extended.constraint_checks, practice_06.constraint_checks, strict=True):
        assert check.name == twin.name
        assert check.consistent and np.all(check.accepted), check.name
        assert check.left_out_sigmas == pytest.approx(twin.left_out_sigmas, abs=0.05)
