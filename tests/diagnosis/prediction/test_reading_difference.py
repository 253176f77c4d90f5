"""Difference of residuals on a fixed path against whole residuals of each side, formed bin by bin.

Rates are linear in time, so that lever-arm accelerations have a closed form; the loads are linear in the rate, and the
inertia is that of a sphere, so that predictions have one too.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.aero.damping import Damping
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.reading_difference import difference_on_fixed_path
from edl_filter.diagnosis.prediction.residuals import ModelInputs
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import Body, FlightCondition
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.increments import effective_samples
from edl_filter.telemetry.record import ImuRecord

STEP, COUNT = 0.1, 24
PER_BIN = 2
BINS = TimeBins(STEP * PER_BIN * np.arange(COUNT // PER_BIN + 1), np.ones(COUNT // PER_BIN, bool))
LENGTH, BIN_COUNT = STEP * PER_BIN, COUNT // PER_BIN
#: Bins without an end of the record, where the rate at the edge is that of the sample.
INNER = slice(1, -1)
NODES = LENGTH / NODES_PER_BIN * np.arange(NODES_PER_BIN * BIN_COUNT + 1)


@dataclass(frozen=True)
class LinearLoads(ForwardModel):
    """A spherical body whose force and moment are linear in its rate, with a force that the fixed flow gives."""

    force_by_rate: float = 0.0
    moment_by_rate: float = 0.0

    def loads(self, flow, tables=None):
        constant = flow.dynamic_pressure[:, None] * np.array([-1.0, 0.2, 0.1])
        return constant + self.force_by_rate * flow.rate, tables + self.moment_by_rate * flow.rate


class NoLoads(LinearLoads):
    """A model that must not be asked for loads."""

    def loads(self, flow, tables=None):
        raise AssertionError("the predictions are the same on both sides")


def model_of(kind=LinearLoads, mass=800.0, inertia=250.0, by_rate=(300.0, -40.0)):
    body = Body(mass, inertia * np.eye(3))
    return kind(None, None, None, None, Damping(), body, 2.65, 0.3, force_by_rate=by_rate[0], moment_by_rate=by_rate[1])


def record_of(force, rate, position, filled=(), per_sample=1):
    """A record with `per_sample` samples in each sample of the driving IMU."""
    count, fill = len(force), np.zeros((len(force), 3))
    fill[list(filled)] = 1.0
    step, zeros = STEP / per_sample, np.zeros(len(force))
    return ImuRecord(
        "imu", step * np.arange(1, count + 1), np.full(count, step), force, rate, np.broadcast_to(position, (count, 3)),
        zeros, zeros, zeros, zeros.astype(bool), zeros.astype(bool), zeros.astype(int), ("a",), zeros.astype(int),
        ("simulated",), (SensorErrors(),), force_fill_sigma=fill,
    )  # fmt: skip


@dataclass(frozen=True)
class Rate:
    """A rate that is linear in time."""

    at_zero: np.ndarray
    slope: np.ndarray

    def at(self, time):
        return self.at_zero + np.multiply.outer(time, self.slope)

    @property
    def by_sample(self):
        """Means over the samples of the driving IMU: the values in their middles."""
        return self.at(STEP * (np.arange(COUNT) + 0.5))

    def lever_arm(self, position):
        """Mean acceleration of a place over each sample in closed form ``(N, 3)``.

        ``α × r`` is constant; of the square of a rate with slope b the mean over a time h is that of the mean rate and
        ``h²/12`` of b's.
        """
        inside = STEP**2 / 12.0 * np.cross(self.slope, np.cross(self.slope, position))
        return np.array(
            [np.cross(self.slope, position) + np.cross(w, np.cross(w, position)) + inside for w in self.by_sample]
        )


DRIVING = record_of(np.zeros((COUNT, 3)), np.zeros((COUNT, 3)), np.zeros(3))
SAMPLES = effective_samples(DRIVING)
RNG = np.random.default_rng(9)
FIXED = SimpleNamespace(
    flow=FlightCondition(
        time=NODES, altitude=NODES, velocity_body=np.zeros((len(NODES), 3)), rate=np.full((len(NODES), 3), np.nan),
        speed=NODES, density=NODES, mach=NODES, knudsen=NODES, dynamic_pressure=RNG.uniform(1e3, 2e3, len(NODES)),
        alpha_total=NODES,
    ),
    tables=RNG.normal(size=(len(NODES), 3)),
)  # fmt: skip


@dataclass(frozen=True)
class Side:
    """One set of readings: force by sample, a rate, a model, and checking records with the place of each."""

    force: np.ndarray
    rate: Rate
    model: LinearLoads
    checking: tuple = ()

    @property
    def arguments(self):
        inputs = ModelInputs(SimpleNamespace(samples=SAMPLES), self.model, DRIVING, self.checking)
        return inputs, self.force, self.rate.by_sample

    def residuals(self):
        """Twin: whole residuals of the bins, of forces, rate steps, and each checking IMU's forces and rates."""
        force, rate = mean_by_bin(self.force), mean_by_bin(self.rate.by_sample)
        predicted_force, predicted_step = self.prediction()
        checking_force, checking_rate = [], []
        for record in self.checking:
            read_force, read_rate = record.specific_force.copy(), record.angular_rate.copy()
            read_force[record.filled], read_rate[record.filled] = np.nan, np.nan
            implied = force + mean_by_bin(self.rate.lever_arm(record.position[0]))
            checking_force.append(mean_by_bin(read_force) - implied)
            checking_rate.append(mean_by_bin(read_rate) - rate)
        return force - predicted_force, np.diff(rate, axis=0) - predicted_step, checking_force, checking_rate

    def prediction(self):
        """Means of specific force and steps of the rate, node by node with the weights of Simpson's rule."""
        force, moment = self.model.loads(replace(FIXED.flow, rate=self.rate.at(NODES)), FIXED.tables)
        acceleration = moment @ np.linalg.inv(self.model.body.inertia)
        simpson = np.array([1.0, 4.0, 2.0, 4.0, 1.0]) / 12.0
        means, steps = [], []
        for b in range(BIN_COUNT):
            means.append(simpson @ force[4 * b : 4 * b + 5] / self.model.body.mass)
            if b + 1 < BIN_COUNT:
                rising, falling = np.arange(5) / 4.0, 1.0 - np.arange(5) / 4.0
                before, after = acceleration[4 * b : 4 * b + 5], acceleration[4 * b + 4 : 4 * b + 9]
                steps.append(LENGTH * ((simpson * rising) @ before + (simpson * falling) @ after))
        return np.array(means), np.array(steps)


