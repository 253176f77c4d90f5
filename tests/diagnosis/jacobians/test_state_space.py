"""The state-space model of a constructed flight against the dense joint Gaussian of its error sources.

The twin has no transitions of nuisance parameters: air and coefficients are Gaussian processes with the Matérn
correlation of the distance between two rows, a bin's gyro noise is one vector that enters wherever the flight feels it,
and the navigation error is propagated epoch by epoch. All rows' covariances are added up source by source.
"""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from standins import PLANET

from edl_filter import rotations
from edl_filter.aero.discrepancy import AngleModes, DiscrepancyPrior
from edl_filter.diagnosis.jacobians.bin_rows import BinRows
from edl_filter.diagnosis.jacobians.nuisance import StatedUncertainty, nuisance_layout
from edl_filter.diagnosis.jacobians.state_space import (
    assemble_state_space,
    entry_prior,
    stated_initial_error,
)
from edl_filter.diagnosis.jacobians.transitions import PathTransitions
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.constraints import Altimeter, RestRate, ZeroSpecificForce
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.layout import Layout, State
from edl_filter.telemetry.record import InitialState

# --- a constructed flight --------------------------------------------------------------------------------------------

LENGTH, COUNT = 0.5, 6
BINS = TimeBins(LENGTH * np.arange(COUNT + 1), np.arange(COUNT) != 2)
#: Epochs: time, bin that ends, constraints, time over which the bin's gyros rotate the attitude. The instrument changes
#: at 2 s after the bin's end; the third bin is not compared.
EPOCHS = (
    (0.5, 0, (), 0.5), (1.0, 1, (0,), 0.5), (1.5, 2, (), 0.0), (1.7, -1, (1, 3), 0.2), (2.0, 3, (), 0.3),
    (2.0, -1, (), 0.0), (2.5, 4, (), 0.5), (3.0, 5, (), 0.5), (4.0, -1, (), 0.0), (5.0, -1, (2,), 0.0),
)  # fmt: skip
CHANGE_EPOCH, BIN_AFTER_CHANGE = 5, 4
NODE_TIME = LENGTH / NODES_PER_BIN * np.arange(NODES_PER_BIN * COUNT + 1)
ALTITUDE = 6e4 - 3e3 * NODE_TIME**1.5
DRIVING = SensorErrors(accelerometer_bias=0.3, gyro_bias=0.2)
SECOND_DRIVING = SensorErrors(accelerometer_bias=0.7, gyro_bias=0.4)
CHECKING = (SensorErrors(), SensorErrors(accelerometer_bias=0.5, gyro_scale=0.25))
SPINNING = PLANET.__class__(**(vars(PLANET) | {"rotation_rate": 0.3}))
ATTITUDE = rotations.from_rotation_vector(np.array([0.3, -0.8, 1.1]))
COUPLED = {"ca": 2, "cn": 0, "cm": 1}


@dataclass(frozen=True)
class Flight:
    """Arguments of `assemble_state_space`, with the numbers that the twin needs."""

    inputs: SimpleNamespace
    transitions: PathTransitions
    rows: BinRows
    nuisance: object
    uncertainty: StatedUncertainty
    residuals: SimpleNamespace
    flow_distance: np.ndarray

    def assemble(self):
        return assemble_state_space(
            self.inputs, BINS, self.transitions, self.rows, self.nuisance, self.uncertainty, self.residuals,
            self.flow_distance,
        )  # fmt: skip


def semidefinite(rng, size, scale):
    root = scale * rng.normal(size=(size, size)) / np.sqrt(size)
    return root @ root.T


