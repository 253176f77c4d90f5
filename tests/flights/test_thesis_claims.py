"""docs/thesis-claims.md: every row computed from the two flights again, and what the agreements mean physically."""

import numpy as np
import pytest
from thesis_claims.claim import AGREES, CLAIMS, DIFFERS, OPEN, OPPORTUNITY, SPIRIT, about, at_most, positive, quantity
from thesis_claims.flight import THESIS_GAS, ClaimFlight
from thesis_claims.moments import coupling
from thesis_claims.page import MODULES, PAGE, computed_row, markdown, page_rows, same_to_the_digits


@pytest.fixture(scope="module")
def flights(spirit, opportunity):
    return {SPIRIT: ClaimFlight(spirit), OPPORTUNITY: ClaimFlight(opportunity)}


@pytest.fixture(scope="module")
def page():
    return page_rows(PAGE.read_text(encoding="utf-8"))


def test_the_page_has_every_claim_once(page):
    assert len(MODULES) == 6 and len(CLAIMS) > 150
    assert len({(c.statement, c.rover) for c in CLAIMS}) == len(CLAIMS)
    assert set(page) == {(c.statement, c.rover) for c in CLAIMS}, "run 'make thesis-claims'"


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.name}-{c.rover}")
def test_a_row_of_the_page_is_the_computed_one(claim, flights, page):
    computed, written = computed_row(claim, claim.finding(flights)), page[claim.statement, claim.rover]
    assert computed[1] == written[1], "run 'make thesis-claims'"
    for of_page, ours in zip(written, computed, strict=True):
        assert same_to_the_digits(of_page, ours), "run 'make thesis-claims'"


def test_the_counts_of_the_page_are_those_of_its_rows(page):
    text = PAGE.read_text(encoding="utf-8")
    for rover in (SPIRIT, OPPORTUNITY, "both"):
        verdicts = [row[1] for key, row in page.items() if key[1] == rover]
        assert f"| {rover} | " + " | ".join(str(verdicts.count(v)) for v in (AGREES, DIFFERS, OPEN)) + " |\n" in text
    assert "".join(markdown({}).splitlines()[:3]) in text.replace("\n", "")


def test_the_rule_of_the_verdict():
    assert [about(v, 0.5, 5.0, 0.1, "K").verdict for v in (5.1, 5.9, 6.2)] == [AGREES, AGREES, DIFFERS]
    assert about(1.0, 2.0, 5.0, 0.1, "K").verdict == OPEN  # zero is within two sigma as well
    assert [at_most(v, 0.5, 5.0, "K").verdict for v in (4.9, 5.9, 6.1)] == [AGREES, OPEN, DIFFERS]
    assert [positive(v, 0.5, "K").verdict for v in (1.1, 0.9, -0.9, -1.1)] == [AGREES, OPEN, OPEN, DIFFERS]


def test_numbers_as_text():
    assert quantity(5.39987, 0.00112, "km/s") == "5.3999 ± 0.0011 km/s"
    assert quantity(-4.93e-6, 7.7e-7) == "(-4.9 ± 0.8)e-6"
    assert quantity(0.04, 0.31, "°") == "0.0° ± 0.3°" and quantity(-0.01, 0.31, "°") == "0.0° ± 0.3°"
    assert quantity(27.4, 20.1, "%") == "27 ± 20 %" and quantity(6.83, 0.0, "%") == "6.8 %"
    assert quantity(0.0) == "0"
    assert same_to_the_digits("5.40 ± 0.01 km", "5.41 ± 0.01 km") and not same_to_the_digits("5.40 km", "5.42 km")
    assert not same_to_the_digits("5.40 km", "5.4 km") and not same_to_the_digits("5.40 km", "5.40 m")


def test_the_gas_is_the_thesiss(flights):
    """sqrt(1.3 R T), R of CO2 alone: 229.8 m/s at 215 K."""
    assert THESIS_GAS.speed_of_sound(215.0) == pytest.approx(np.sqrt(1.3 * 8314.46 / 44.01 * 215.0), rel=2e-4)
    f = flights[SPIRIT]
    a = f.post.flight.atmosphere
    sound = np.sqrt(1.3 * a.pressure / a.density)
    np.testing.assert_allclose((f.inputs.speed / sound)[a.valid], a.mach[a.valid], rtol=1e-9)


def test_rolling_moment_of_spirit_changes_its_sign(flights):
    """+5e-6 at 110–140 s and −5e-6 near 160 s, from the roll acceleration alone: I_xx dp/dt over q S D."""
    f = flights[SPIRIT]
    time, roll = f.roll
    pressure = f.post.flight.coefficients.dynamic_pressure
    for start, end, stated in ((110.0, 140.0, 5e-6), (155.0, 165.0, -5e-6)):
        inside = f.between(start, end)
        load = pressure[inside].mean() * np.pi / 4.0 * 2.65**3
        change = np.diff(np.interp((start, end), time, roll))[0] / (end - start)
        # 400 kg m² is an assumption with a sigma of 15 %
        assert 400.0 * change / load == pytest.approx(stated, rel=0.3)


def test_turns_about_the_sun_line(flights):
    """Without one the path is the dead-reckoned one; its end moves in proportion to a small turn."""
    for f in flights.values():
        t, stop = f.dead_reckoned.trajectory, f.event("parachute_deploy")
        k = int(np.searchsorted(t.time, stop - 1e-6))
        direct, again = f.arrival(t.time[k], t.position[k], t.velocity[k]), f.turned(0.0, "parachute_deploy")
        assert np.hypot(direct.east - again.east, direct.north - again.north) < 100.0
        assert abs(direct.speed - again.speed) < 0.5
        ends = [f.turned(angle, "parachute_deploy") for angle in (-0.5, 0.5)]
        assert ends[0].up + ends[1].up - 2.0 * again.up == pytest.approx(0.0, abs=0.1 * abs(ends[1].up - ends[0].up))


def test_the_torque_about_x_is_that_of_eulers_equation(flights):
    """Torque and factors of the products add up to the post-flight layer's moment for any products of inertia."""
    f = flights[OPPORTUNITY]
    torque, xy, xz = coupling(f, 150.0, f.end)
    inertia = f.inputs.inertia
    expected = torque - inertia[0, 1] * xy - inertia[0, 2] * xz  # tensor elements are minus the products
    m, inside = f.post.motion, f.between(150.0, f.end)
    _, q, r = m.rate[inside].T
    difference = m.moments.moment[inside, 0] - inertia[1, 2] * (q**2 - r**2) - expected
    assert np.max(np.abs(difference)) < 1e-9


def test_opportunitys_inversion_is_its_own(flights):
    """From 8 to 12 km its temperature rises, and more than Spirit's."""
    rise = {}
    for rover, f in flights.items():
        a = f.post.flight.atmosphere
        temperature = [np.nanmean(a.temperature[np.abs(a.altitude - h) < 1e3]) for h in (8e3, 12e3)]
        rise[rover] = temperature[1] - temperature[0]
    assert rise[OPPORTUNITY] > 5.0 and rise[OPPORTUNITY] > rise[SPIRIT] + 3.0
