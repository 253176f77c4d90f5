"""Atmosphere and coefficients of the real flights and of a clean simulated one."""

import numpy as np
import pytest

from edl_filter.postflight.airdata import air_data
from edl_filter.postflight.flight import derive_flight
from edl_filter.postflight.windows import _envelope_peak

# Density times CA at altitudes (km), kg/m³: dead-reckoned and fitted elsewhere, the same telemetry, no database
KNOWN = {
    "spirit": {
        100: 6.397e-7, 90: 1.994e-6, 80: 7.000e-6, 70: 2.420e-5, 60: 7.787e-5, 50: 2.338e-4, 40: 6.378e-4,
        30: 1.576e-3, 20: 3.697e-3, 15: 5.827e-3, 10: 9.046e-3, 8: 1.063e-2,
    },
    "opportunity": {
        100: 2.892e-7, 90: 8.235e-7, 80: 4.574e-6, 70: 1.713e-5, 60: 5.274e-5, 50: 1.837e-4, 40: 5.628e-4,
        30: 1.581e-3, 20: 3.844e-3, 15: 5.562e-3, 10: 8.683e-3, 8: 1.079e-2,
    },
}  # fmt: skip


def derived(flight):
    air = air_data(flight.trajectory, flight.planet, flight.atmosphere)
    return derive_flight(flight, air)


@pytest.fixture(scope="module")
def flights(spirit, opportunity):
    return {"spirit": derived(spirit), "opportunity": derived(opportunity)}


def product_at(flight, altitude):
    """Density times CA at an altitude (km): a parabola through its logarithm over two kilometres on either side.

    One batch at 100 km has 8 % of noise alone, more than the 5 % that are asked for.
    """
    above = flight.altitude - altitude * 1e3
    near = (np.abs(above) < 2e3) & np.isfinite(flight.density) & (flight.density > 0.0)
    return np.exp(np.polyfit(above[near], np.log((flight.density * flight.ca)[near]), 2)[-1])


@pytest.mark.parametrize("rover", KNOWN)
def test_density_is_the_known_one(rover, flights):
    for altitude, product in KNOWN[rover].items():
        assert product_at(flights[rover].flight.atmosphere, altitude) == pytest.approx(product, rel=0.05), altitude


def test_opportunitys_density_at_100_km_is_within_its_own_sigmas(flights):
    d = flights["opportunity"].flight.atmosphere
    k = int(np.flatnonzero(d.altitude < 100e3)[0])
    assert abs(d.density[k] * d.ca[k] / 2.892e-7 - 1.0) < 2.0 * d.density_sigma[k] / d.density[k]


def test_rolling_moment_has_the_known_size_and_sign(flights):
    for rover, torque in (("spirit", 5e-6), ("opportunity", -1.5e-6)):
        d = flights[rover]
        part = (d.time > 110.0) & (d.time < 140.0)
        assert np.nanmean(d.flight.coefficients.value["Cl"][part]) == pytest.approx(torque, rel=0.1)


def test_instabilities_are_where_they_were_seen(flights):
    """Near 75 and 125 s for Spirit; of Opportunity only the second."""
    marks = flights["spirit"].regimes
    assert marks.first.start < 75.0 < marks.first.end
    assert marks.second.start < 126.0 < marks.second.end
    assert flights["opportunity"].regimes.first is None
    assert flights["opportunity"].regimes.second.start < 125.0 < flights["opportunity"].regimes.second.end


def mean_angle(d, start, end):
    """Mean alpha_total over a span, deg."""
    return np.degrees(d.alpha_total[(d.time > start) & (d.time < end)].mean())


def test_the_second_instability_is_visible_in_alpha_total(flights):
    """Without the database: both rovers' mean angle has a peak near 125 s, twice what it was 20 s before."""
    for rover, before, within in (("spirit", 1.44, 3.25), ("opportunity", 1.52, 3.10)):
        d = flights[rover]
        between = (d.flight.atmosphere.mach <= 22.0) & (d.flight.atmosphere.mach > 12.0)
        assert _envelope_peak(d.time, d.alpha_total, between) == pytest.approx(125.0, abs=5.0), rover
        assert mean_angle(d, 95.0, 105.0) == pytest.approx(before, abs=0.1), rover
        assert mean_angle(d, 115.0, 125.0) == pytest.approx(within, abs=0.1), rover


def swing(d, name):
    """How far a flight coefficient swings for one of the database from Mach 5 to the parachute: slope between them."""
    inside = d.windows[-1].mask(d.time)
    database, flown = d.flight.database_measured.value[name][inside], d.flight.coefficients.value[name][inside]
    both = np.isfinite(database) & np.isfinite(flown)
    database, flown = database[both] - database[both].mean(), flown[both] - flown[both].mean()
    return (flown @ database) / (database @ database)


def test_late_swings_against_the_database(flights, practice_06):
    """What docs/validation.md says does not agree, and that a clean flight has nothing of it."""
    clean = derived(practice_06)
    for forces, moments, d in ((1.44, 1.12, flights["spirit"]), (1.77, 1.18, flights["opportunity"]), (1, 1, clean)):
        assert d.windows[-1].name == "Mach 5 to parachute"
        for name in ("CN", "CY"):
            assert swing(d, name) == pytest.approx(forces, abs=0.06), name
        for name in ("Cm", "Cn"):
            assert swing(d, name) == pytest.approx(moments, abs=0.03), name


def test_validation_domain_begins_where_the_thesis_begins_it(flights):
    assert flights["spirit"].domain.start == pytest.approx(10.0, abs=3.0)
    assert flights["spirit"].domain.useful == pytest.approx(50.0, abs=5.0)


def test_mean_force_coefficient_differences_are_inside_the_databases_3_sigma(flights):
    for d in flights.values():
        means = [x.mean for x in d.flight.differences if x.pair == "IMU-accels" and x.coefficient in ("CN", "CY")]
        assert len(means) >= 8
        assert np.max(np.abs(means)) < 0.01


def test_force_and_moment_angles_disagree_by_less_than_the_thesis_says(flights):
    """The thesis finds 2.5 deg in the last 20 s; with the proxy database it is half that."""
    for d in flights.values():
        last = d.time > d.domain.end - 20.0
        for values in (d.flight.angles.alpha_between, d.flight.angles.beta_between):
            assert np.sqrt(np.nanmean(np.degrees(values[last]) ** 2)) < 2.5


def test_a_clean_flight_closes(practice_06):
    """Its own database and nothing hidden: coefficients within 3 sigma, density within its band of the true 1 %."""
    d = derived(practice_06)
    for window in d.windows:
        part = window.mask(d.time)
        for name in ("CN", "CY", "Cm", "Cn"):
            miss = d.flight.coefficients.value[name] - d.flight.database_measured.value[name]
            z = (miss / np.hypot(d.flight.coefficients.sigma(name), d.flight.database.angle_sigma[name]))[part]
            z = z[np.isfinite(z)]
            assert np.mean(np.abs(z) < 3.0) > 0.95, (window.name, name)
            assert np.mean(np.abs(z) < 2.0) > 0.90, (window.name, name)
    good = d.flight.atmosphere.valid & (d.time > d.domain.useful)
    relative = d.flight.atmosphere.density / d.preflight.atmosphere.density - 1.0
    z = relative[good] / np.hypot(d.flight.atmosphere.density_sigma / d.flight.atmosphere.density, 0.01)[good]
    assert np.mean(np.abs(z) < 2.0) > 0.95
    part = (d.time > 110.0) & (d.time < 140.0)
    assert abs(np.nanmean(d.flight.coefficients.value["Cl"][part])) < 2e-8
