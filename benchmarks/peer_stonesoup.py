"""The problem of `peer_problem` through Stone Soup's unscented filter, all sigma points in one numpy call."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta

import numpy as np
from peer_problem import ALPHA, BETA, FIX_SIGMA, KAPPA, SIGMAS, PeerProblem, transition
from stonesoup.base import Property
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import UnscentedKalmanPredictor
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import UnscentedKalmanUpdater

from edl_filter.types import Array


class Strapdown(TransitionModel):
    """One sample; `predict` is told which by ``epoch``."""

    inputs: Array = Property()
    process_noise: Array = Property()

    @property
    def ndim_state(self):
        return 15

    def function(self, state, noise=False, epoch=0, **kwargs):
        return StateVectors(transition(np, np.asarray(state.state_vector, float), self.inputs[epoch]))

    def covar(self, epoch=0, **kwargs):
        return self.process_noise[epoch]

    def pdf(self, *args, **kwargs):
        raise NotImplementedError

    def rvs(self, *args, **kwargs):
        raise NotImplementedError


def prepared(given: PeerProblem) -> Callable[[], tuple[Array, Array]]:
    """Function that filters; its result as of `peer_problem.ours`."""
    inputs, innovations, begin = given.inputs, given.innovations, datetime(2004, 1, 4)
    model = Strapdown(inputs=inputs, process_noise=given.process_noise)
    position = LinearGaussian(ndim_state=15, mapping=(0, 1, 2), noise_covar=FIX_SIGMA**2 * np.eye(3))
    times = [begin + timedelta(seconds=f.time) for f in given.fixes]

    def filtered() -> tuple[Array, Array]:
        predictor = UnscentedKalmanPredictor(model, alpha=ALPHA, beta=BETA, kappa=KAPPA)
        updater = UnscentedKalmanUpdater(position, alpha=ALPHA, beta=BETA, kappa=KAPPA)
        state = GaussianState(StateVector(np.zeros(15)), np.diag(SIGMAS**2), timestamp=times[0])
        means, covariances = [], []
        for k, (time, innovation) in enumerate(zip(times, innovations, strict=True)):
            predicted = predictor.predict(state, timestamp=time, epoch=k) if k else state
            detection = Detection(StateVector(innovation), timestamp=time, measurement_model=position)
            state = updater.update(SingleHypothesis(predicted, detection))
            means.append(np.asarray(state.state_vector, float).ravel())
            covariances.append(np.asarray(state.covar, float))
        return np.array(means), np.sqrt(np.diagonal(np.array(covariances), axis1=1, axis2=2))

    return filtered
