"""The notebooks as a reader runs them: from top to bottom in a fresh kernel, without outputs in the repository."""

import ast
import re
import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
ROVERS = ("1_spirit_entry", "2_atmosphere_and_mevad", "5_opportunity_blanket_torque")


def named(name):
    return pytest.param(FOLDER / f"{name}.ipynb", id=name)


def read(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    return notebook


def codes(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def execute(path, tmp_path):
    """Run a copy of the notebook beside copies of the Python files that it reads."""
    for helper in FOLDER.glob("*.py"):
        shutil.copy(helper, tmp_path)
    notebook = read(path)
    NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    return notebook


def pictures(notebook):
    return sum("image/png" in o.get("data", {}) for cell in codes(notebook) for o in cell.outputs)


def last_words(notebook):
    """What the last cell of code printed."""
    return "".join(o.text for o in codes(notebook)[-1].outputs if o.output_type == "stream" and o.name == "stdout")


def requested_figures(notebook):
    """Number of figures that the code asks for."""
    return sum(bool(re.search(r"\.plot\.\w+\(|subplots\(", cell.source)) for cell in codes(notebook))


def test_there_are_five():
    assert [p.stem[0] for p in NOTEBOOKS] == list("12345")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
class TestAsKept:
    def test_there_are_no_outputs(self, path):
        for cell in codes(read(path)):
            assert cell.outputs == [] and cell.execution_count is None, cell.source

    def test_ids_are_stable(self, path):
        ids = [cell.id for cell in read(path).cells]
        assert ids == [f"n{path.stem[0]}-{k:02d}" for k in range(len(ids))]

    def test_no_helper_code_hides_in_it(self, path):
        kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)
        definitions = [
            node
            for cell in codes(read(path))
            for node in ast.parse(cell.source).body
            if any(isinstance(inner, kinds) for inner in ast.walk(node))
        ]
        if path.stem.startswith("4"):
            (effect,) = definitions
            assert isinstance(effect, ast.ClassDef) and effect.bases[0].id == "Effect"
        else:
            assert definitions == []

    def test_text_explains_the_code(self, path):
        cells = read(path).cells
        assert cells[0].cell_type == "markdown" and cells[0].source.startswith(f"# {path.stem[0]} · ")
        runs = "".join("c" if c.cell_type == "code" else "m" for c in cells).split("m")
        assert max(map(len, runs)) <= 2  # never three cells of code without a word

    def test_its_links_lead_somewhere(self, path):
        for cell in read(path).cells:
            for target in re.findall(r"\]\(([^)#:]+)\)", cell.source) if cell.cell_type == "markdown" else ():
                assert (FOLDER / target).is_file(), target


@pytest.mark.notebook
@pytest.mark.parametrize("path", [named(n) for n in ROVERS])
def test_it_runs_on_the_rovers_telemetry(path, tmp_path, monkeypatch):
    monkeypatch.delenv("EDL_FILTER_DATA", raising=False)
    notebook = execute(path, tmp_path)
    assert pictures(notebook) == requested_figures(notebook) > 4


@pytest.mark.notebook
def test_the_hidden_effect_is_found_and_the_error_falls_to_the_noise(tmp_path):
    notebook = execute(FOLDER / "3_find_the_hidden_effect.ipynb", tmp_path)
    assert pictures(notebook) == requested_figures(notebook) > 3
    printed = re.fullmatch(
        r"verdict: clean; worst normalised RMS of forces and moments: ([\d.]+)\n", last_words(notebook)
    )
    assert printed and 0.9 < float(printed[1]) < 1.1
    assert any("Missing: accelerometer_misalignment" in str(c.outputs) for c in codes(notebook))


@pytest.mark.notebook
def test_ones_own_effect_is_named_after_the_verdict_was_unknown(tmp_path):
    notebook = execute(FOLDER / "4_write_your_own_effect.ipynb", tmp_path)
    assert pictures(notebook) == requested_figures(notebook) > 3
    printed = re.fullmatch(
        r"named: leaking_thruster; verdict: clean; worst normalised RMS of forces and moments: ([\d.]+)\n",
        last_words(notebook),
    )
    assert printed and 0.9 < float(printed[1]) < 1.1
    description = next(o.text for c in codes(notebook) if "remainder.description" in c.source for o in c.outputs)
    oscillation = re.match(r"moment_y from (\d+) to (\d+) s: .*it oscillates at ([\d.]+) Hz", description)
    assert (
        abs(int(oscillation[1]) - 70) < 5
        and abs(int(oscillation[2]) - 170) < 5
        and abs(float(oscillation[3]) - 0.8) < 0.01
    )
