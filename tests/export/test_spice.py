"""SPK and CK kernels, read back by SPICE."""

import sys

import numpy as np
import pytest
import spiceypy

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.export import export
from edl_filter.export.spice import ephemeris_time


def test_leap_seconds_and_the_periodic_term():
    utc = np.array(["2000-01-01T12:00:00", "2004-01-04T04:19:51.932", "2008-05-25T23:46:00"], "datetime64[us]")
    # spiceypy.str2et with naif0012.tls
    np.testing.assert_allclose(ephemeris_time(utc)[:1], [64.183927284], atol=1e-6)
    offset = ephemeris_time(utc) - (utc - utc[0]) / np.timedelta64(1, "s")
    np.testing.assert_allclose(offset, [64.184, 64.184, 65.184], atol=2e-3)


@pytest.fixture
def spice():
    spiceypy.kclear()
    yield spiceypy
    spiceypy.kclear()


def test_spk_and_ck_read_back(result, spirit, spice, tmp_path):
    spk = export(result, "spk", tmp_path / "a.bsp")
    ck = export(result, "ck", tmp_path / "b.bc")
    for path in (spk[0], *ck):
        spice.furnsh(str(path))
    t, j2000_from_inertial = spirit.trajectory, spirit.mission.planet.j2000_from_inertial_matrix
    for k in (1, 1234, len(t.time) - 2):
        utc = str(np.datetime64(spirit.telemetry.epoch_utc, "ns") + np.timedelta64(round(t.time[k] * 1e9), "ns"))
        et = spice.utc2et(utc)
        state, _ = spice.spkezr("-254", et, "J2000", "NONE", "MARS")
        np.testing.assert_allclose(1e3 * state[:3], j2000_from_inertial @ t.position[k], atol=0.02)
        np.testing.assert_allclose(1e3 * state[3:], j2000_from_inertial @ t.velocity[k], atol=2e-3)
        ticks = spice.sce2c(-254, et)
        assert ticks / 256.0 == pytest.approx(126462085.4 + t.time[k], abs=1e-5)
        matrix, rate, _ = spice.ckgpav(-254000, ticks, 1.0, "J2000")
        j2000_from_body = j2000_from_inertial @ rotations.to_matrix(t.inertial_from_body[k])
        np.testing.assert_allclose(matrix.T, j2000_from_body, atol=1e-5)
        np.testing.assert_allclose(rate, j2000_from_body @ t.angular_rate[k], atol=1e-3)


def test_attitudes_and_rates_are_consistent(result, spice, tmp_path):
    """The sign of SPICE's angular velocity: a C-matrix rotates by minus the rate in its own axes."""
    for path in export(result, "ck", tmp_path / "b.bc"):
        spice.furnsh(str(path))
    ticks = 256.0 * (126462085.4 + 30.0)
    before, rate, _ = spice.ckgpav(-254000, ticks, 0.0, "J2000")
    after, _, _ = spice.ckgpav(-254000, ticks + 256.0, 0.0, "J2000")
    axis, angle = spice.raxisa(after.T @ before)
    np.testing.assert_allclose(axis * angle, rate, atol=0.05 * np.linalg.norm(rate))


def test_comments_contain_utc_and_clock(result, spice, tmp_path):
    for fmt in ("spk", "ck"):
        path, clock, _ = export(result, fmt, tmp_path / f"x.{fmt}")
        handle = spice.dafopr(str(path))
        _, lines, _ = spice.dafec(handle, 20)
        spice.dafcls(handle)
        for text in ("\n".join(lines), clock.read_text()):
            assert "2004-01-04T04:19:51.932" in text and "126462085.4" in text


def test_result_without_an_orientation_in_j2000_raises(practice_result, tmp_path):
    with pytest.raises(InputError, match=r"planet\.j2000_from_inertial"):
        export(practice_result, "spk", tmp_path / "a.bsp")
    assert list(tmp_path.iterdir()) == []


def test_missing_spiceypy_raises(practice_result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "spiceypy", None)
    with pytest.raises(InputError, match=r"pip install 'edl-filter\[spice\]'"):
        export(practice_result, "ck", tmp_path / "a.bc")
