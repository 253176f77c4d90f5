"""Docstrings: a function that takes or returns arrays states their shapes."""

import ast
import re
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "src" / "edl_filter"
ARRAYS = {"Array", "BoolArray", "IntArray"}
#: Classes whose methods are overridden: their docstrings state the shapes, and an override says what it computes.
INTERFACES = {"effects/base.py": "Effect", "navigation/constraints.py": "Constraint"}
#: ``(N, 3)``, ``(m,)``, ``(10 or 14, S)``, ``(2n + 1, m)``, or ``(...)`` for any shape.
SHAPE = re.compile(r"\((?:[\w*.+− -]+(?:\([^()]*\))?,)+[\w*.+− -]*\)|\(\.\.\.\)")


def takes_arrays(function):
    """Whether an annotation of a function names an array type."""
    annotations = [function.returns, *(a.annotation for a in ast.walk(function.args) if isinstance(a, ast.arg))]
    names = [node for a in annotations if a is not None for node in ast.walk(a) if isinstance(node, ast.Name)]
    return any(node.id in ARRAYS for node in names)


def is_compiled(function):
    """Whether numba compiles a function, which has no annotations."""
    return any(re.search(r"\bnjit\b|^COMPILED$", ast.unparse(d)) for d in function.decorator_list)


def public_functions(body):
    """Public functions, and public methods of public classes, of a module's or class's body."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def docstring(function):
    return ast.get_docstring(function) or ""


def interface_methods():
    """Names of the methods of the interfaces that take or return arrays."""
    names = set()
    for path, name in INTERFACES.items():
        body = ast.parse((SOURCES / path).read_text()).body
        methods = next(node.body for node in body if isinstance(node, ast.ClassDef) and node.name == name)
        names |= {m.name for m in public_functions(methods) if takes_arrays(m) and SHAPE.search(docstring(m))}
    return names


OVERRIDDEN = interface_methods()
FUNCTIONS = [
    (str(path.relative_to(SOURCES)), function)
    for path in sorted(SOURCES.rglob("*.py"))
    for function in public_functions(ast.parse(path.read_text()).body)
]


def test_the_interfaces_state_the_shapes_of_what_is_overridden():
    assert {"imu", "corrected", "density", "wind", "force_moment", "measured", "noise", "predict"} <= OVERRIDDEN


def test_functions_of_arrays_state_their_shapes():
    functions = [f for f in FUNCTIONS if takes_arrays(f[1]) and f[1].name not in OVERRIDDEN]
    assert len(functions) > 400
    assert [f"{path}: {f.name}" for path, f in functions if not SHAPE.search(docstring(f))] == []


def test_compiled_functions_state_shapes_or_parameters():
    functions = [f for f in FUNCTIONS if is_compiled(f[1])]
    assert len(functions) > 30
    stated = re.compile(rf"{SHAPE.pattern}|^Parameters\n---", re.MULTILINE)
    assert [f"{path}: {f.name}" for path, f in functions if not stated.search(docstring(f))] == []


@pytest.mark.parametrize("text", ["``(N, 3)``", "(m,)", "(10 or 14, S)", "(2n + 1, m)", "(M (A − 1), K)", "(...)"])
def test_shapes_are_recognised(text):
    assert SHAPE.search(text)


@pytest.mark.parametrize("text", ["rad", "(m/s)", "(thesis eq. 11.1)", "(m, m/s)"])
def test_units_are_no_shapes(text):
    assert not SHAPE.search(text)
