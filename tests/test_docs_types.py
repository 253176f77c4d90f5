"""The Python examples of the documentation are type-checked against the package."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def blocks():
    """Name of a module → Python code of a block in a page."""
    code_blocks = {}
    for page in PAGES:
        for k, code in enumerate(re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)):
            code_blocks[f"{re.sub(r'[^a-z]', '_', page.stem.lower())}_{k}"] = code
    return code_blocks


def check(folder, modules):
    """Output and exit code of mypy on modules that are written into a folder.

    With the options and the cache of ``make types`` the package is not analysed a second time, which takes 25 s.
    """
    for name, code in modules.items():
        (folder / f"{name}.py").write_text(code)
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml")]
    command += [str(folder / f"{name}.py") for name in modules]
    environment = os.environ | {"MYPYPATH": str(ROOT / "src")}
    process = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    return process.stdout + process.stderr, process.returncode


@pytest.mark.slow
def test_python_examples_have_no_type_errors(tmp_path):
    examples = blocks()
    assert len(examples) >= 7
    wrong = "from edl_filter import Mission, reconstruct\nreconstruct(Mission.load('m')).to_xarry()\n"
    modules = examples | {"with_an_error": wrong}
    output, code = check(tmp_path, modules)
    # errors in the package are those of make types; the cache may name the folder of an earlier run
    errors = [line for line in output.splitlines() if ": error:" in line and Path(line.split(":")[0]).stem in modules]
    assert code == 1 and len(errors) == 1, output
    assert 'with_an_error.py:2: error: "Result" has no attribute "to_xarry"' in errors[0]
