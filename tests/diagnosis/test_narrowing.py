"""Places narrowed down: to where the evidence is greatest, and never beyond their bounds."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import narrowing
from edl_filter.effects.catalogue import effect_named
from edl_filter.effects.effect import Active

LINEAR = SimpleNamespace(
    white=lambda whiten: np.zeros(3), ground=None, bins=SimpleNamespace(edges=np.array([0.0, 250.0]))
)


def best_of(monkeypatch, effect, begun, evidence):
    """Where an effect comes to if `evidence` (of its values) is all that counts."""

    def signature(ground, active):
        names = [q.name for q in active.effect.sizes]
        return SimpleNamespace(active=active, names=names, sigma=None, rows=active.values, start=None)

    monkeypatch.setattr(narrowing, "signature", signature)
    monkeypatch.setattr(narrowing, "regress", lambda y, x, s: SimpleNamespace(gain=evidence(x), size=np.array([1e-3])))
    return narrowing.narrowed(LINEAR, Active(effect_named(effect), begun), lambda rows, start: rows).values


@pytest.mark.parametrize(("begun", "peak", "found"), [(18.0, 17.3, 17.3), (26.0, 28.0, 26.0), (10.0, 3.0, 10.0)])
def test_mach_number_of_most_evidence_inside_its_bounds(monkeypatch, begun, peak, found):
    values = best_of(monkeypatch, "static_instability", {"M0": begun}, lambda v: -((v["M0"] - peak) ** 2))
    assert values["M0"] == pytest.approx(found, abs=0.2) and values["a"] == 1e-3


def test_an_effect_without_a_place_stays_as_it_is():
    active = Active(effect_named("mass"), {})
    assert narrowing.narrowed(LINEAR, active, None) is active
