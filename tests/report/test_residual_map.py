"""The residual map as a figure, from plain data, and its colours."""

import numpy as np
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


def test_text_of_a_cell_is_readable_on_its_ground():
    def light(colour):
        parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        return float(np.where(parts > 0.04, ((parts + 0.055) / 1.055) ** 2.4, parts / 12.92) @ (0.2126, 0.7152, 0.0722))

    for rms in np.geomspace(0.1, 1000.0, 60):
        ground, ink = (light(c) for c in cell_colours(rms, 1000.0))
        assert (max(ground, ink) + 0.05) / (min(ground, ink) + 0.05) >= 4.5
