"""The measurement that would distinguish two effects, and its evidence."""

from types import SimpleNamespace

import numpy as np
import pytest
from linear_problems import from_dense

from edl_filter.diagnosis.linear_model.effect_jacobian import EffectJacobian
from edl_filter.diagnosis.selection import disambiguation
from edl_filter.diagnosis.selection.disambiguation import best_discriminator, candidate_measurements
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.estimation.kalman import LinearStateSpace, whitening_filter
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
        nuisance=SimpleNamespace(layout=Layout({}), slices={"mass": slice(0, 1), "density": slice(1, 2)}),
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