def mean_by_bin(values):
    """Means over the bins of values by sample, of equal lengths."""
    per_bin = len(values) // BIN_COUNT
    return np.array([np.mean(values[b * per_bin : (b + 1) * per_bin], axis=0) for b in range(BIN_COUNT)])


def random_side(rng, filled=(), **model):
    """Two checking IMUs, one of which samples faster and has values that were filled in."""
    rate = Rate(rng.normal(0.0, 0.3, 3), rng.normal(0.0, 0.3, 3))
    checking = tuple(
        record_of(*rng.normal(size=(2, per_sample * COUNT, 3)), rng.normal(size=3), f, per_sample)
        for per_sample, f in ((1, ()), (3, filled))
    )
    return Side(rng.normal(size=(COUNT, 3)), rate, model_of(**model), checking)


def difference(plus, minus, same_loads=True):
    return difference_on_fixed_path(BINS, plus.arguments, minus.arguments, FIXED, same_loads)


def assert_difference(actual, plus, minus):
    """That of whole residuals, channel by channel; sums of numbers of some m/s² are rounded to 1e-12."""
    (force, step, checking_force, checking_rate), of_minus = plus.residuals(), minus.residuals()
    np.testing.assert_allclose(actual.force, force - of_minus[0], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(actual.rate_step, step - of_minus[1], rtol=0.0, atol=1e-11)
    for values, a, b in zip(actual.checking_force, checking_force, of_minus[2], strict=True):
        np.testing.assert_allclose(values[INNER], (a - b)[INNER], rtol=0.0, atol=1e-11)
    for values, a, b in zip(actual.checking_rate, checking_rate, of_minus[3], strict=True):
        np.testing.assert_allclose(values, a - b, rtol=0.0, atol=1e-11)


@given(st.integers(0, 10_000), st.booleans())
def test_the_difference_is_that_of_whole_residuals(seed, same_loads):
    """Everything differs: readings of all IMUs and their places; with the same loads at the same rate or others."""
    rng = np.random.default_rng(seed)
    vehicles = [{}, {}] if same_loads else [{"mass": 800.0 + 50.0 * k, "inertia": 250.0 - 20.0 * k} for k in range(2)]
    plus, minus = (random_side(rng, (7, 8, 40), **v) for v in vehicles)
    actual = difference(plus, minus, same_loads)
    assert_difference(actual, plus, minus)
    lost = np.isnan(actual.checking_force[1][:, 0])
    np.testing.assert_array_equal(np.flatnonzero(lost), [1, 6])  # samples 7, 8 and 40 of six in a bin
    assert not np.isnan(actual.checking_force[0]).any()


def test_a_force_alone_is_the_difference_of_means_and_needs_no_prediction():
    """The checking IMUs' residuals change by the opposite amount; nothing rotates otherwise."""
    rng = np.random.default_rng(1)
    minus = replace(random_side(rng), model=model_of(NoLoads))
    bias = np.array([0.1, -0.2, 0.3])
    plus = replace(minus, force=minus.force + bias)
    actual = difference(plus, minus)
    np.testing.assert_allclose(actual.force, np.tile(bias, (BIN_COUNT, 1)), atol=1e-13)
    np.testing.assert_array_equal(actual.rate_step, 0.0)
    for force, rate in zip(actual.checking_force, actual.checking_rate, strict=True):
        np.testing.assert_allclose(force, -np.tile(bias, (BIN_COUNT, 1)), atol=1e-13)
        np.testing.assert_array_equal(rate, 0.0)


def test_a_rate_changes_the_loads_by_which_it_is_damped():
    """A gyro's bias does not change the measured step; its prediction changes by the damping over a bin."""
    minus = random_side(np.random.default_rng(2))
    bias = np.array([0.01, -0.02, 0.03])
    plus = replace(minus, rate=Rate(minus.rate.at_zero + bias, minus.rate.slope))
    actual = difference(plus, minus)
    np.testing.assert_allclose(actual.rate_step, np.tile(40.0 / 250.0 * LENGTH * bias, (BIN_COUNT - 1, 1)), atol=1e-12)
    np.testing.assert_allclose(actual.force, np.tile(-300.0 / 800.0 * bias, (BIN_COUNT, 1)), atol=1e-12)
    for rate in actual.checking_rate:
        np.testing.assert_allclose(rate, -np.tile(bias, (BIN_COUNT, 1)), atol=1e-13)


def test_another_vehicle_changes_the_prediction_at_the_same_rates():
    """Twice the mass halves the predicted force; the readings, and the comparison of two IMUs, stay as they are."""
    light = random_side(np.random.default_rng(3))
    heavy = replace(light, model=model_of(mass=1600.0))
    actual = difference(heavy, light, same_loads=False)
    np.testing.assert_allclose(actual.force, 0.5 * light.prediction()[0], rtol=1e-12)
    for channel in (actual.rate_step, *actual.checking_force, *actual.checking_rate):
        np.testing.assert_allclose(channel, 0.0, atol=1e-13)


def test_a_checking_imu_that_is_corrected_differs_by_its_own_readings():
    """Of a record that is another one; the driving IMU and the other checking IMU do not change."""
    minus = replace(random_side(np.random.default_rng(4)), model=model_of(NoLoads))
    first, second = minus.checking
    corrected = replace(second, specific_force=second.specific_force + 0.5, angular_rate=second.angular_rate - 0.25)
    actual = difference(replace(minus, checking=(first, corrected)), minus)
    for channel in (actual.force, actual.rate_step, actual.checking_force[0], actual.checking_rate[0]):
        np.testing.assert_array_equal(channel, 0.0)
    np.testing.assert_allclose(actual.checking_force[1], 0.5, atol=1e-13)
    np.testing.assert_allclose(actual.checking_rate[1], -0.25, atol=1e-13)


def test_a_checking_imu_whose_samples_end_between_the_edges_of_the_bins():
    """Its change is interpolated as a smooth one: of a cubic by its exact means, but for the first and last bins."""
    minus = replace(random_side(np.random.default_rng(8)), model=model_of(NoLoads))
    first, _ = minus.checking
    shifted = replace(first, time=first.time + 0.03)
    begin, end = shifted.time - STEP, shifted.time
    of_samples, of_bins = (
        (b**4 - a**4) / (4.0 * (b - a)) for a, b in ((begin, end), (BINS.edges[:-1], BINS.edges[1:]))
    )
    changed = replace(shifted, specific_force=shifted.specific_force + np.outer(of_samples, [1.0, -2.0, 0.5]))
    plus, minus = (replace(minus, checking=(record,)) for record in (changed, shifted))
    actual = difference(plus, minus).checking_force[0]
    assert np.isnan(actual[0]).all()  # the record begins within it
    np.testing.assert_allclose(actual[2:-2], np.outer(of_bins, [1.0, -2.0, 0.5])[2:-2], rtol=0.0, atol=1e-10)


def test_another_place_of_a_checking_imu_changes_what_is_implied_for_it():
    """By the lever-arm acceleration of the displacement, in which rates and their change are linear in the place."""
    minus = replace(random_side(np.random.default_rng(5)), model=model_of(NoLoads))
    first, second = minus.checking
    displacement = np.array([0.1, -0.3, 0.2])
    moved = replace(first, position=first.position + displacement)
    actual = difference(replace(minus, checking=(moved, second)), minus)
    expected = -mean_by_bin(minus.rate.lever_arm(displacement))
    np.testing.assert_allclose(actual.checking_force[0][INNER], expected[INNER], rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(actual.checking_force[1], 0.0)
    assert np.abs(expected).max() > 0.01


@given(st.integers(0, 10_000))
def test_differences_add_up_and_change_their_sign(seed):
    """From the first to the third set of readings they are the sum of both steps; exchanged they are the opposite."""
    rng = np.random.default_rng(seed)
    sides = [random_side(rng, mass=800.0 + 30.0 * k) for k in range(3)]
    whole, first, second, back = (
        difference(sides[a], sides[b], same_loads=False) for a, b in ((2, 0), (1, 0), (2, 1), (0, 2))
    )
    for name in ("force", "rate_step", "checking_force", "checking_rate"):
        values = [np.asarray(getattr(d, name)) for d in (whole, first, second, back)]
        np.testing.assert_allclose(values[0], values[1] + values[2], rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(values[3], -values[0], rtol=0.0, atol=1e-12)


def test_records_of_another_number_of_imus_are_refused():
    side = random_side(np.random.default_rng(6))
    with pytest.raises(ValueError):
        difference(side, replace(side, checking=side.checking[:1]))
