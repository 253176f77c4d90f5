"""The measurement that would distinguish two effects, and its evidence."""

from types import SimpleNamespace

import numpy as np
import pytest
from linear_problems import from_dense

from edl_filter.diagnosis.jacobians.nuisance import NuisanceLayout, checking_state
from edl_filter.diagnosis.linear_model.effect_jacobian import EffectJacobian
from edl_filter.diagnosis.linear_model.stated_parameters import (
    ImuAlignment,
    ImuClock,
    LearnedIncrements,
    StatedParameter,
    stated_parameters,
)
from edl_filter.diagnosis.selection import disambiguation
from edl_filter.diagnosis.selection.disambiguation import (
    CONSTANT_KNOWLEDGE,
    best_discriminator,
    candidate_measurements,
)
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.mission import Mission
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.navigation.layout import Layout

COUNT = 40


def constructed_model():
    """One row a step; the first state, the mass, is a constant in the rows, the second, the density, a slope."""
    design = np.column_stack((np.ones(COUNT), np.linspace(-1.0, 1.0, COUNT)))
    process_noise = np.zeros((COUNT, 2, 2))
    process_noise[:, 1, 1] = 1e-4
    state_space = LinearStateSpace(
        from_dense(np.zeros((COUNT, 2, 2))), from_dense(process_noise), np.arange(COUNT + 1), design,
        np.full((COUNT, 1), 0.01), np.diag([100.0, 100.0]),
    )  # fmt: skip
    problem = SimpleNamespace(constraints=(SimpleNamespace(name="landing"),))
    return SimpleNamespace(
        fitted_noise_filter=whitening_filter(state_space),
        case=SimpleNamespace(constants=()),
        nuisance=NuisanceLayout(Layout({}), {"mass": slice(0, 1), "density": slice(1, 2)}, size=2, fields={}),
        inputs=SimpleNamespace(problem=problem),
        index=SimpleNamespace(constraint_rows=(slice(COUNT - 1, COUNT),)),
        settings=DecisionSettings(),
    )


def test_candidates_are_what_is_uncertain_and_the_constraints():
    names = [name for name, _ in candidate_measurements(constructed_model())]
    assert names == ["knowing the air's density", "knowing the mass", "a constraint landing 10 times better"]


def two_effects(monkeypatch, first, second, names=("density_scale", "axial_force_scale")):
    """Two effects, each with as many sizes as it has given columns ``(R,)`` or ``(R, k)``: 1, 0.5, ..."""
    columns = {name: c.reshape(COUNT, -1) for name, c in zip(names, (first, second), strict=True)}

    def effect_jacobian(_, instance):
        rows, sizes = columns[instance.name], tuple(q.name for q in instance.effect.sizes)
        return EffectJacobian(instance, sizes, np.ones(len(sizes)), rows, np.zeros((2, len(sizes))))

    monkeypatch.setattr(disambiguation, "effect_jacobian", effect_jacobian)
    effects = [find_effect(name) for name in names]
    return [EffectInstance(e, {q.name: 1.0 / (k + 1) for k, q in enumerate(e.sizes)}) for e in effects]


def covariance_of_the_slope():
    """Covariance ``(R, R)`` of the rows of `constructed_model` with the mass known and the density uncertain."""
    slope, k = np.linspace(-1.0, 1.0, COUNT), np.arange(COUNT) + 1.0
    return slope[:, None] * slope * (100.0 + 1e-4 * np.minimum(k[:, None], k)) + 0.01 * np.eye(COUNT)


def test_the_best_measurement_is_of_the_state_that_absorbs_the_difference(monkeypatch):
    """The columns differ by a constant, as the mass does; the evidence is that of the dense Gaussian."""
    common = np.sin(np.arange(COUNT))
    pair = two_effects(monkeypatch, common, common + 0.3)
    discriminator = best_discriminator(constructed_model(), *pair)
    assert discriminator.measurement == "knowing the mass"
    columns = np.column_stack((common, common + 0.3))
    a, b = np.linalg.solve(np.linalg.cholesky(covariance_of_the_slope()), columns).T
    distinct = [0.5 * (x @ x - (x @ y) ** 2 / (y @ y)) for x, y in ((a, b), (b, a))]
    assert discriminator.evidence == pytest.approx(min(distinct), rel=1e-9)


@pytest.mark.parametrize("exchanged", [False, True])
def test_effects_of_several_sizes_are_distinguished_at_their_values(monkeypatch, exchanged):
    """One effect of one size, one of two: that of one size lies nearer to the other's plane than conversely."""
    time = np.arange(COUNT)
    single, double = np.sin(time) + 0.3, np.column_stack((np.sin(time), np.cos(time)))
    columns = {"density_scale": single, "wind": double}
    names = tuple(columns)[::-1] if exchanged else tuple(columns)
    pair = two_effects(monkeypatch, *(columns[name] for name in names), names)
    discriminator = best_discriminator(constructed_model(), *pair)
    assert discriminator.measurement == "knowing the mass"
    root = np.linalg.cholesky(covariance_of_the_slope())
    a, b = np.linalg.solve(root, single), np.linalg.solve(root, double)
    plane, _ = np.linalg.qr(b)
    first, second = a, b @ [1.0, 0.5]
    rest = first - plane @ (plane.T @ first), second - a * (a @ second) / (a @ a)
    assert discriminator.evidence == pytest.approx(min(0.5 * r @ r for r in rest), rel=1e-6)


