"""Docstrings of packages: input, output, and every file in the order of reading, as in docs/architecture.md."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "src" / "edl_filter"
PACKAGES = [str(p.parent.relative_to(SOURCES)) for p in sorted(SOURCES.rglob("__init__.py")) if p.parent != SOURCES]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
#: Package → last column of its row; the packages of `diagnosis` stand without its name.
ROWS = dict(re.findall(r"^\| `([\w/]+)` \|.*\| ([^|]+) \|$", PAGE, re.MULTILINE))


def docstring(package):
    """What a package's docstring says before and in its order of reading."""
    text = ast.get_docstring(ast.parse((SOURCES / package / "__init__.py").read_text(encoding="utf-8")))
    return re.split(r"in\s+this\s+order", text, maxsplit=1)


def parts(package, packages=True):
    """Names of the files of a package, and of its sub-packages."""
    folder = SOURCES / package
    files = {p.stem for p in folder.glob("*.py")} - {"__init__"}
    return files | ({p.parent.name for p in folder.glob("*/__init__.py")} if packages else set())


def in_order(names, text):
    """Those of some names that a text has in backticks, in the order in which it mentions them first."""
    return sorted((n for n in names if f"`{n}`" in text), key=lambda n: text.index(f"`{n}`"))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_states_input_output_and_every_file(package):
    head, order = docstring(package)
    assert re.search(r"\bIn:\s", head) and re.search(r"\bOut:\s", head)
    assert set(in_order(parts(package), order)) == parts(package)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_page_has_the_files_of_a_package_in_the_same_order(package):
    row = ROWS[package.removeprefix("diagnosis/")]
    names = parts(package, packages=package != "diagnosis")  # each package of `diagnosis` has a row
    assert in_order(names, row) == in_order(names, docstring(package)[1])
    assert set(re.findall(r"`(\w+)`", row)) - {"__init__"} == names


def test_the_page_has_no_other_packages():
    assert set(ROWS) <= {p.removeprefix("diagnosis/") for p in PACKAGES}
