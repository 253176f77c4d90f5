"""The residual map of a page: which cells fail, and the residual that is shown first."""

import re

import folders
import pytest
from pages import data, page, section


@pytest.mark.parametrize(("force", "landing", "first"), [(9.0, 20.0, 0), (1.0, 1.6, 1), (1.0, 1.0, 0)])
def test_the_first_residual_is_of_a_cell_that_fails(tmp_path, force, landing, first):
    """A constraint's where nothing else fails."""
    folders.complete_run(tmp_path)
    cells = [folders.map_cell("force_x", "Mach above 15", 20.0, 120.0, force)]
    cells.append(folders.map_cell("landing", "constraints", 300.0, 300.0, landing))
    folders.diagnosis(tmp_path, map=cells, where=[c for c in cells if c["fails"]])
    assert data(page(tmp_path))["residuals"]["first"] == first


def test_failing_cells_are_marked_by_more_than_colour(tmp_path):
    folders.complete_run(tmp_path)
    text = section(page(tmp_path), "where")
    cells = re.findall(r'<button type="button" class="cell( fails)?".*?</button>', text, re.S)
    assert len(cells) == 5 and sum(bool(c) for c in cells) == 2
    failing = re.search(r'class="cell fails".*?</button>', text, re.S).group(0)
    assert "▲" in failing and "It fails." in failing and "0.1 m/s²" in failing
