"""Jacobian of the predictions at a few bins of the shipped flight, against differences by another mechanism.

The twin changes air, coefficients and vehicle by a perturbation of the forward model and evaluates the whole prediction
from the path on; its differences are of fourth order with steps of its own. What is linear agrees to rounding, which
is 1e-16 over the smallest relative step, 1e-5. A wind of 0.5 m/s turns a flow of 5 km/s by a hundredth of the smallest
total angles, whose function it is: the square of that over six. Displaced by 100 m some bins pass a node of the table
of the atmosphere, where the slope of the density changes; elsewhere it is the square of 100 m over the scale height.
The aerodynamic tables are the smooth ones: those of the mission are linear between nodes.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from edl_filter.aero.database import load_database
from edl_filter.aero.discrepancy import ASYMMETRIES, AngleModes
from edl_filter.diagnosis.jacobians.coefficient_errors import numerical_error_units
from edl_filter.diagnosis.jacobians.nuisance import StatedUncertainty
from edl_filter.diagnosis.jacobians.prediction_jacobian import prediction_jacobian
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.predicted_readings import flow_at, predict
from edl_filter.diagnosis.prediction.residuals import PathReference, compute_residuals
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects import EffectInstance
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation, Perturbation
from edl_filter.effects.registry import find_effect

BINS = 12
#: Dynamic pressure about which each stretch lies, Pa: before the peak, or at it.
PRESSURES = {"rarefied": 0.2, "hypersonic": 800.0, "peak": np.inf}
COLUMNS = {
    "position": 3, "velocity": 3, "attitude": 3, "density": 1, "wind_east": 1, "wind_north": 1, "ca": 1, "cn": 1,
    "cm": 1, "mass": 1, "inertia": 1, "rate": 3, "field_ca": 2, "field_cn": 1, "field_cm": 2,
    "field_side_asymmetry": 1, "field_normal_asymmetry": 1, "field_pitch_asymmetry": 1, "field_yaw_asymmetry": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Stretch:
    """A few bins of the flight, their prediction, and its Jacobian."""

    inputs: object
    bins: TimeBins
    residuals: object
    uncertainty: StatedUncertainty
    units: CoefficientUnits
    field: FieldPerturbation
    jacobian: object

    @property
    def base(self):
        """The point's perturbation, or none."""
        return self.inputs.forward_model.perturbation or Perturbation.zero(self.units)

    def prediction(self, nodes=None, rate_change=None, **changes):
        """Predictions ``(B, 3)`` and ``(B - 1, 3)`` with changes of the perturbation, of the path, or of the rate."""
        added = {name: getattr(self.base, name) + value for name, value in changes.items() if name != "field"}
        added |= {name: value for name, value in changes.items() if name == "field"}
        model = replace(self.inputs.forward_model, perturbation=replace(self.base, **added))
        flow = flow_at(model, self.residuals.nodes if nodes is None else nodes)
        if rate_change is not None:
            flow = replace(flow, rate=flow.rate + rate_change)
        return predict(model, self.bins, flow)

    def derivative(self, of_change, step):
        """Central difference of fourth order of the predictions as a function of a change."""
        near, far = ([of_change(s) for s in (h, -h)] for h in (step, 2.0 * step))
        return tuple((8.0 * (near[0][i] - near[1][i]) - (far[0][i] - far[1][i])) / (12.0 * step) for i in range(2))

    def columns(self, name):
        """Columns of the Jacobian ``(B, 3, c)`` and ``(B - 1, 3, c)``."""
        part = self.jacobian.columns[name]
        return self.jacobian.force[:, :, part], self.jacobian.rate_step[:, :, part]


def modes_of(count, seed):
    """Smooth modes over the angle, another one in each regime."""
    rng, angle = np.random.default_rng(seed), np.radians(0.05) * np.arange(1200)
    return AngleModes(
        *(np.sin(np.outer(angle, rng.uniform(1.0, 5.0, count)) + rng.uniform(0.0, 6.0)) for _ in range(2))
    )


