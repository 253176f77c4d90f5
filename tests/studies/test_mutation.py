"""Mutants of small files, and their outcomes under tests that miss one of them."""

import ast
import subprocess
import sys
from pathlib import Path

import mutation
import numba
import pytest


def changes(source):
    """Original and mutated text of every mutant."""
    return [(m.original, m.mutated) for m in mutation.mutants(source.encode())]


@pytest.mark.parametrize(
    ("source", "mutated"),
    [
        ("x = a < b", ["(a <= b)", "(a >= b)"]),
        ("x = a is None", ["(a is not None)"]),
        ("x = a - b", ["(a + b)"]),
        ("x = a and b", ["(a or b)"]),
        ("x = not a", ["(a)"]),
        ("x = -a", ["(a)"]),
        ("x = 3", ["(4)", "(2)"]),
        ("x = 0.0", ["(1.0)"]),
        ("x = 1.5", ["(3.0)"]),
        ("x = True", ["(False)"]),
        ("x = min(a)", ["(max(a))"]),
        ("x = np.argmax(a)", ["(np.argmin(a))"]),
        ("x = b if a else c", ["(b if not a else c)"]),
        ("x = b if a < d else c", ["(a <= d)", "(a >= d)"]),
        ("x += a", ["pass", "x -= a"]),
        ("x[i] = a", ["pass"]),
        ("x = a", []),
        ("f(a)", ["pass"]),
        ("if a:\n    b = c", ["(not (a))"]),
        ("def f(a=1):\n    return a", ["return None", "(2)", "(0)"]),
        ("def f():\n    return None", []),
        ("for a in b:\n    break", ["pass"]),
        ('@decorate(flag=True)\ndef f(a: Literal[1]) -> Literal[2]:\n    """Text 3."""\n    x: Literal[4] = a', []),
        ('x = f"{a - b}", "text"', []),
        ("x = zip(a, b, strict=True)", []),
    ],
)
def test_mutants_of_one_statement(source, mutated):
    assert sorted(m for _, m in changes(source)) == sorted(mutated)


def test_a_mutant_changes_its_place_only():
    """Also behind characters of several bytes, and within an expression."""
    source = "σ = 'é'; x = (a + b) * 2\ny = σ\n".encode()
    texts = {m.apply(source).decode() for m in mutation.mutants(source)}
    assert texts == {
        f"σ = 'é'; x = {e}\ny = σ\n" for e in ("((a - b)) * 2", "((a + b) / 2)", "(a + b) * (3)", "(a + b) * (1)")
    }


def test_all_mutants_of_this_file_are_valid_programs():
    source = Path(__file__).read_bytes()
    every = mutation.mutants(source)
    assert len(every) > 20
    for m in every:
        assert ast.dump(ast.parse(m.apply(source))) != ast.dump(ast.parse(source))


def test_modules_that_import_a_file_are_read_again(tmp_path):
    package = tmp_path / "edl_filter"
    (package / "part").mkdir(parents=True)
    files = {
        "__init__": "",
        "a": "",
        "c": "def f():\n    import edl_filter.part.b",
        "d": "from edl_filter import a",
        "e": "from edl_filter import c as a",
        "other": "import math",
        "part/__init__": "",
        "part/b": "from edl_filter.a import f",
    }
    for name, text in files.items():
        (package / f"{name}.py").write_text(text)
    assert mutation.dependents(tmp_path, "a.py") == {
        "edl_filter.a", "edl_filter.part.b", "edl_filter.c", "edl_filter.d", "edl_filter.e"
    }  # fmt: skip


def test_kernels_of_some_modules_are_interpreted(monkeypatch):
    """In both forms of the decorator; those of all further modules are compiled."""
    monkeypatch.setattr(numba, "njit", numba.njit)  # put back at the end
    mutation.interpret({"changed"})

    def kernel(x):
        return x + 1

    kernel.__module__ = "changed"
    assert numba.njit(kernel) is kernel
    assert numba.njit(nogil=True, error_model="numpy")(kernel) is kernel
    kernel.__module__ = "unchanged"
    for compiled in (numba.njit(kernel), numba.njit(nogil=True)(kernel)):
        assert compiled.py_func is kernel
        assert compiled(1) == 2


LIMITS = '''"""Limits."""
from edl_filter.step import STEP

def steps(value, limit):
    count = 0
    while value > limit:
        value -= STEP
        count += 1
    return count
'''
TEST = """from edl_filter.limits import steps

def test_steps():
    assert steps(3, 1) == 2
    assert steps(0, 1) == 0
"""
DRIVER = """import sys
from pathlib import Path
import mutation
mutation.ROOT, mutation.TESTS, mutation.TIME_MARGIN = Path(sys.argv[1]), {"limits.py": ("test_limits.py",)}, 1.0
mutation.mutate_file("limits.py", Path(sys.argv[1], "results.jsonl"), 100, 0)
"""


@pytest.mark.slow
def test_outcomes_are_those_of_the_tests(tmp_path):
    """Every change of a sum of steps fails, or does not end; the sources stay as they are."""
    files = {
        "src/edl_filter/__init__.py": "",
        "src/edl_filter/limits.py": LIMITS,
        "src/edl_filter/step.py": "STEP = 1",
        "tests/test_limits.py": TEST,
        "pytest.ini": "[pytest]\nmarkers =\n  slow\n  effects\n  browser\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    command = [sys.executable, "-c", DRIVER, str(tmp_path)]
    studies = str(Path(mutation.__file__).parent)
    subprocess.run(command, check=True, cwd=studies, stdout=subprocess.DEVNULL)
    assert {name: (tmp_path / name).read_text() for name in files} == files
    outcome = {m.mutated: o for (_, m), o in mutation.outcomes(tmp_path / "results.jsonl").items()}
    assert outcome == {
        "(1)": "killed", "(-1)": "killed", "(value >= limit)": "killed", "(value <= limit)": "killed",
        "value += STEP": "timeout", "pass": "killed", "count -= 1": "killed", "(2)": "killed", "(0)": "killed",
        "return None": "killed",
    }  # fmt: skip
    before = (tmp_path / "results.jsonl").read_text()
    subprocess.run(command, check=True, cwd=studies, stdout=subprocess.DEVNULL)
    assert (tmp_path / "results.jsonl").read_text() == before  # nothing is repeated
