"""The study of closure: both tables of two flights, and the exit code."""

import sys

import closure as study


def test_two_flights_are_in_both_tables(monkeypatch, capsys):
    """With two flights a share of 95 % may be missed by any amount, so the study does not fail."""
    monkeypatch.setattr(sys, "argv", ["closure.py", "2"])
    assert study.main() == 0
    printed = capsys.readouterr().out
    assert "2 flights, the database's CA" in printed and "2 flights, CA drawn from its uncertainty" in printed
    assert all(printed.count(f"\n  {name} ") == 2 for name in study.QUANTITIES)


def test_too_small_a_share_is_the_exit_code(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["closure.py", "1024"])
    for share, code in ((0.96, 0), (0.9, 1)):
        monkeypatch.setattr(study, "shares", lambda *_, s=share: {"window": dict.fromkeys(study.QUANTITIES, s)})
        monkeypatch.setattr(study, "axial_sigma", lambda: None)
        assert study.main() == code
