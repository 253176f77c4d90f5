"""Figures of a campaign: one panel for each group, what they contain, and that both renderers draw them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from edl_filter.report.campaign import campaign_figures
from edl_filter.report.description import Curve, Region
from edl_filter.report.matplotlib_renderer import draw, write_canvas
from edl_filter.results.campaign_statistics import statistics

sys.path.append(str(Path(__file__).parents[1] / "results"))
from test_campaign_statistics import CASES, dataset


@pytest.fixture(scope="module")
def figures():
    random = np.random.default_rng(1)
    probability = random.uniform(0.5, 1.0, CASES)
    data = dataset(
        leader_probability=("case", probability),
        leader_right=("case", (random.uniform(size=CASES) < probability).astype(float)),
        named=("case", np.ones(CASES)),
    )
    return campaign_figures(data, statistics(data), "t")


def test_every_figure_has_its_values(figures):
    assert set(figures) == {"landing_ellipses", "coverage", "event_percentiles", "reliability"}
    (panel,) = figures["landing_ellipses"].panels
    points = next(e for e in panel.elements if isinstance(e, Curve))
    outline = next(e for e in panel.elements if isinstance(e, Region))
    assert len(points.x) <= 4000 and points.label == "estimate"
    assert np.max(outline.x) == pytest.approx(2.4477 * 0.1, rel=0.06)  # km
    (panel,) = figures["coverage"].panels
    assert [e.label for e in panel.elements if isinstance(e, Curve)] == [f"within {k} sigma" for k in (1, 2, 3)]
    (panel,) = figures["event_percentiles"].panels
    assert panel.y.ticks is not None and panel.y.ticks[0][1].startswith("landing, time: ")


def test_figures_are_drawn(figures, tmp_path):
    for name, figure in figures.items():
        assert write_canvas(draw(figure), tmp_path / f"{name}.png").stat().st_size > 5000
