"""Three-sigma uncertainties of the thesis's tables, and their interpolation in Mach number."""

import numpy as np
import pytest

from edl_filter.aero.uncertainty import three_sigma
from edl_filter.errors import InputError


@pytest.mark.parametrize(
    ("family", "mach", "knudsen", "ca", "expected"),
    [
        ("MER", 20.0, 1e-5, 1.7, (0.05 * 1.7, 0.01, 0.003)),
        ("MER", 3.0, 1e-6, 1.6, (0.10 * 1.6, 0.01, 0.005)),
        ("Phoenix", 20.0, 1e-5, 1.7, (0.03 * 1.7, 0.01, 0.002)),
        ("Phoenix", 3.0, 1e-6, 1.6, (0.10 * 1.6, 0.01, 0.005)),
        ("Phoenix", 25.0, 1e-2, 1.9, (0.05 * 1.9, 0.01, 0.005)),
        ("MER", 25.0, 20.0, 2.1, (0.05 * 2.1, 0.01, 0.005)),
    ],
)
def test_tables_11_3_to_11_5(family, mach, knudsen, ca, expected):
    s = three_sigma(family, mach, knudsen, ca)
    np.testing.assert_allclose((s.ca, s.cn, s.cm), expected)
    assert s.cl == 1.24e-6


def test_linear_between_mach_5_and_10():
    s = three_sigma("Phoenix", np.array([5.0, 7.5, 10.0]), 1e-6, 1.0)
    np.testing.assert_allclose(s.ca, [0.10, 0.065, 0.03])
    np.testing.assert_allclose(s.cm, [0.005, 0.0035, 0.002])


def test_unknown_family_raises():
    with pytest.raises(InputError, match="no family 'Viking'; accepted are MER, Phoenix"):
        three_sigma("Viking", 5.0, 1e-5, 1.7)
