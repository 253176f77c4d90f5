"""Averages over windows, and their verdicts."""

from dataclasses import replace

import pytest
from model_flights import flight

from edl_filter.postflight.averages import METHODS
from edl_filter.postflight.derive import derive
from edl_filter.postflight.windows import Window


def test_averages_and_verdicts():
    clean, wrong = derive(flight()), derive(flight(added_cn=0.05))
    assert len(clean.flight.differences) == (3 * 4 + 1) * len(clean.windows)
    assert len(clean.preflight.differences) == (3 * 4 + 2) * len(clean.windows)
    for row in clean.flight.differences:
        if row.pair == "IMU-gyros" or row.pair == "IMU-accels":
            assert abs(row.mean) < 5 * row.mean_sigma + 1e-5
            assert row.percent == pytest.approx(100 * row.mean / row.three_sigma)
    assert all(v.within for v in clean.verdicts if v.coefficient != "Cl")
    # four planes and Cl with the flight's density, CA with the preflight one; each sentence has its rms
    judged = {(v.coefficient, v.density) for v in clean.verdicts}
    assert judged == {*((c, "flight") for c in (*METHODS, "Cl")), ("CA", "preflight")}
    assert all(f"(rms {v.rms:.2g})" in v.sentence for v in clean.verdicts)
    # an added normal force rotates with the lateral flow, so it shows little in window means and fully in the rms
    rows = [r for r in wrong.flight.differences if r.pair == "IMU-accels"]
    assert all(r.rms > 0.03 for r in rows)
    wide = [v for v in clean.verdicts if v.wide]
    assert wide and all(v.ratio >= 10 and "times what this flight supports" in v.sentence for v in wide)
    stated = derive(replace(flight(), windows=(Window("mine", 100.0, 120.0),)))
    assert {r.window for r in stated.flight.differences} == {"mine"}