@pytest.fixture(scope="module")
def flight(practice_06):
    """The shipped flight: its inputs, bins, smoothed state, and dynamic pressure at its bins."""
    case = flight_case(practice_06)
    inputs, point = case.model_inputs(()), smoothed_point(case.reconstruction)
    reference = PathReference(case.bins, point.start.nav[:10], point.errors, None)
    pressure = compute_residuals(reference, inputs).flow.dynamic_pressure[:-1:NODES_PER_BIN]
    return SimpleNamespace(case=case, inputs=inputs, reference=reference, pressure=pressure)


def stretch_of(flight, where, changed, smooth=True):
    """Bins about a dynamic pressure; `changed`: with two effects, and about a point far from what is stated."""
    bins, pressure = flight.case.bins, flight.pressure
    middle = int(np.argmax(pressure > min(PRESSURES[where], 0.9999 * pressure.max())))
    first = middle - BINS // 2
    part = TimeBins(bins.edges[first : first + BINS + 1], bins.valid[first : first + BINS])
    assert part.valid.all()
    reference, inputs = replace(flight.reference, bins=part), flight.inputs
    if smooth:
        inputs = replace(inputs, forward_model=replace(inputs.forward_model, database=load_database(family="MER")))
    residuals, model = compute_residuals(reference, inputs), inputs.forward_model
    uncertainty = replace(flight.case.uncertainty, density=0.1, numerical=0.01)
    units = numerical_error_units(residuals, uncertainty)
    database = CoefficientUnits(units.time, ca=5.0 * units.ca, cn=np.full_like(units.cn, 0.01), cm=3.0 * units.cm)
    modes = {"ca": modes_of(2, 1), "cn": modes_of(1, 2), "cm": modes_of(2, 3)}
    field = FieldPerturbation.zero(modes, database, database, model.database.continuum_limit)
    if changed:
        effects = (
            EffectInstance(find_effect("density_scale"), {"k": 0.1}),
            EffectInstance(find_effect("pitching_moment_scale"), {"k": 0.2}),
        )
        point = replace(
            Perturbation.zero(units), density=np.full(1, -0.05), wind=np.array([[20.0, -10.0]]), ca=np.full(1, 2.0),
            cm=np.full(1, -3.0), mass=0.02, inertia=-0.05, field=field,
        )  # fmt: skip
        inputs = replace(inputs, forward_model=replace(model.with_effects(effects), perturbation=point))
        residuals = compute_residuals(reference, inputs)
    jacobian = prediction_jacobian(inputs, part, residuals, uncertainty, units, field)
    return Stretch(inputs, part, residuals, uncertainty, units, field, jacobian)


@pytest.fixture(
    scope="module", params=[(w, c) for w in PRESSURES for c in (False, True)], ids=lambda p: f"{p[0]}-{p[1]}"
)
def stretch(request, flight):
    return stretch_of(flight, *request.param)


def assert_columns(stretch, name, expected, rtol=1e-6):
    """Agreement relative to the largest derivative of the column; of a list of derivatives, column by column."""
    for actual, index in zip(stretch.columns(name), range(2), strict=True):
        desired = np.stack([e[index] for e in expected], axis=2)
        assert actual.shape == desired.shape
        for c in range(actual.shape[2]):
            scale = np.abs(desired[:, :, c]).max()
            np.testing.assert_allclose(actual[:, :, c], desired[:, :, c], rtol=0.0, atol=rtol * scale, err_msg=name)


def test_columns_follow_each_other(stretch):
    """One slice for each parameter, in order and without gaps; those of a field only where there is one."""
    start = 0
    assert list(stretch.jacobian.columns) == list(COLUMNS)
    for name, width in COLUMNS.items():
        assert stretch.jacobian.columns[name] == slice(start, start + width)
        start += width
    assert stretch.jacobian.force.shape == (BINS, 3, start) and stretch.jacobian.rate_step.shape == (BINS - 1, 3, start)
    exact = prediction_jacobian(
        stretch.inputs, stretch.bins, stretch.residuals, stretch.uncertainty, stretch.units, None
    )
    assert list(exact.columns) == list(COLUMNS)[:-7]
    np.testing.assert_array_equal(exact.force, stretch.jacobian.force[:, :, :-9])


