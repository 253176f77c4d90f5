"""Effects on gravity, against numbers worked out by hand."""

import numpy as np
from standins import PLANET, on

RADIUS = 3396190.0


def test_oblateness_at_the_equator_and_at_the_pole():
    """``g = mu/a² (1 + 3/2 J2)`` at the equator and ``mu/a² (1 - 3 J2)`` at the pole, at the radius a of J2."""
    effect, p = on("gravity_oblateness", J2=1e-3)
    places = RADIUS * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    change = np.linalg.norm(effect.gravity(p, PLANET).gravity(places), axis=1)
    change -= np.linalg.norm(PLANET.gravity(places), axis=1)
    # mu/a² = 4.28e13 / 3396190² = 3.7107339 m/s²; times 1.5e-3 and -3e-3
    np.testing.assert_allclose(change, [5.5661008e-3, -11.1322017e-3], rtol=1e-7)