def constructed_flight(seed=5, exact=False):
    """Random transitions, rows and noise; `exact`: no errors of air, vehicle and database."""
    rng = np.random.default_rng(seed)
    stated = dict.fromkeys(("density", "wind", "mass", "inertia"), 0.0 if exact else 0.1)
    uncertainty = StatedUncertainty(
        **stated, density_correlation=4e3, discrepancy=DiscrepancyPrior(), numerical=1e-3, numerical_memory=0.8
    )
    record = SimpleNamespace(
        errors=CHECKING, unit=np.ones(COUNT, int), index_at=lambda time: np.floor(time / LENGTH).astype(int)
    )
    layout = Layout.of((DRIVING, SECOND_DRIVING), {})
    modes = {} if exact else {n: AngleModes(np.zeros((2, j)), np.zeros((2, j))) for n, j in COUPLED.items()}
    nuisance = nuisance_layout(layout, (record,), BINS, uncertainty, modes)
    states = [
        State(np.concatenate(([3.5e6, 2e5 + 1e3 * e, -4e5, 1e3, 2e3, 3e2], ATTITUDE)), np.zeros(layout.size))
        for e in range(len(EPOCHS))
    ]
    transition = np.eye(layout.size) + 0.04 * rng.normal(size=(len(EPOCHS), layout.size, layout.size))
    process_noise = np.array([semidefinite(rng, layout.size, 0.2) for _ in EPOCHS])
    transition[CHANGE_EPOCH] = np.diag(np.repeat([1.0, 0.0], [9, 6]))  # another instrument: new sensor errors
    process_noise[CHANGE_EPOCH] = np.diag(np.repeat([0.0, 0.49, 0.16], [9, 3, 3]))
    used = np.tile(BINS.valid[:, None], (1, 12))
    used[-1, 3:6], used[1, 3:6], used[4, 9:] = False, False, False
    problem = SimpleNamespace(
        layout=layout,
        constraints=(
            RestRate(1.0, np.zeros(3), 0.2, SPINNING),
            ZeroSpecificForce(1.7, np.zeros(3), np.array([0.1, 0.2, 0.3])),
            Altimeter(5.0, 0.0, 0.5, 3.4e6),
            RestRate(1.7, np.zeros(3), 0.3, SPINNING),
        ),
        initial=InitialState(0.0, *states[0].nav[:6].reshape(2, 3), ATTITUDE, semidefinite(rng, 9, 1.0)),
        entry=EntryErrors(),
        instruments=(SECOND_DRIVING, DRIVING),
        samples=SimpleNamespace(unit=np.array([1, 1, 0])),
        planet=SPINNING,
    )
    half = 0.5 * LENGTH
    driving = SimpleNamespace(
        time=half * np.arange(1, 2 * COUNT + 1), interval=np.full(2 * COUNT, half),
        rate_noise=rng.uniform(0.2, 0.6, 2 * COUNT),
    )  # fmt: skip
    flow_distance = rng.uniform(0.0, 0.2, NODES_PER_BIN * COUNT)
    flow_distance[2 * NODES_PER_BIN - 2] = 100.0  # one table ends in the second bin
    return Flight(
        inputs=SimpleNamespace(problem=problem, driving=driving, checking=(record,)),
        transitions=PathTransitions(
            time=np.array([e[0] for e in EPOCHS]),
            transition=transition,
            process_noise=process_noise,
            gyro_noise_time=np.array([e[3] for e in EPOCHS]),
            bin=np.array([e[1] for e in EPOCHS]),
            constraints=tuple(e[2] for e in EPOCHS),
            states=states,
            onboard=None,
        ),
        rows=BinRows(
            design=rng.normal(size=(COUNT, 12, nuisance.size)),
            noise=np.array([semidefinite(rng, 12, 0.3) + 0.1 * np.eye(12) for _ in range(COUNT)]),
            used=used,
            values=np.zeros((COUNT, 12)),
        ),
        nuisance=nuisance,
        uncertainty=uncertainty,
        residuals=SimpleNamespace(
            path=SimpleNamespace(time=np.array([0.0, 5.0])),
            nodes=SimpleNamespace(time=NODE_TIME),
            flow=SimpleNamespace(altitude=ALTITUDE),
        ),
        flow_distance=flow_distance,
    )


# --- its twin --------------------------------------------------------------------------------------------------------


def rows_in_order(flight):
    """``(epoch, bin, channel)`` of each row, or ``(epoch, -1 - constraint, component)``, in the order of time."""
    out = []
    for e, (_, bin_, constraints, _) in enumerate(EPOCHS):
        if bin_ >= 0:
            out += [(e, bin_, c) for c in range(12) if flight.rows.used[bin_, c]]
        for c in constraints:
            out += [(e, -1 - c, i) for i in range(len(flight.inputs.problem.constraints[c].measured))]
    return out


def gyro_noise_sigma(flight):
    """Sigma of the mean of each bin's gyro noise: of the sum of independent samples over the length of the bin."""
    noise, half = flight.inputs.driving.rate_noise, 0.5 * LENGTH
    return [np.hypot(noise[2 * b] * half, noise[2 * b + 1] * half) / LENGTH for b in range(COUNT)]


