"""What would part two names: less noise and known errors, and the nats that they are worth."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import separating
from edl_filter.diagnosis.separating import better, known, parting, remedies
from edl_filter.diagnosis.signatures import Signature
from edl_filter.diagnosis.sparse import dense
from edl_filter.diagnosis.whitening import Steps, whitener
from edl_filter.effects import Active
from edl_filter.effects.catalogue import effect_named
from edl_filter.navigation.layout import Layout

COUNT = 40


def flight():
    """One row a step; the first unknown, the mass, hides a constant, the second, the density, a slope."""
    design = np.column_stack((np.ones(COUNT), np.linspace(-1.0, 1.0, COUNT)))
    noise = np.zeros((COUNT, 2, 2))
    noise[:, 1, 1] = 1e-4
    steps = Steps(
        dense(np.zeros((COUNT, 2, 2))), dense(noise), np.arange(COUNT + 1), design, np.full((COUNT, 1), 0.01),
        np.diag([100.0, 100.0]),
    )  # fmt: skip
    problem = SimpleNamespace(constraints=(SimpleNamespace(name="landing"),))
    return SimpleNamespace(
        soft=whitener(steps),
        unknowns=SimpleNamespace(layout=Layout({}), slices={"mass": slice(0, 1), "density": slice(1, 2)}),
        ground=SimpleNamespace(
            setup=SimpleNamespace(problem=problem),
            order=SimpleNamespace(constraint_rows=(slice(COUNT - 1, COUNT),)),
        ),
    )


def test_known_unknowns_are_without_variance_from_beginning_to_end():
    steps = flight().soft.steps
    without = known(steps, [1])
    assert without.start[1, 1] == 0.0 and without.start[0, 0] == 100.0
    assert not without.noise.values.any() and steps.noise.values.any()


def test_better_rows_have_a_tenth_of_the_sigma():
    steps = flight().soft.steps
    np.testing.assert_allclose(better(steps, np.array([3])).row_noise[2:5, 0], [0.01, 1e-4, 0.01])


def test_a_flight_offers_what_it_leaves_unknown():
    names = [name for name, _ in remedies(flight())]
    assert names == ["knowing the air's density", "knowing the mass", "a constraint landing 10 times better"]


def made(monkeypatch, one, other):
    """Two effects of one size each with given columns."""
    columns = {"density_scale": one, "axial_force_scale": other}

    def signature(_, active):
        rows = columns[active.name][:, None]
        return Signature(active, ("k",), np.ones(1), rows, np.zeros((2, 1)))

    monkeypatch.setattr(separating, "signature", signature)
    return [Active(effect_named(n), {"k": 1.0}) for n in columns]


def test_the_unknown_that_hides_the_difference_is_named(monkeypatch):
    common = np.sin(np.arange(COUNT))
    pair = made(monkeypatch, common, common + 0.3)
    found = parting(flight(), *pair)
    assert found.remedy == "knowing the mass"
    # the density alone still hides something: its error at every row as one Gaussian
    slope, k = np.linspace(-1.0, 1.0, COUNT), np.arange(COUNT) + 1.0
    covariance = slope[:, None] * slope * (100.0 + 1e-4 * np.minimum(k[:, None], k)) + 0.01 * np.eye(COUNT)
    a, b = np.linalg.solve(np.linalg.cholesky(covariance), np.column_stack((common, common + 0.3))).T
    beyond = [0.5 * (x @ x - (x @ y) ** 2 / (y @ y)) for x, y in ((a, b), (b, a))]
    assert found.evidence == pytest.approx(min(beyond), rel=1e-9)


def test_what_nothing_parts_is_said_to_be_so(monkeypatch):
    common = np.sin(np.arange(COUNT))
    assert parting(flight(), *made(monkeypatch, common, 2.0 * common)) is None
