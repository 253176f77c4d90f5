import numpy as np
import pytest

from edl_filter.aero.ballistic_range import DragModel, effective_drag, fit_drag, rms_angle
from edl_filter.aero.surrogate import phoenix_surrogate


def test_mean_drag_of_a_swing_is_the_drag_at_the_rms_angle():
    t = np.linspace(0.0, 3.0, 3001)
    alpha = 0.15 * np.abs(np.sin(2.0 * np.pi * t))
    model = DragModel(1.6, -2.0)
    assert rms_angle(t, alpha) == pytest.approx(0.15 / np.sqrt(2.0), rel=1e-6)
    assert np.mean(model(alpha[:-1])) == pytest.approx(model(rms_angle(t, alpha)), abs=1e-6)


def test_fit_returns_the_model():
    alpha = np.radians([2.0, 5.0, 8.0, 12.0])
    assert fit_drag(alpha, DragModel(1.52, -1.9)(alpha)) == pytest.approx((1.52, -1.9))


def test_effective_drag_is_along_the_flow():
    alpha = np.radians(9.0)
    ca, cn, _, _ = phoenix_surrogate().lookup(2.0, alpha)
    assert effective_drag(phoenix_surrogate(), 2.0, alpha) == pytest.approx(ca * np.cos(alpha) + cn * np.sin(alpha))
