"""Figure and sentences about the increments of an aerodynamic database, from increments by hand."""

import numpy as np
import pytest

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.increments import DatabaseUpdate, RegimeUpdate
from edl_filter.report.colours import AXES
from edl_filter.report.database_update import (
    DECIDED,
    database_figure,
    discrepancy_sentence,
    figure_angles,
    nuisance_sentence,
    nuisance_text,
    update_sentence,
)
from edl_filter.report.description import Band, Curve, Line
from edl_filter.results.schema.diagnosis import (
    DatabaseUpdateContent,
    DiscrepancyContent,
    EstimatedQuantityContent,
    LargestIncrementContent,
    NuisanceContent,
)

#: Share of the prior variance that the data removed, by node: it crosses `DECIDED` twice.
SHARES = np.array([0.9, 0.501, 0.499, 0.2, 0.501, 0.8])
NAN = np.nan


def regime_of(regime="mach", shares=SHARES, flown=(1,), angles=4):
    """Increments 1, 2, … of CA, ten times these of CN, a hundred times of Cm, plus 0.1 of the angle's index."""
    nodes = len(shares)
    increment = np.array([1.0, 10.0, 100.0])[:, None, None] * (1.0 + np.arange(nodes))[None, :, None]
    increment = increment + 0.1 * np.arange(angles)
    prior_sigma = np.ones((3, nodes, angles))
    sigma = np.broadcast_to(np.sqrt(1.0 - shares)[None, :, None], prior_sigma.shape)
    bins = np.zeros((nodes, angles), int)
    bins[::2, list(flown)] = 3
    scale = 1.0 if regime == "mach" else 1e-3
    alpha = np.radians([0.0, 1.25, 2.5, 12.0, 16.0, 30.0, 45.0, 60.0][:angles])
    return RegimeUpdate(regime, scale * (2.0 + np.arange(nodes)), alpha, increment, sigma, prior_sigma, bins)


def update_of(*regimes):
    return DatabaseUpdate("MER", DiscrepancyPrior(), regimes, np.eye(sum(r.increment.size for r in regimes)))


def nuisance(name="mass", sigmas=2.5, value=0.1, unit="kg"):
    return NuisanceContent(name=name, sigmas=sigmas, value=value, unit=unit)


def discrepancy(at_bound=False, gain=12.34):
    quantity = EstimatedQuantityContent(stated=1.0, estimate=2.5, low=0.1, high=10.0, at_bound=at_bound)
    length = EstimatedQuantityContent(stated=6.0, estimate=4.25, low=1.0, high=30.0, at_bound=False)
    return DiscrepancyContent(gain=gain, quantities={"scale": quantity, "angle_length_deg": length})


def largest(mach=None, knudsen=None):
    return LargestIncrementContent(
        sigmas=-1.5, increment=-0.0123456, sigma=0.004, mach=mach, knudsen=knudsen, alpha_deg=4.0
    )


# --- figure ---------------------------------------------------------------------------------------------------------


def test_a_regime_is_a_column_and_a_coefficient_a_row():
    figure = database_figure(update_of(regime_of("mach"), regime_of("knudsen")), "MER-A")
    assert figure.title == "MER-A: increments of the database"
    assert [[p.x.label for p in row] for row in figure.rows] == [["Mach number", "Knudsen number"]] * 3
    assert [[p.y.text for p in row] for row in figure.rows] == [[f"Δ{s} (–)"] * 2 for s in ("CA", "CN", "Cm")]
    assert len(figure.heights) == 3 and figure.widths == (1.0, 1.0) and figure.shared_x


def test_the_axes_are_logarithmic_over_the_nodes_of_their_own_regime():
    figure = database_figure(update_of(regime_of("mach"), regime_of("knudsen")), "")
    for row in figure.rows:
        assert [p.x.scale for p in row] == ["log", "log"]
        assert [p.x.range for p in row] == [pytest.approx((2.0, 7.0)), pytest.approx((2e-3, 7e-3))]


@pytest.mark.parametrize(("regimes", "width"), [(("mach",), 9.0), (("mach", "knudsen"), 12.5)])
def test_one_legend_stands_beside_the_first_row(regimes, width):
    figure = database_figure(update_of(*map(regime_of, regimes)), "")
    assert figure.width == width
    assert [[p.legend is not None for p in row] for row in figure.rows] == [
        [k == len(regimes) - 1 for k in range(len(regimes))],
        *[[False] * len(regimes)] * 2,
    ]


def test_curves_are_coloured_from_the_share_at_which_data_decide_and_grey_between():
    """A segment has its colour if both of its ends are decided, and is grey otherwise."""
    assert DECIDED == 0.5
    panel = database_figure(update_of(regime_of()), "").rows[0][0]
    band, coloured, grey, flown, zero = panel.elements
    assert (type(band), type(zero)) == (Band, Line) and zero.position == 0.0
    np.testing.assert_allclose(coloured.y, [1.1, 2.1, NAN, NAN, 5.1, 6.1])
    np.testing.assert_allclose(grey.y, [NAN, 2.1, 3.1, 4.1, 5.1, NAN])  # it joins the coloured parts
    np.testing.assert_allclose(flown.y, [1.1, NAN, 3.1, NAN, 5.1, NAN])  # every second node
    assert (coloured.colour, grey.colour, flown.colour, band.colour) == ("blue", "muted", "blue", "blue-band")
    assert flown.symbol == "circle" and flown.width == 0.0 and coloured.width > 0.0
    assert coloured.label == band.curve == "1.25 deg" and grey.label == flown.label == ""