def test_position_and_velocity(stretch):
    """Of a constant displacement of the whole path."""

    def displaced(component):
        def at(change):
            nav = stretch.residuals.nodes.nav.copy()
            nav[:, component] += change
            return stretch.prediction(replace(stretch.residuals.nodes, nav=nav))

        return at

    expected = [stretch.derivative(displaced(j), 30.0) for j in range(3)]
    assert_columns(stretch, "position", expected, 1e-3)
    force = np.stack([e[0] for e in expected], axis=2)
    assert np.median(np.abs(stretch.columns("position")[0] - force)) < 2e-5 * np.abs(force).max()
    assert_columns(stretch, "velocity", [stretch.derivative(displaced(j), 0.02) for j in range(3, 6)])


def test_attitude(stretch):
    """Of a rotation about body axes, by rotation matrices of another package."""

    def rotated(axis):
        def at(change):
            nav = stretch.residuals.nodes.nav.copy()
            nav[:, 6:] = (Rotation.from_quat(nav[:, 6:]) * Rotation.from_rotvec(change * np.eye(3)[axis])).as_quat()
            return stretch.prediction(replace(stretch.residuals.nodes, nav=nav))

        return at

    assert_columns(stretch, "attitude", [stretch.derivative(rotated(j), 4e-6) for j in range(3)])


def test_air(stretch):
    """Density in its logarithm; winds towards east and north."""
    assert_columns(stretch, "density", [stretch.derivative(lambda s: stretch.prediction(density=s), 1e-3)], 5e-6)
    for name, direction in (("wind_east", [[1.0, 0.0]]), ("wind_north", [[0.0, 1.0]])):
        winds = np.array(direction)
        assert_columns(
            stretch, name, [stretch.derivative(lambda s, w=winds: stretch.prediction(wind=s * w), 0.02)], 1e-4
        )


def test_a_wind_is_the_opposite_of_a_velocity(stretch):
    """Towards east of the place of each bin: the loads depend on the velocity relative to the air."""
    half = NODES_PER_BIN // 2
    # a force in the middle of its bin, a step of the rate at the edge between two
    for index, places in ((0, slice(half, None, NODES_PER_BIN)), (1, slice(NODES_PER_BIN, -1, NODES_PER_BIN))):
        by_velocity, by_wind = stretch.columns("velocity")[index], stretch.columns("wind_east")[index]
        position = stretch.residuals.nodes.nav[places, :3]
        east = np.cross([0.0, 0.0, 1.0], position)
        east /= np.linalg.norm(east, axis=1, keepdims=True)
        expected = -np.einsum("bij,bj->bi", by_velocity, east)
        np.testing.assert_allclose(by_wind[:, :, 0], expected, rtol=0.0, atol=2e-4 * np.abs(by_velocity).max())


@pytest.mark.parametrize("name", ["ca", "cn", "cm"])
def test_coefficients_in_their_units(stretch, name):
    """One sigma of the numerical error added to a total coefficient; the loads are linear in it."""
    assert_columns(stretch, name, [stretch.derivative(lambda s: stretch.prediction(**{name: s}), 0.5)], 1e-7)


@pytest.mark.parametrize("name", ["ca", "cn", "cm", *ASYMMETRIES])
def test_amplitudes_of_the_discrepancy(stretch, name):
    """One column for each mode: a field in which this mode alone has an amplitude, the same at all times."""
    expected = []
    for j in range(stretch.field.modes[name].count):

        def at(change, j=j):
            amplitudes = {n: a.copy() for n, a in stretch.field.amplitudes.items()}
            amplitudes[name][0, j] = change
            return stretch.prediction(field=replace(stretch.field, amplitudes=amplitudes))

        expected.append(stretch.derivative(at, 0.5))
    assert_columns(stretch, f"field_{name}", expected, 1e-7)


@pytest.mark.parametrize("name", ["mass", "inertia"])
def test_mass_and_inertia(stretch, name):
    """The derivative with respect to the perturbation itself, about a point that has one."""
    assert_columns(stretch, name, [stretch.derivative(lambda s: stretch.prediction(**{name: s}), 1e-3)])
    force, step = stretch.columns(name)
    if name == "mass":
        np.testing.assert_array_equal(force[:, :, 0], -stretch.residuals.predicted_force)
        assert not step.any()
    else:
        assert not force.any() and step.any()


