"""A doubted name's partner: what makes it one. Whole flights with two effects are in the study (`make study`)."""

from types import SimpleNamespace

import pytest

from edl_filter.diagnosis import together
from edl_filter.effects import Active
from edl_filter.effects.catalogue import effect_named
from edl_filter.effects.loading import find_effect

FITTED = (Active(effect_named("mass"), {"k": -0.07}),)


def hypothesis(at_floor, size, sigma):
    """A partner, and what is left of the first beside it."""
    refit = SimpleNamespace(parameters=lambda name: {"mass": {"k": (size, sigma)}}[name])
    return SimpleNamespace(name="wind", at_floor=at_floor, refit=refit)


@pytest.mark.parametrize(
    ("named", "at_floor", "size", "found"),
    [
        (True, True, -0.07, True),
        (False, True, -0.07, False),  # nothing is named about the model that has the first
        (True, False, -0.07, False),  # something is left that neither explains
        (True, True, -0.002, False),  # the partner explains it all, and the first was wrong
    ],
)
def test_a_partner_is_named_leaves_nothing_and_needs_the_first(monkeypatch, named, at_floor, size, found):
    begun, said = [], []
    second = hypothesis(at_floor, size, 1e-3)
    verdict = SimpleNamespace(leader=named or None, entries=[SimpleNamespace(hypothesis=second)])
    monkeypatch.setattr(together, "load_case", lambda mission, effects: begun.append((mission, effects)))
    monkeypatch.setattr(together, "rank", lambda held, candidates, progress: progress("trying"))
    monkeypatch.setattr(together, "judge", lambda _: verdict)
    first = SimpleNamespace(
        name="mass", active=FITTED[0], case=SimpleNamespace(mission="flight"), refit=SimpleNamespace(effects=FITTED)
    )
    assert together.partner_of(first, (), said.append) is (second if found else None)
    assert begun == [("flight", FITTED)] and said == ["with mass: trying"]


def test_another_of_the_firsts_kind_is_no_partner(monkeypatch):
    """Two of one kind may copy what neither is."""
    second = find_effect("wind_2")
    tried = []
    monkeypatch.setattr(together, "load_case", lambda mission, effects: None)
    monkeypatch.setattr(together, "rank", lambda held, candidates, progress: tried.extend(candidates))
    monkeypatch.setattr(together, "judge", lambda _: SimpleNamespace(leader=None, entries=[]))
    first = SimpleNamespace(
        name="wind_2",
        active=Active(second, {}),
        case=SimpleNamespace(mission="flight"),
        refit=SimpleNamespace(effects=()),
    )
    assert together.partner_of(first, [effect_named("wind"), effect_named("mass"), second], lambda _: None) is None
    assert [e.name for e in tried] == ["mass"]
