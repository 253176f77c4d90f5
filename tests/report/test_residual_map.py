"""The residual map as a figure, from plain data."""

from diagnoses import content
from matplotlib.colors import to_hex

from edl_filter.report.matplotlib_renderer import draw
from edl_filter.report.residual_map import cell_colours, residual_map


def test_the_heat_map_outlines_what_fails():
    diagnosis = content()
    left_axes, right_axes = draw(residual_map(diagnosis, "flight")).axes[:2]
    outlines = [[p for p in ax.patches if p.get_gid() == "outline"] for ax in (left_axes, right_axes)]
    assert len(outlines[0]) == sum(c["fails"] for c in diagnosis["map"]) and len(outlines[1]) == 0
    assert sorted(t.get_text() for t in right_axes.texts) == ["0.80"]
    assert {t.get_text() for t in left_axes.get_yticklabels()} == {"moment x", "moment y", "moment z"}
    cells = [p for p in left_axes.patches if p.get_gid() is None]
    assert to_hex(cells[0].get_facecolor()) == cell_colours(880.0, 880.0)[0]
