"""A synthetic flight whose state space has the amplitudes of three fields and one constant nuisance parameter."""

import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, DiscrepancyPrior
from edl_filter.diagnosis.jacobians.nuisance import FIELD_STATES
from edl_filter.estimation.block_sparse import from_blocks
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace, append_constant_states
from edl_filter.estimation.matern import MATERN32_COVARIANCE, matern32_transition

PRIOR = DiscrepancyPrior(scale=1.0)
ALPHA = np.radians([0.0, 2.0, 4.0])
#: Last place of the first regime and first place of the second, whose table errs independently.
CHANGE = (40, 100.0)


def correlation(distance):
    d = np.sqrt(3.0) * np.abs(distance)
    return (1.0 + d) * np.exp(-d)


class Flight:
    """A vehicle that swings through angles on its way through two regimes, one constant nuisance parameter."""

    def __init__(self, seed=3, steps=90):
        random = np.random.default_rng(seed)
        distance = np.cumsum(random.uniform(0.0, 0.1, steps))
        distance[CHANGE[0] :] += CHANGE[1]
        angle = np.radians(np.round(20.0 * np.abs(2.5 * np.sin(np.arange(steps)))) / 20.0)
        self.distance, self.count = np.repeat(distance, 2), 2 * steps
        self.sensitivity = {name: random.normal(size=self.count) for name in FIELD_COEFFICIENTS}
        self.constant = random.normal(size=(self.count, 1))
        self.noise = random.uniform(0.05, 0.2, self.count)
        self.modes = {
            n: PRIOR.angle_modes(n, angle, np.full(steps, 30.0), (np.zeros(0), np.zeros(0))) for n in FIELD_COEFFICIENTS
        }
        self.shapes = {n: m.at(np.repeat(angle, 2), np.zeros(2 * steps, bool)) for n, m in self.modes.items()}
        self.residuals = random.normal(size=self.count)
        self.fields, self.state_space = self._state_space(steps, np.diff(distance, prepend=distance[0]))

    def _state_space(self, steps, step):
        transition, process = matern32_transition(step)
        fields, start, increment, noise = {}, 0, [], []
        for name, mode in self.modes.items():
            count = mode.count
            fields[name] = slice(start, start + count)
            part = slice(start, start + FIELD_STATES * count)
            increment.append(
                (part, part, np.stack([np.kron(f - np.eye(FIELD_STATES), np.eye(count)) for f in transition]))
            )
            noise.append((part, part, np.stack([np.kron(q, np.eye(count)) for q in process])))
            start += FIELD_STATES * count
        design, covariance = np.zeros((self.count, start)), np.zeros((start, start))
        for name, values in fields.items():
            count = values.stop - values.start
            part = slice(values.start, values.start + FIELD_STATES * count)
            design[:, values] = self.sensitivity[name][:, None] * self.shapes[name]
            covariance[part, part] = np.kron(MATERN32_COVARIANCE, np.eye(count))
        row_noise = np.zeros((self.count, 2))
        row_noise[np.arange(self.count), np.arange(self.count) % 2] = self.noise**2
        model = LinearStateSpace(
            from_blocks(start, increment), from_blocks(start, noise), np.arange(0, self.count + 1, 2), design,
            row_noise, covariance,
        )  # fmt: skip
        return fields, append_constant_states(model, self.constant, np.array([0.7]))

    def white(self):
        """Whitening filter, and the residuals whitened by it."""
        whiten = whitening_filter(self.state_space)
        return whiten, whiten(self.residuals[:, None], np.zeros((0, 1)))[:, 0]

    def covariance(self):
        """Covariance of all residuals, formed explicitly."""
        along = correlation(np.subtract.outer(self.distance, self.distance))
        total = np.diag(self.noise**2) + 0.49 * self.constant @ self.constant.T
        for name in FIELD_COEFFICIENTS:
            rows = self.sensitivity[name][:, None] * self.shapes[name]
            total += along * (rows @ rows.T)
        return total

    def dense(self, places):
        """Posterior mean and covariance of the field at places along the flow by explicit covariances."""
        total, cross = self.covariance(), []
        blocks = [(name, d) for d in places for name in FIELD_COEFFICIENTS]
        for name, d in blocks:
            rows = self.sensitivity[name][:, None] * self.shapes[name]
            by_angle = rows @ self.modes[name].at(ALPHA, np.zeros(len(ALPHA), bool)).T
            by_place = correlation(np.subtract.outer(self.distance, d))
            cross.append((by_place[:, :, None] * by_angle[:, None, :]).reshape(self.count, -1))
        prior = [
            [
                np.kron(correlation(np.subtract.outer(d, e)), PRIOR.angle_kernel(name, ALPHA, ALPHA)) * (name == column)
                for column, e in blocks
            ]
            for name, d in blocks
        ]
        cross = np.concatenate(cross, axis=1)
        return cross.T @ np.linalg.solve(total, self.residuals), np.block(prior) - cross.T @ np.linalg.solve(
            total, cross
        )
