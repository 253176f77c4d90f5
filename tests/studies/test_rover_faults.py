"""The study of faults in the rovers' telemetry."""

import numpy as np
import pytest
import rover_faults as study

from edl_filter import Mission
from edl_filter.pipeline.load import mer_setup
from edl_filter.telemetry.mer_archive import read_mer_tables


@pytest.mark.parametrize("unit", study.UNITS)
def test_a_fault_is_in_the_increments_of_one_imu_from_its_time_on(unit, mer_folder):
    tables, epoch = read_mer_tables(mer_folder, 2), mer_setup(Mission.load("builtin:mer_a")).epoch_sclk
    faulty = study.with_fault(tables, epoch, unit, "zeros", 130.0, [0, 0])
    for name in study.UNITS:
        for quantity in ("velocity", "angle"):
            values, before = (getattr(t.highrate, f"{name}_{quantity}_increment") for t in (faulty, tables))
            changed = np.flatnonzero(np.any(~np.isclose(values, before, rtol=1e-12, atol=0.0, equal_nan=True), axis=1))
            if name != unit:
                assert not len(changed)
            else:
                np.testing.assert_array_equal(values[changed], 0.0)
                assert len(changed) == 16 and 0.0 <= tables.highrate.sclk[changed[0]] - epoch - 130.0 < 0.2


def test_a_fault_of_the_accelerations_is_in_their_table(mer_folder):
    tables, epoch = read_mer_tables(mer_folder, 2), mer_setup(Mission.load("builtin:mer_a")).epoch_sclk
    faulty = study.with_fault(tables, epoch, study.ACCELERATIONS, "zeros", 60.0, [0, 2])
    assert faulty.highrate is tables.highrate
    values, before = (t.transformed.backshell_acceleration for t in (faulty, tables))
    changed = np.flatnonzero(np.any(values != before, axis=1) & np.isfinite(before[:, 0]))
    np.testing.assert_array_equal(values[changed], 0.0)
    assert 0.0 <= tables.transformed.sclk[changed[0]] - epoch - 60.0 < 0.3


def test_answers(capsys):
    base = {
        "flight": "mer_a", "unit": "rover", "time_s": 100.0, "position_m": 1.0, "velocity_m_s": 0.1, "headline": "Why."
    }  # fmt: skip
    rows = [
        base | {"fault": "zeros", "trustworthy": True, "square": 1.0},
        base | {"fault": "zeros", "trustworthy": True, "square": 60.0},
        base | {"fault": "rate bias", "trustworthy": False, "square": 1.0},
        {"flight": "mer_a", "unit": "rover", "time_s": 100.0, "fault": "rate bias", "refused": "No flight."},
        base | {"unit": "TRANSFORMED", "fault": "zeros", "trustworthy": True, "square": 1.0},
    ]
    assert [study.answer(row) for row in rows] == ["right", "lost", "flagged", "refused", "right"]
    study.report(rows)
    printed = capsys.readouterr().out
    assert "| of a stretch of HIGHRATE | 2 | 1 | 0 | 0 | 1 |" in printed
    assert "| of HIGHRATE that last to the end | 2 | 0 | 1 | 1 | 0 |" in printed
    assert "| of a stretch of TRANSFORMED | 1 | 1 | 0 | 0 | 0 |" in printed
    assert "rate bias at 100 s: refused, No flight." in printed
