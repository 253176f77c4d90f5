"""The shipped surrogate against the grid computed from it, and the published trim angles of Phoenix."""

import numpy as np
import pytest
from scipy.optimize import brentq

from edl_filter.aero.surrogate import X_REFERENCE, phoenix_surrogate
from edl_filter.aero.tables import read_table
from edl_filter.io.csv_table import package_data

#: Offset of 5 mm over Phoenix's diameter of 2.65 m.
OFFSET = 0.005 / 2.65


def trim_angle(table, mach, d_cm=0.0, z_over_d=0.0):
    """Largest angle, degrees, at which the moment about Phoenix's centre of mass is zero with a negative slope."""

    def moment(alpha):
        ca, cn, cm, _ = table.lookup(mach, alpha)
        return float(cm + X_REFERENCE * cn + z_over_d * ca + d_cm)

    angles = np.radians(np.arange(0.1, 10.0, 0.1))
    nose_up = [angle for angle in angles if moment(angle) > 0.0]
    return np.degrees(brentq(moment, nose_up[-1], nose_up[-1] + np.radians(0.11))) if nose_up else 0.0


def largest_trim_angle(table, **increments):
    return max(trim_angle(table, mach, **increments) for mach in np.arange(13.0, 22.01, 0.25))


@pytest.fixture(scope="module")
def grid():
    return read_table(package_data("mevad_continuum.csv"), "mach")


def test_grid_equals_the_surrogate_to_its_printed_digits(grid):
    ca, cn, cm, outside = phoenix_surrogate().lookup(grid.nodes[:, None], grid.alpha)
    assert ca.size == 910 and not outside.any()
    # Half a unit of the last digit, plus the rounding of the coefficients
    np.testing.assert_allclose(ca, grid.CA, atol=0.52e-4)
    np.testing.assert_allclose(cn, grid.CN, atol=0.52e-5)
    np.testing.assert_allclose(cm, grid.Cm, atol=0.52e-5)


def test_closed_form_at_a_node():
    s = np.sin(np.radians(7.0))
    ca, cn, cm, _ = phoenix_surrogate().lookup(5.0, np.radians(7.0))
    assert ca == pytest.approx(1.606733 - 1.573600 * s**2 - 0.010866 * np.exp(-((s / 0.115) ** 2)), abs=1e-12)
    assert cn == pytest.approx(s * (0.118496 + 0.379929 * s**2 + 0.039537 * np.exp(-((s / 0.080) ** 2))), abs=1e-12)
    at_cg = s * (-0.076984 - 0.281483 * s**2 - 0.015956 * np.exp(-((s / 0.110) ** 2)))
    assert cm == pytest.approx(at_cg - 0.253 * cn, abs=1e-12)


def test_values_beyond_the_edges_are_constant_and_flagged():
    table = phoenix_surrogate()
    *beyond, outside = table.lookup([0.1, 50.0, 10.0], [0.1, 0.1, 0.9])
    assert outside.all()
    np.testing.assert_array_equal(beyond, table.lookup([0.4, 30.0, 10.0], [0.1, 0.1, np.radians(25.0)])[:3])


def test_rows_equal_the_look_up():
    mach, alpha = np.array([1.1, 18.0, 29.0]), np.radians([0.0, 2.0, 11.0])
    ca, cn, cm, _ = phoenix_surrogate().lookup(mach[:, None], alpha)
    for w in ((1.0, -2.0, 3.0), (0.0, 0.253, 1.0)):
        np.testing.assert_allclose(
            phoenix_surrogate().at(mach).rows(alpha, w), w[0] * ca + w[1] * cn + w[2] * cm, rtol=0, atol=1e-14
        )


def test_trim_in_the_low_speed_instability(grid):
    assert largest_trim_angle(phoenix_surrogate()) == pytest.approx(1.87, abs=0.05)
    assert largest_trim_angle(grid) == pytest.approx(1.73, abs=0.05)


def test_published_trim_angles_from_the_published_nodes(mevad):
    nodes = read_table(mevad / "phoenix_nodes.csv", "mach", "pchip")
    assert largest_trim_angle(nodes) == pytest.approx(2.5, abs=0.1)
    assert largest_trim_angle(nodes, d_cm=0.002) == pytest.approx(4.2, abs=0.1)
    assert largest_trim_angle(nodes, z_over_d=OFFSET) == pytest.approx(4.8, abs=0.1)
    ca, cn, cm, _ = phoenix_surrogate().lookup(nodes.nodes[:, None], nodes.alpha)
    rms = [np.sqrt(np.mean((x - y) ** 2)) for x, y in ((ca, nodes.CA), (cn, nodes.CN), (cm, nodes.Cm))]
    assert rms[0] < 0.003 and rms[1] < 0.001 and rms[2] < 0.0006