def test_there_is_none_for_proportional_columns(monkeypatch):
    common = np.sin(np.arange(COUNT))
    assert best_discriminator(constructed_model(), *two_effects(monkeypatch, common, 2.0 * common)) is None


def test_every_constant_that_a_mission_can_state_can_be_known(spirit):
    """Of the vehicle, the database and each IMU; increments that another flight gives are stated with a covariance."""
    discrepancy = "aerodynamics.discrepancy"
    inertia = "{xx: 270.0, yy: 205.0, zz: 210.0, xy: 0.0, xz: 0.0, yz: 0.0, xy_sigma: 0.5, xz_sigma: 0.5, yz_sigma: 2}"
    changes = ["vehicle.centre_of_mass_sigma=[0.002, 0.002, 0.001]", f"vehicle.inertia={inertia}"]
    changes += [f"{discrepancy}.{name}_sigma=1e-6" for name in ("asymmetry", "rolling", "damping")]
    for imu in spirit.mission.telemetry.imus:
        sigma = ("position_sigma=0.01", "alignment_sigma_deg=0.1", "clock_sigma_s=0.002")
        changes += [f"telemetry.imus.{imu}.{value}" for value in sigma]
    stated = stated_parameters(Mission.load("builtin:mer_a", changes), spirit.telemetry)
    known = [name for names in CONSTANT_KNOWLEDGE.values() for name in names]
    assert len(known) == len(set(known))
    assert {s.instance.name for s in stated} | {LearnedIncrements.name} == set(known)


# --- fields, constants and checking IMUs ----------------------------------------------------------------------------

FIELD_VALUES, FIELD_DERIVATIVES = [4, 5], [6, 7]
#: What could be known → its states in `model_with_all_kinds`: numerical errors of ca, its field and the asymmetry
#: belong to the coefficients; the last two states, after all constants, are the colour of the noise.
STATES = {
    "the air's density": [1],
    "the mass": [0],
    "the coefficients, by a database without error": [2, *FIELD_VALUES, *FIELD_DERIVATIVES, 11],
    "the errors of the checking IMUs": [3, 8],
    "the centre of mass": [9, 10],
    "the places of the IMUs": [12],
    "the alignment of the IMUs": [13],
    "the clocks of the IMUs": [14],
}
SIZE = 15 + 2
STEP = 0.2


def constant(effect, *names, imu=None):
    return StatedParameter(EffectInstance(effect, {}, imu), dict.fromkeys(names, 1.0))


def dense_model():
    """Increment ``(n, n)``, process noise ``(n, n)`` and design ``(R, n)``; a field's derivatives change its values.

    A random walk of the derivatives, of the first checking IMU's error and of the colour. The prior sigma is 10.
    """
    increment, noise = np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
    increment[FIELD_VALUES, FIELD_DERIVATIVES] = STEP
    for state in (*FIELD_DERIVATIVES, 3, SIZE - 1):
        noise[state, state] = 1e-3
    design = np.random.default_rng(7).normal(size=(COUNT, SIZE))
    design[:, FIELD_DERIVATIVES] = 0.0
    return increment, noise, design


def model_with_all_kinds():
    """One row a step; errors of ca and of two checking IMUs, a field of two amplitudes, constants and a colour."""
    increment, noise, design = dense_model()
    state_space = LinearStateSpace(
        from_dense(np.tile(increment, (COUNT, 1, 1))), from_dense(np.tile(noise, (COUNT, 1, 1))),
        np.arange(COUNT + 1), design, np.full((COUNT, 1), 0.01), 100.0 * np.eye(SIZE),
    )  # fmt: skip
    slices = {
        "mass": slice(0, 1), "density": slice(1, 2), "ca": slice(2, 3),
        checking_state(0, 1, "accelerometer_bias"): slice(3, 4), checking_state(1, 0, "gyro_scale"): slice(8, 9),
    }  # fmt: skip
    constants = (
        constant(find_effect("com_offset"), "dx", "dz"),
        constant(find_effect("rolling_moment"), "c"),
        constant(find_effect("imu_lever_arm"), "dy", imu="secondary"),
        constant(ImuAlignment(), "mx", imu="secondary"),
        constant(ImuClock(), "tau", imu="secondary"),
    )
    model = constructed_model()
    model.fitted_noise_filter = whitening_filter(state_space)
    model.nuisance = NuisanceLayout(Layout({}), slices, size=9, fields={"ca": slice(4, 6)})
    model.case = SimpleNamespace(constants=constants)
    return model