def navigation_sources(flight):
    """The navigation error after each epoch as a map from its sources, and the sources' covariance.

    Sources: the error at the beginning (n), process noise of each epoch (n each), gyro noise of each bin (3 each). The
    noise that begins after the last bin has that bin's sigma.
    """
    t, n = flight.transitions, flight.nuisance.layout.size
    total = n * (1 + len(EPOCHS)) + 3 * (COUNT + 1)
    covariance, state, after = np.zeros((total, total)), np.zeros((n, total)), []
    covariance[:n, :n] = initial_covariance(flight)
    state[:, :n] = np.eye(n)
    for b, sigma in enumerate([*gyro_noise_sigma(flight), gyro_noise_sigma(flight)[-1]]):
        part = gyro_source(flight, b)
        covariance[part, part] = sigma**2 * np.eye(3)
    ended = 0
    for e, (_, bin_, _, rotating) in enumerate(EPOCHS):
        part = slice(n * (1 + e), n * (2 + e))
        state = t.transition[e] @ state
        state[:, part] = np.eye(n)
        state[6:9, gyro_source(flight, ended)] -= rotating * np.eye(3)
        covariance[part, part] = t.process_noise[e]
        after.append(state.copy())
        ended += bin_ >= 0
    return after, covariance


def gyro_source(flight, bin_):
    """Place of a bin's gyro noise among the sources."""
    start = flight.nuisance.layout.size * (1 + len(EPOCHS)) + 3 * bin_
    return slice(start, start + 3)


def initial_covariance(flight):
    """Of the navigation error and of the first driving instrument's errors."""
    out = np.zeros((15, 15))
    out[:9, :9] = flight.inputs.problem.initial.covariance
    out[9:12, 9:12], out[12:, 12:] = 0.3**2 * np.eye(3), 0.2**2 * np.eye(3)
    return out


def constraint_row(flight, constraint, component, epoch):
    """Derivative of a constraint's prediction in closed form ``(n,)``."""
    out = np.zeros(15)
    if constraint in (0, 3):  # rates at rest: the spin in body axes, u + u × φ, and the gyros' bias
        spin = rotations.rotate(rotations.conjugate(ATTITUDE), np.array([0.0, 0.0, 0.3]))
        out[6:9] = [np.cross(spin, e)[component] for e in np.eye(3)]
        out[12 + component] = 1.0
    elif constraint == 1:  # no force before entry: the accelerometers' bias
        out[9 + component] = 1.0
    else:  # a height grows along the position vector
        position = flight.transitions.states[epoch].nav[:3]
        out[:3] = position / np.linalg.norm(position)
    return out


def mean_over_bin(flight, bin_):
    """Map from the navigation error at a bin's end to half its sum with the error at the beginning."""
    if bin_ == BIN_AFTER_CHANGE:  # the error at the beginning is another instrument's
        return np.eye(15)
    product = np.eye(15)
    for e in {0: (0,), 1: (1,), 2: (2,), 3: (3, 4), 5: (7,)}[bin_]:
        product = flight.transitions.transition[e] @ product
    return 0.5 * (np.eye(15) + np.linalg.inv(product))


def matern(x, y):
    """Covariances of value and derivative at x and y, ``(2, 2)``: ``k``, ``∂k/∂y``, ``∂k/∂x``, ``∂²k/∂x∂y``."""
    d, r = x - y, np.sqrt(3.0) * abs(x - y)
    slope = -3.0 * d * np.exp(-r)
    return np.array([[(1.0 + r) * np.exp(-r), -slope], [slope, 3.0 * (1.0 - r) * np.exp(-r)]])


def covariance_of_process(loadings, places):
    """Covariance ``(R, R)`` by a process with loadings ``(R, 2)`` of value and derivative at the rows' places."""
    count = len(places)
    return np.array(
        [[loadings[i] @ matern(places[i], places[j]) @ loadings[j] for j in range(count)] for i in range(count)]
    )