def test_rate(stretch):
    """Gyroscopic moment and damping; the gyroscopic part is quadratic, for which any step is right."""
    expected = [
        stretch.derivative(lambda s, axis=axis: stretch.prediction(rate_change=s * axis), 2e-3) for axis in np.eye(3)
    ]
    assert_columns(stretch, "rate", expected)


def test_nonlinearity_over_two_sigmas_of_density(stretch):
    """The second difference over two sigmas, and the sigma of the quadrature's error at right angles to it.

    The difference is that of the stated model: neither the effects nor the point change it.
    """
    without = replace(stretch.inputs.forward_model, effects=(), perturbation=None)
    stated = replace(stretch, inputs=replace(stretch.inputs, forward_model=without))
    denser, thinner, nominal = (
        stated.prediction(density=np.log1p(s * 2.0 * stretch.uncertainty.density)) for s in (1.0, -1.0, 0.0)
    )
    correction = stretch.residuals.quadrature_correction
    for row, error, stated in (
        (0, correction[0] / 15.0, stretch.jacobian.force_nonlinearity),
        (1, correction[1] / 15.0, stretch.jacobian.rate_step_nonlinearity),
    ):
        around = np.pad(np.abs(error), ((10, 10), (0, 0)), mode="symmetric")  # a sigma is at least the median
        median = np.array([np.median(around[b : b + 21], axis=0) for b in range(len(error))])
        second = denser[row] + thinner[row] - 2.0 * nominal[row]
        expected = np.hypot(second, np.maximum(np.abs(error), median))
        np.testing.assert_allclose(stated, expected, rtol=1e-6, atol=1e-12 if row == 0 else 1e-14)


@pytest.mark.parametrize("place", [0.1, 0.5, 0.9])
def test_an_abrupt_torque_has_the_uncertainty_of_its_time_between_two_nodes(flight, place):
    """A twelfth of the square of the nodes' distance, whose step of the rate two rows share."""
    s = stretch_of(flight, "peak", changed=False, smooth=False)
    model, middle = s.inputs.forward_model, BINS // 2
    begin = s.bins.edges[middle] + (np.floor(place * NODES_PER_BIN) + 0.5) / NODES_PER_BIN * s.bins.interval[middle]
    torque = EffectInstance(find_effect("remnant_torque"), {"Cm": 1e-3, "t0": float(begin)})

    def jacobian_with(effects):
        inputs = replace(s.inputs, forward_model=model.with_effects(effects))
        return inputs, prediction_jacobian(inputs, s.bins, s.residuals, s.uncertainty, s.units)

    inputs, with_torque = jacobian_with((torque,))
    added = np.sqrt(with_torque.rate_step_nonlinearity**2 - jacobian_with(())[1].rate_step_nonlinearity ** 2)[:, 1]
    flow = s.residuals.flow
    node = int(np.searchsorted(flow.time, begin))
    change = inputs.forward_model.angular_acceleration(flow.time, flow.rate, inputs.forward_model.loads(flow)[1])
    change -= model.angular_acceleration(flow.time, flow.rate, model.loads(flow)[1])
    resolution = s.bins.interval[middle] / NODES_PER_BIN / np.sqrt(12.0)
    assert np.sum(added) == pytest.approx(abs(change[node, 1]) * resolution, rel=0.35)  # Simpson's weights differ
    assert np.delete(added, [middle - 2, middle - 1, middle, middle + 1]).max() < 1e-3 * added.max()


def test_only_where_the_coefficients_depend_on_the_density_is_the_force_not_linear_in_it(flight):
    """In continuum flow the coefficients do not; in rarefied flow they do, by the Knudsen number."""
    departures = {}
    for where in PRESSURES:
        s = stretch_of(flight, where, changed=False, smooth=False)
        second = s.prediction(density=np.log(1.2))[0] + s.prediction(density=np.log(0.8))[0] - 2.0 * s.prediction()[0]
        departures[where] = np.abs(second).max() / np.abs(s.residuals.predicted_force).max()
        rarefied = s.residuals.flow.knudsen > s.inputs.forward_model.database.continuum_limit
        assert rarefied.all() if where == "rarefied" else not rarefied.any()
        if where == "rarefied":
            assert s.jacobian.force_nonlinearity.max() > 0.9 * np.abs(second).max()
    assert departures["rarefied"] > 1e-3 > 1e-10 > max(departures["hypersonic"], departures["peak"])


