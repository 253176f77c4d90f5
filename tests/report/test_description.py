"""Descriptions: labels, ranges and gaps."""

import numpy as np
import pytest

from edl_filter.report.description import Axis, Figure, Panel, bounds, ellipse_outline, significant


def test_an_axis_has_its_unit_in_the_text():
    assert (Axis("altitude", "km").text, Axis("uncertainty").text) == ("altitude (km)", "uncertainty")


def test_bounds_ignore_a_share_of_the_samples_and_nan():
    values = np.concatenate((np.linspace(0.0, 1.0, 1000), [900.0, np.nan]))
    low, high = bounds([values, np.array([-2.0])], outside=0.01, margin=0.5)
    assert (low, high) == pytest.approx((-2.0 - 1.5, 0.99 + 1.5), abs=0.01)
    assert bounds([np.full(3, np.nan)]) == (-1.0, 1.0)
    low, high = bounds([np.zeros(5)])
    assert low < 0.0 < high


def test_values_with_a_large_sigma_are_gaps():
    values, sigma = np.array([1.0, -1.0, 1.0]), np.array([0.05, 0.05, 0.2])
    np.testing.assert_array_equal(significant(values, sigma, 0.1), [1.0, -1.0, np.nan])
    assert significant(values, None, 0.1) is values


def test_an_ellipse_is_at_the_same_number_of_sigmas_all_around():
    centre, covariance = np.array([1.0, -2.0]), np.array([[4.0, 1.5], [1.5, 1.0]])
    offset = ellipse_outline(centre, covariance, 3.0) - centre[:, None]
    np.testing.assert_allclose(np.sum(offset * np.linalg.solve(covariance, offset), axis=0), 9.0, rtol=1e-12)
    np.testing.assert_allclose(offset[:, 0], offset[:, -1], atol=1e-12)


def test_panels_of_a_figure_row_by_row():
    panels = [Panel(Axis(str(k)), Axis(), ()) for k in range(3)]
    figure = Figure("title", ((panels[0], panels[1]), (panels[2],)), (1.0, 1.0), (1.0, 1.0))
    assert [panel.x.label for panel in figure.panels] == ["0", "1", "2"]