def dense_model(flight):
    """Covariance of all rows, and their response to the initial error of the filter's vector ``(R, n)``."""
    rows, nuisance = rows_in_order(flight), flight.nuisance
    after, of_sources = navigation_sources(flight)
    by_source, design = [], np.zeros((len(rows), nuisance.size))
    for r, (e, b, c) in enumerate(rows):
        if b < 0:
            by_source.append(constraint_row(flight, -1 - b, c, e) @ after[e])
            continue
        design[r] = flight.rows.design[b, c]
        navigation = design[r, :15] @ (mean_over_bin(flight, b) if c < 3 else np.eye(15))
        response = navigation @ after[e]
        response[gyro_source(flight, b)] += design[r, nuisance["gyro_noise_before"]]
        response[gyro_source(flight, b + 1)] += design[r, nuisance["gyro_noise_after"]]
        by_source.append(response)
    by_source = np.array(by_source)
    out = by_source @ of_sources @ by_source.T
    constant = {"checking0.1_accelerometer_bias": 0.5, "checking0.1_gyro_scale": 0.25, "mass": 1.0, "inertia": 1.0}
    for name, sigma in constant.items():
        if name in nuisance:
            columns = sigma * design[:, nuisance[name]]
            out += columns @ columns.T
    time = np.array([EPOCHS[e][0] for e, _, _ in rows])
    altitude = np.interp(time, NODE_TIME, ALTITUDE)
    places = dict.fromkeys(("density", "wind_east", "wind_north"), -altitude / 4e3)
    places |= dict.fromkeys(("ca", "cn", "cm"), time / 0.8)
    for name, place in places.items():
        if name in nuisance:
            out += covariance_of_process(design[:, nuisance[name]], place)
    along_flow = np.interp(time, NODE_TIME, np.append(0.0, np.cumsum(flight.flow_distance)))
    for values in nuisance.fields.values():
        modes = values.stop - values.start
        for state in range(values.start, values.stop):
            out += covariance_of_process(design[:, [state, state + modes]], along_flow)
    for r, (_, b, c) in enumerate(rows):
        for s, (_, b_of_s, c_of_s) in enumerate(rows):
            if b == b_of_s and b >= 0:
                out[r, s] += flight.rows.noise[b, c, c_of_s]
            elif b == b_of_s:
                out[r, s] += flight.inputs.problem.constraints[-1 - b].noise[c, c_of_s]
    return out, by_source[:, :15]


@pytest.fixture(scope="module", params=[False, True], ids=["inexact", "exact"])
def flight(request):
    return constructed_flight(exact=request.param)


def test_the_flight_has_what_it_is_to_test(flight):
    nuisance = flight.nuisance
    assert nuisance.layout.size == 15 and "checking0.1_gyro_scale" in nuisance
    assert "checking0.0_accelerometer_bias" not in nuisance and "ca" in nuisance
    assert bool(nuisance.fields) is ("density" in nuisance) is ("mass" in nuisance)


def test_rows_are_in_the_order_of_time(flight):
    """A bin's rows at its end, those of a constraint at that time after them; columns begin with each step."""
    model, index = flight.assemble()
    rows = rows_in_order(flight)
    assert index.count == len(rows) == len(model.design) == model.row_start[-1]
    assert np.all(np.diff(index.time) >= 0.0)
    expected = np.full((COUNT, 12), -1)
    for r, (e, b, c) in enumerate(rows):
        assert index.time[r] == EPOCHS[e][0]
        if b >= 0:
            expected[b, c] = r
            assert index.time[r] == pytest.approx(BINS.edges[b + 1])
        else:
            assert index.constraint_rows[-1 - b].start + c == r
    np.testing.assert_array_equal(index.bin_rows, expected)
    assert [s.stop - s.start for s in index.constraint_rows] == [3, 3, 1, 3]
    for k, (begin, end) in enumerate(zip(model.row_start[:-1], model.row_start[1:], strict=True)):
        np.testing.assert_array_equal(index.column[begin:end], np.arange(end - begin))
        assert len({(e, b) for e, b, _ in rows[begin:end]}) <= 1, k


def test_time_passes_once_at_every_epoch(flight):
    """Several steps at one epoch, and an epoch at the time of the one before: no time passes between them."""
    model, index = flight.assemble()
    # the bin and the constraint at 1 s, two constraints at 1.7 s, the change of the instrument at 2 s
    expected = [0.5, 0.5, 0.0, 0.5, 0.2, 0.0, 0.3, 0.0, 0.5, 0.5, 1.0, 1.0]
    np.testing.assert_allclose(index.step_interval, expected, atol=1e-12)
    assert len(model.row_start) == len(expected) + 1