@pytest.mark.parametrize(("share", "parts"), [(0.9, (6, 0)), (0.1, (0, 6))])
def test_a_curve_that_is_decided_throughout_has_no_grey_part_and_vice_versa(share, parts):
    _, coloured, grey, *_ = database_figure(update_of(regime_of(shares=np.full(6, share))), "").rows[0][0].elements
    assert (np.isfinite(coloured.y).sum(), np.isfinite(grey.y).sum()) == parts


def test_bands_are_two_sigmas_of_the_coefficient_of_the_panel():
    rows = database_figure(update_of(regime_of()), "").rows
    sigma = np.sqrt(1.0 - SHARES)
    for panel, scale in zip((row[0] for row in rows), (1.0, 10.0, 100.0), strict=True):
        middle = scale * (1.0 + np.arange(6)) + 0.1
        np.testing.assert_allclose(panel.elements[0].low, middle - 2.0 * sigma)
        np.testing.assert_allclose(panel.elements[0].high, middle + 2.0 * sigma)


def test_each_angle_has_its_own_colour_and_label():
    panel = database_figure(update_of(regime_of(flown=(1, 2, 3))), "").rows[0][0]
    labelled = [e for e in panel.elements if isinstance(e, Curve) and e.label]
    assert [(c.label, c.colour) for c in labelled] == list(zip(("1.25 deg", "2.5 deg", "12 deg"), AXES, strict=True))
    np.testing.assert_allclose([c.y[0] for c in labelled], [1.1, 1.2, 1.3])


@pytest.mark.parametrize(
    ("flown", "angles"),
    [
        ((1, 2, 3), [1, 2, 3]),
        ((0, 1, 2, 3), [1, 2, 3]),  # not zero, where CN and Cm vanish
        ((0, 2, 3, 4, 5, 6), [2, 4, 6]),  # the first, the middle and the last
        ((1, 7), [1, 7]),  # and none between them
        ((5,), [5]),
        ((3, 4), [3, 4]),
        ((0,), [1]),  # the first angle that is not zero
        ((), [1]),
    ],
)
def test_angles_of_the_figure_are_flown_and_not_zero(flown, angles):
    np.testing.assert_array_equal(figure_angles(regime_of(flown=flown, angles=8)), angles)


# --- sentences ------------------------------------------------------------------------------------------------------


def test_nothing_learned_gives_empty_sentences():
    assert nuisance_sentence(()) == discrepancy_sentence(None) == update_sentence(None) == ""


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (nuisance(), "mass by 2.5 sigma (0.1 kg)"),
        (nuisance("wind_east", -3.0, -12.5, "m/s"), "wind towards east by -3 sigma (-12.5 m/s)"),
        (nuisance("wind_north", 2.25, 4.0, "m/s"), "wind towards north by 2.25 sigma (4 m/s)"),
        (nuisance("density_scale", 4.0, 0.0345, ""), "density scale by 4 sigma (+3.5 %)"),  # relative
        (nuisance("density_scale", 4.0, -0.0345, ""), "density scale by 4 sigma (-3.5 %)"),
        (nuisance("density_scale", 4.0, None, ""), "density scale by 4 sigma (–)"),
        (nuisance("database CA", 2.0, 0.0345, ""), "database CA by 2 sigma (0.0345)"),  # in units of the coefficient
        (nuisance("database Cm", 2.0, None, ""), "database Cm by 2 sigma (–)"),
        (nuisance("mass", None, None, "kg"), "mass by – sigma (–)"),
    ],
)
def test_a_shift_has_its_sigmas_and_unit(content, text):
    assert nuisance_text(content) == text


def test_all_shifts_are_one_sentence_in_their_order():
    shifts = (nuisance("wind_east", 3.0, 9.0, "m/s"), nuisance())
    assert nuisance_sentence(shifts) == (
        "Nuisance parameters beyond two sigmas of their stated values: wind towards east by 3 sigma (9 m/s), "
        "mass by 2.5 sigma (0.1 kg)."
    )


def test_only_the_estimate_at_its_bound_says_so():
    assert discrepancy_sentence(discrepancy(at_bound=True)).startswith(
        "Error of the database, by marginal likelihood: scale 2.5 (stated 1, at its bound), "
        "angle_length_deg 4.25 (stated 6); 12.3 nats above the stated values."
    )
    assert "bound" not in discrepancy_sentence(discrepancy())


def test_an_estimated_error_says_that_a_missing_effect_makes_it_larger():
    assert discrepancy_sentence(discrepancy()).endswith("values. An effect that is missing makes it larger, too.")


@pytest.mark.parametrize(
    ("place", "text"), [({"mach": 12.34}, "Mach 12.3"), ({"knudsen": 0.0012}, "Kn 0.0012"), ({"mach": 0.0}, "Mach 0")]
)
def test_the_place_of_an_increment_is_a_mach_or_knudsen_number(place, text):
    content = DatabaseUpdateContent(file="database_update.nc", cells=20, largest={"CA": largest(**place)})
    assert update_sentence(content) == (
        f"Estimated increments of the database: largest ΔCA -0.0123 ± 0.004 at {text} and 4 deg (-1.5 of its sigma)."
    )


def test_the_largest_increments_of_all_coefficients_are_one_sentence():
    increments = {"CA": largest(mach=5.0), "CN": largest(knudsen=0.1), "Cm": largest(mach=20.0)}
    parts = update_sentence(DatabaseUpdateContent(file="", cells=1, largest=increments)).split("; ")
    assert [p.split(" -")[0] for p in parts] == ["Estimated increments of the database: largest ΔCA", "ΔCN", "ΔCm"]
    assert ["Mach 5 " in parts[0], "Kn 0.1 " in parts[1], "Mach 20 " in parts[2]] == [True] * 3