def test_no_derivative_is_taken_across_the_step_between_two_tables(flight):
    """Wherever the limit lies between two nodes: a node next to it would be in the other table after a step."""
    s = stretch_of(flight, "rarefied", changed=False, smooth=False)
    knudsen, model = s.residuals.flow.knudsen, s.inputs.forward_model
    node = (BINS // 2) * NODES_PER_BIN + 1
    assert knudsen[node] > knudsen[node + 1]  # the vehicle descends

    def jacobian_with_limit(limit):
        database = replace(model.database, continuum_limit=limit)
        inputs = replace(s.inputs, forward_model=replace(model, database=database))
        tables = inputs.forward_model.table_coefficients(s.residuals.flow)
        residuals = replace(s.residuals, tables=tables)
        return prediction_jacobian(inputs, s.bins, residuals, s.uncertainty, s.units), tables

    near, near_tables = jacobian_with_limit(knudsen[node] * (1.0 - 1e-5))
    between, tables = jacobian_with_limit(np.sqrt(knudsen[node] * knudsen[node + 1]))
    assert abs(tables.ca[node + 1] / tables.ca[node] - 1.0) > 0.01  # the step
    np.testing.assert_array_equal(tables.ca, near_tables.ca)
    for name in ("position", "velocity", "density", "wind_east", "wind_north"):
        part = near.columns[name]
        for a, b in ((near.force, between.force), (near.rate_step, between.rate_step)):
            # at the limit a coefficient is constant on the far side: half of its derivative at one node of a bin
            np.testing.assert_allclose(a[..., part], b[..., part], rtol=0.0, atol=0.03 * np.abs(b[..., part]).max())
    part, force = near.columns["density"], s.residuals.predicted_force
    np.testing.assert_allclose(near.force[:, 0, part.start], force[:, 0], rtol=0.3)  # the coefficient falls with it


def test_the_other_table_is_that_beyond_the_limit(flight):
    """By a limit above all Knudsen numbers, and by one below: in the stretch the rarefied table applies."""
    s = stretch_of(flight, "rarefied", changed=False, smooth=False)
    knudsen, model = s.residuals.flow.knudsen, s.inputs.forward_model
    limit = 0.9 * knudsen.min()

    def with_limit(value):
        return replace(model, database=replace(model.database, continuum_limit=value))

    inputs = replace(s.inputs, forward_model=with_limit(limit))
    jacobian = prediction_jacobian(inputs, s.bins, s.residuals, s.uncertainty, s.units)
    continuum, rarefied = (predict(with_limit(v), s.bins, s.residuals.flow) for v in (2.0 * knudsen.max(), limit))
    for actual, a, b in zip((jacobian.force_by_regime, jacobian.rate_step_by_regime), continuum, rarefied, strict=True):
        np.testing.assert_allclose(actual, a - b, rtol=1e-9, atol=1e-12 * np.abs(b).max())
    assert np.abs(jacobian.force_by_regime[:, 0]).min() > 1e-3 * np.abs(s.residuals.predicted_force[:, 0]).max()
    other = stretch_of(flight, "rarefied", changed=True, smooth=False)  # with effects, about another point
    database = replace(other.inputs.forward_model.database, continuum_limit=limit)
    inputs = replace(other.inputs, forward_model=replace(other.inputs.forward_model, database=database))
    about_point = prediction_jacobian(inputs, other.bins, other.residuals, other.uncertainty, other.units)
    np.testing.assert_array_equal(about_point.force_by_regime, jacobian.force_by_regime)
    np.testing.assert_array_equal(about_point.rate_step_by_regime, jacobian.rate_step_by_regime)
    joined = replace(s.inputs, forward_model=replace(model, database=replace(model.database, join="blend")))
    without = prediction_jacobian(joined, s.bins, s.residuals, s.uncertainty, s.units)
    assert not without.force_by_regime.any() and not without.rate_step_by_regime.any()