def test_the_likelihood_is_that_of_the_dense_joint_gaussian(flight):
    """With an initial mean, which the rows see through the transitions."""
    model, _ = flight.assemble()
    rng = np.random.default_rng(2)
    initial_mean, residuals = rng.normal(size=(15, 1)), 3.0 * rng.normal(size=len(model.design))
    whiten = whitening_filter(model)
    white = whiten(residuals[:, None], initial_mean)[:, 0]
    covariance, response = dense_model(flight)
    error = residuals - response @ initial_mean[:, 0]
    log_determinant = np.linalg.slogdet(covariance)[1]
    expected = -0.5 * error @ np.linalg.solve(covariance, error) - 0.5 * log_determinant
    # a constraint's derivatives are differences: 1e-9 of them are rounding
    assert whiten.log_determinant == pytest.approx(log_determinant, abs=1e-6)
    assert whiten.log_likelihood(white) == pytest.approx(expected, abs=1e-6)
    whitening = whiten(np.eye(len(residuals)), np.zeros((0, len(residuals))))
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(len(residuals)), atol=1e-6)


@pytest.mark.parametrize("bin_", [0, 1, 3, 5])
def test_a_force_is_predicted_by_the_mean_of_the_errors_at_both_ends(flight, bin_):
    """Of an error that is propagated without noise; a rate's row has the error at the end alone."""
    model, index = flight.assemble()
    t, error = flight.transitions, np.random.default_rng(7).normal(size=15)
    at_end = [error]
    for e, (_, ends, _, _) in enumerate(EPOCHS):
        error = t.transition[e] @ error
        if ends >= 0:
            at_end.append(error)
    begin, end = at_end[bin_], at_end[bin_ + 1]
    for c in (0, 1, 2, 6, 11):
        row = index.bin_rows[bin_, c]
        expected = flight.rows.design[bin_, c, :15] @ (0.5 * (begin + end) if c < 3 else end)
        assert model.design[row, :15] @ end == pytest.approx(expected, abs=1e-9)


def test_bins_without_noise_of_the_gyros_have_the_usual_one():
    """The driving record begins after the first bin: the sigma of the others' median, not a number that is none."""
    flight = constructed_flight()
    expected = np.median(gyro_noise_sigma(flight)[1:])
    driving = flight.inputs.driving
    later = SimpleNamespace(**{name: values[2:] for name, values in vars(driving).items()})
    flight.inputs.driving = later
    model, _ = flight.assemble()
    after = flight.nuisance["gyro_noise_after"]
    np.testing.assert_allclose(model.initial_covariance[after, after], expected**2 * np.eye(3), rtol=1e-12)
    assert np.all(np.isfinite(model.process_noise.values))


def test_no_bins_and_constraints_are_no_rows():
    """The model of a flight in which nothing is compared still propagates its states."""
    flight = constructed_flight()
    flight.rows.used[:] = False
    flight.inputs.problem.constraints = ()
    transitions = SimpleNamespace(**(vars(flight.transitions) | {"constraints": ((),) * len(EPOCHS)}))
    bare = Flight(**(vars(flight) | {"transitions": transitions}))
    model, index = bare.assemble()
    assert index.count == 0 and model.design.shape == (0, flight.nuisance.size) and len(model.increment) == len(EPOCHS)
    np.testing.assert_array_equal(model.row_start, 0)


# --- what the mission states of the beginning ------------------------------------------------------------------------


def test_the_prior_is_that_of_the_entry_state_and_of_the_instrument_that_drives_first():
    """The samples begin with the second instrument of the list."""
    flight = constructed_flight()
    stated, covariance = entry_prior(flight.inputs)
    initial = flight.inputs.problem.initial
    np.testing.assert_array_equal(
        stated.nav, np.concatenate((initial.position, initial.velocity, initial.inertial_from_body))
    )
    assert not stated.errors.any()
    np.testing.assert_allclose(covariance, initial_covariance(flight), rtol=1e-12, atol=1e-15)


@given(st.lists(st.floats(-1.0, 1.0), min_size=15, max_size=15))
def test_the_stated_error_moves_the_point_to_what_is_stated(shift):
    """A point that is a shift away from the stated state: the stated error about it is minus the shift."""
    inputs = constructed_flight(exact=True).inputs
    start = entry_prior(inputs)[0].plus(np.array(shift))
    error = stated_initial_error(inputs, start)
    np.testing.assert_allclose(error, -np.array(shift), rtol=0.0, atol=1e-8)  # positions of 3.5e6 m
    np.testing.assert_allclose(start.plus(error).nav, entry_prior(inputs)[0].nav, rtol=0.0, atol=1e-8)