def covariance_without(states):
    """Covariance ``(R, R)`` of the rows of `model_with_all_kinds` whose model does not have these states at all."""
    increment, noise, design = dense_model()
    kept = np.setdiff1d(np.arange(SIZE), states)
    transition, noise = np.eye(len(kept)) + increment[np.ix_(kept, kept)], noise[np.ix_(kept, kept)]
    design, state = design[:, kept], 100.0 * np.eye(len(kept))
    out = 0.01 * np.eye(COUNT)
    for k in range(COUNT):
        state = transition @ state @ transition.T + noise
        later = state
        for i in range(k, COUNT):
            value = design[i] @ later @ design[k]
            out[i, k] += value
            out[k, i] += value if i > k else 0.0
            later = transition @ later
    return out


def test_every_state_of_the_model_but_its_colour_can_be_known():
    candidates = candidate_measurements(model_with_all_kinds())
    assert [name for name, _ in candidates] == [
        *(f"knowing {what}" for what in STATES),
        "a constraint landing 10 times better",
    ]
    for (_, apply), states in zip(candidates, STATES.values(), strict=False):
        known = apply(model_with_all_kinds().fitted_noise_filter.model)
        assert np.flatnonzero(np.diag(known.initial_covariance) == 0.0).tolist() == sorted(states)


@pytest.mark.parametrize(
    ("absorbing", "what"),
    [
        (2, "the coefficients, by a database without error"),
        (FIELD_VALUES[0], "the coefficients, by a database without error"),
        (FIELD_VALUES[1], "the coefficients, by a database without error"),
        (3, "the errors of the checking IMUs"),
        (8, "the errors of the checking IMUs"),
        (9, "the centre of mass"),
        (10, "the centre of mass"),
        (11, "the coefficients, by a database without error"),
        (12, "the places of the IMUs"),
        (13, "the alignment of the IMUs"),
        (14, "the clocks of the IMUs"),
    ],
)
def test_the_knowledge_of_a_kind_of_error_distinguishes_what_that_error_absorbs(monkeypatch, absorbing, what):
    """The columns differ as this state does in the rows; the evidence is that of the dense Gaussian without the states.

    Of a field that includes its derivatives and their noise, and the other errors of the coefficients.
    """
    model, common = model_with_all_kinds(), np.sin(np.arange(COUNT))
    columns = np.column_stack((common, common + 0.3 * model.fitted_noise_filter.model.design[:, absorbing]))
    discriminator = best_discriminator(model, *two_effects(monkeypatch, *columns.T))
    assert discriminator.measurement == f"knowing {what}"
    a, b = np.linalg.solve(np.linalg.cholesky(covariance_without(STATES[what])), columns).T
    distinct = [0.5 * (x @ x - (x @ y) ** 2 / (y @ y)) for x, y in ((a, b), (b, a))]
    assert discriminator.evidence == pytest.approx(min(distinct), rel=1e-6)


@pytest.mark.parametrize("what", list(STATES))
def test_one_effect_is_distinguished_from_none_by_the_evidence_of_its_estimate(monkeypatch, what):
    """An effect of two sizes, as a state and little else in the rows: half the squares of all that it explains."""
    model = model_with_all_kinds()
    absorbing = model.fitted_noise_filter.model.design[:, STATES[what][0]]
    columns = 0.3 * np.column_stack((absorbing, 0.1 * np.cos(np.arange(COUNT))))
    effect, _ = two_effects(monkeypatch, columns, np.ones(COUNT), ("wind", "mass"))
    discriminator = best_discriminator(model, effect)
    assert discriminator.measurement == f"knowing {what}"
    white = np.linalg.solve(np.linalg.cholesky(covariance_without(STATES[what])), columns @ [1.0, 0.5])
    assert discriminator.evidence == pytest.approx(0.5 * white @ white, rel=1e-6)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_an_effect_needs_the_evidence_that_separates_two_names(monkeypatch, share):
    """With the best measurement; with less, no measurement is named."""
    model, required = model_with_all_kinds(), DecisionSettings().separable_gain_nats
    column = model.fitted_noise_filter.model.design[:, 9]
    white = np.linalg.solve(np.linalg.cholesky(covariance_without(STATES["the centre of mass"])), column)
    size = np.sqrt(share * required / (0.5 * white @ white))
    effect, _ = two_effects(monkeypatch, size * column, np.ones(COUNT))
    discriminator = best_discriminator(model, effect)
    assert (discriminator is None) == (share < 1.0)
    assert discriminator is None or discriminator.evidence == pytest.approx(share * required, rel=1e-6)


def test_a_measurement_that_adds_no_evidence_distinguishes_nothing(monkeypatch):
    """A column that no uncertain state absorbs, without a part in the constraint, has all its evidence already."""
    column = 0.1 * (-1.0) ** np.arange(COUNT)
    column[-2:] = 0.0
    effect, _ = two_effects(monkeypatch, column, column)
    model = constructed_model()
    present = model.fitted_noise_filter(column[:, None], np.zeros((2, 1)))
    assert 0.5 * np.sum(present**2) > 2.0 * model.settings.separable_gain_nats
    assert best_discriminator(model, effect) is None
