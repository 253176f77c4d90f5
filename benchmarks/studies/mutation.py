"""Mutation testing: does a test fail when one operator, constant, condition or statement of a file is changed?

Each mutant is written to a copy of the package in a temporary folder, and the fast tests that mirror the file run
against it in a forked process, which has all modules loaded that do not import the file; the sources themselves are
never changed. mutmut 3 calls each function through another one, which numba does not compile, and cosmic-ray starts a
process for each mutant, most of whose time is imports.

``python mutation.py diagnosis/selection/decision.py -o study-results/mutation.jsonl`` mutates one file, without a name
all files of `TESTS`; ``--report`` counts the outcomes. Mutants that are in the file of results are not repeated, except
for those that survived with ``--survivors``. Compiled kernels check the bounds of their arrays.

Not mutated: docstrings, annotations, text, decorators, imports, and ``strict=`` of `zip`.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import gc
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import hypothesis
import numba
import pytest

ROOT = Path(__file__).parents[2]

#: Tests of the compiled filter without whole flights, which take a minute where its kernels are interpreted.
COMPILED_UKF = tuple(
    f"navigation/test_compiled_ukf.py::{name}"
    for name in (
        "test_random_problems",
        "test_each_step_is_that_of_the_reference",
        "test_the_transform_without_a_statement_is_that_of_the_reference",
        "test_weights_are_those_of_the_reference",
        "test_a_filter_does_not_change_what_it_was_given",
        "test_a_covariance_that_is_not_positive_is_refused",
        "test_a_prediction_from_a_covariance_that_is_not_positive_is_refused",
        "test_a_prediction_to_a_covariance_that_is_not_positive_is_refused",
        "test_an_update_to_a_covariance_that_is_not_positive_is_refused",
        "test_a_change_of_the_instrument_to_a_covariance_that_is_not_positive_is_refused",
        "test_a_reading_at_the_last_epoch_is_smoothed_as_by_the_reference",
        "test_a_predicted_covariance_that_is_not_positive_is_refused_by_the_smoother",
    )
)
#: Tests of the smoother of the motion in windows of a few bins; those in whole windows take a minute.
SHORT_WINDOWS = tuple(
    f"navigation/test_motion_smoother.py::{name}"
    for name in (
        "test_the_smoothed_errors_are_those_of_dense_conditioning",
        "test_a_prediction_is_that_of_dense_conditioning",
        "test_a_covariance_that_is_not_positive_definite_is_refused",
        "test_sizes_are_those_of_the_largest_posterior_density_within_their_range",
        "test_the_better_of_two_searches_counts",
        "test_a_search_continues_from_an_earlier_solution",
        "test_a_search_ends_where_motion_and_sizes_remain",
        "test_steps_that_do_not_become_smaller_are_halved",
        "test_a_motion_that_diverges_is_given_up",
        "test_the_covariance_is_scaled_by_the_errors_of_trial_stretches",
        "test_without_trial_stretches_the_covariance_is_that_of_the_model",
        "test_what_one_side_alone_predicts_otherwise_enlarges_the_covariance",
        "test_a_prediction_with_a_singular_covariance_is_given_up",
        "test_readings_that_no_motion_explains_give_no_prediction",
    )
)
#: File of the package → tests that run against its mutants, as arguments of pytest.
TESTS = {
    "diagnosis/selection/decision.py": ("diagnosis/selection/test_decision.py",),
    "diagnosis/selection/disambiguation.py": ("diagnosis/selection/test_disambiguation.py",),
    "diagnosis/stepwise.py": ("diagnosis/test_stepwise.py",),
    "estimation/regression.py": ("estimation/test_regression.py",),
    "estimation/matern.py": ("estimation/test_matern.py",),
    "estimation/block_sparse.py": ("estimation/test_block_sparse.py", "estimation/test_kalman.py"),
    "estimation/linear_state_space.py": ("estimation/test_linear_state_space.py",),
    "estimation/smoothing.py": ("estimation/test_smoothing.py",),
    "estimation/kalman.py": ("estimation/test_kalman.py",),
    "estimation/autoregression.py": ("estimation/test_autoregression.py",),
    "estimation/gauss_markov.py": ("estimation/test_gauss_markov.py",),
    "estimation/interpolating_spline.py": ("estimation/test_interpolating_spline.py",),
    "estimation/random_fields.py": ("estimation/test_random_fields.py",),
    "estimation/small_matrices.py": ("estimation/test_small_matrices.py",),
    "estimation/parallel.py": ("estimation/test_parallel.py",),
    "navigation/outlier_screening.py": ("navigation/test_outlier_screening.py",),
    "navigation/recovery.py": ("navigation/test_recovery.py",),
    "navigation/consensus.py": ("navigation/test_consensus.py",),
    "navigation/robust.py": ("navigation/test_robust.py",),
    "navigation/information.py": ("navigation/test_information.py",),
    "navigation/layout.py": ("navigation/test_layout.py",),
    "navigation/initial.py": ("navigation/test_initial.py",),
    "navigation/constraints.py": ("navigation/test_constraints.py",),
    "navigation/parachute.py": ("navigation/test_parachute.py",),
    "navigation/trajectory.py": ("navigation/test_trajectory.py",),
    "navigation/estimator.py": ("navigation/test_estimator.py",),
    "navigation/propagation.py": ("navigation/test_propagation.py",),
    "navigation/rotation_corrections.py": ("navigation/test_rotation_corrections.py",),
    "navigation/unresolved.py": ("navigation/test_unresolved.py",),
    "navigation/increments.py": ("navigation/test_increments.py",),
    "navigation/iterated.py": ("navigation/test_iterated.py",),
    "telemetry/rest_drift.py": ("telemetry/test_rest_drift.py",),
    "navigation/leave_one_out.py": ("navigation/test_leave_one_out.py",),
    "navigation/ekf.py": (
        "navigation/test_ekf.py",
        "navigation/test_error_dynamics.py",
        "navigation/test_estimator.py",
    ),
    "navigation/smoother.py": ("navigation/test_smoother.py",),
    "navigation/ukf.py": (
        "navigation/test_ukf.py",
        "navigation/test_compiled_ukf.py",
        "navigation/test_estimator.py",
    ),
    "navigation/compiled_ukf.py": COMPILED_UKF,
    "navigation/compiled_states.py": ("navigation/test_compiled_states.py",),
    "navigation/compiled_noise.py": ("navigation/test_compiled_noise.py",),
    "navigation/filter.py": ("navigation/test_filter.py",),
    "navigation/noise.py": ("navigation/test_noise.py",),
    "navigation/error_dynamics.py": ("navigation/test_error_dynamics.py",),
    "navigation/strapdown.py": ("navigation/test_strapdown.py",),
    "navigation/rotational_dynamics.py": ("navigation/test_rotational_dynamics.py",),
    "navigation/motion_model.py": ("navigation/test_motion_model.py",),
    "navigation/motion_smoother.py": SHORT_WINDOWS,
    "diagnosis/selection/screening.py": ("diagnosis/selection/test_screening.py",),
    "diagnosis/selection/outer_loop.py": ("diagnosis/selection/test_outer_loop.py",),
    "diagnosis/selection/hypothesis.py": ("diagnosis/selection/test_hypothesis.py",),
    "diagnosis/selection/evidence_profile.py": ("diagnosis/selection/test_evidence_profile.py",),
    "diagnosis/selection/map_fit.py": ("diagnosis/selection/test_map_fit.py",),
    "diagnosis/selection/time_scan.py": ("diagnosis/selection/test_time_scan.py",),
    "diagnosis/selection/ranking.py": ("diagnosis/selection/test_ranking.py",),
}
#: Files with kernels that others compile into theirs: a cached caller would hide the mutant, so these files and all
#: that import them are interpreted. Kernels of files that they import remain compiled.
INTERPRETED = (
    "estimation/block_sparse.py", "estimation/smoothing.py", "estimation/kalman.py", "navigation/compiled_noise.py",
    "navigation/compiled_states.py", "navigation/compiled_ukf.py", "navigation/rotational_dynamics.py",
)  # fmt: skip

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}  # fmt: skip
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
SWAPPED = {"min": "max", "any": "all", "minimum": "maximum", "argmin": "argmax", "nanmin": "nanmax", "floor": "ceil"}
SWAPPED |= {b: a for a, b in SWAPPED.items()}

# As in tests/conftest.py, without the search for a simpler counterexample, which takes most of a failing test's time
hypothesis.settings.register_profile(
    "mutation", deadline=None, max_examples=40, derandomize=True,
    phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate), report_multiple_bugs=False,
)  # fmt: skip

#: Outcomes of a mutant.
KILLED, SURVIVED, TIMEOUT = "killed", "survived", "timeout"
#: A mutant's tests may take this many times as long as those of the file itself, and as many seconds more.
TIME_FACTOR, TIME_MARGIN = 5.0, 5.0


@dataclass(frozen=True)
class Mutant:
    """One change of a file.

    Attributes
    ----------
    line : int
    original, mutated : str
        The expression or statement before and after.
    begin, end : int
        Place of the original in the file, bytes.
    """

    line: int
    original: str
    mutated: str
    begin: int
    end: int

    def apply(self, source: bytes) -> bytes:
        """The file's content with the change."""
        return source[: self.begin] + self.mutated.encode() + source[self.end :]


def _is_comparison(node: ast.expr) -> bool:
    """Whether the negation of an expression is one of its own mutants."""
    return (isinstance(node, ast.Compare) and len(node.ops) == 1) or isinstance(node, ast.UnaryOp)


def _mutated_expressions(node: ast.expr) -> Iterator[ast.expr]:
    """All changes of one expression itself, not of its parts."""

    def changed(**fields: object) -> ast.expr:
        mutant = copy.copy(node)
        for name, value in fields.items():
            setattr(mutant, name, value)
        return mutant

    if isinstance(node, ast.Compare):
        for k, operator in enumerate(node.ops):
            for comparison in COMPARISONS[type(operator)]:
                yield changed(ops=[*node.ops[:k], comparison(), *node.ops[k + 1 :]])
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        yield changed(op=OPERATORS[type(node.op)]())
    elif isinstance(node, ast.BoolOp):
        yield changed(op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.UnaryOp):
        yield node.operand
    elif isinstance(node, ast.IfExp) and not _is_comparison(node.test):
        yield changed(test=ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Constant):
        if isinstance(node.value, bool):
            yield changed(value=not node.value)
        elif isinstance(node.value, int):
            yield from (changed(value=node.value + 1), changed(value=node.value - 1))
        elif isinstance(node.value, float):
            yield changed(value=2.0 * node.value if node.value else 1.0)
    elif isinstance(node, ast.Call):
        function = node.func
        if isinstance(function, ast.Name) and function.id in SWAPPED:
            yield changed(func=ast.Name(SWAPPED[function.id]))
        elif isinstance(function, ast.Attribute) and function.attr in SWAPPED:
            yield changed(func=ast.Attribute(function.value, SWAPPED[function.attr]))


def _mutated_statements(node: ast.stmt) -> Iterator[str]:
    """All changes of one statement itself, as text."""
    if isinstance(node, ast.Return) and not (node.value is None or ast.unparse(node.value) == "None"):
        yield "return None"
    elif isinstance(node, ast.AugAssign):
        yield "pass"
        if type(node.op) in OPERATORS:
            yield ast.unparse(ast.AugAssign(node.target, OPERATORS[type(node.op)](), node.value))
    elif (
        isinstance(node, ast.Raise | ast.Continue | ast.Break)
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call))
        or (isinstance(node, ast.Assign) and all(isinstance(t, ast.Subscript | ast.Attribute) for t in node.targets))
    ):
        yield "pass"


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes that are mutated, in the order of the file."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("decorator_list", "annotation", "returns"):
            continue
        if name == "keywords":
            value = [k for k in value if k.arg != "strict"]
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                yield from _nodes(child)


def mutants(source: bytes) -> list[Mutant]:
    """All mutants of a Python file."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    result = []
    for node in _nodes(ast.parse(source)):
        changes: list[str] = []
        if isinstance(node, ast.expr):
            changes = [f"({ast.unparse(e)})" for e in _mutated_expressions(node)]
        elif isinstance(node, ast.stmt):
            changes = list(_mutated_statements(node))
        if isinstance(node, ast.If | ast.While) and not _is_comparison(node.test):
            node = node.test
            changes = [f"(not ({ast.unparse(node)}))"]
        if changes:
            begin, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
            result += [Mutant(node.lineno, source[begin:end].decode(), c, begin, end) for c in changes]
    return result


def dependents(package: Path, name: str) -> set[str]:
    """Names of the modules that import a file of the package, directly or not, and of the file itself."""
    paths = {
        ".".join(path.relative_to(package).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (package / "edl_filter").rglob("*.py")
    }
    imported: dict[str, set[str]] = {module: set() for module in paths}
    for module, path in paths.items():
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                imported[module] |= {a.name for a in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                places = {f"{node.module}.{a.name}" for a in node.names}
                imported[module] |= {place if place in paths else node.module for place in places}
    result, size = {".".join(Path("edl_filter", name).with_suffix("").parts)}, 0
    while len(result) > size:
        size = len(result)
        result |= {m for m, names in imported.items() if names & result}
    return result


def forget(modules: set[str]) -> None:
    """Let the next import of some modules read their files again."""
    for name in modules & sys.modules.keys():
        del sys.modules[name]
        package, _, child = name.rpartition(".")
        if package in sys.modules and hasattr(sys.modules[package], child):
            delattr(sys.modules[package], child)


def interpret(modules: set[str]) -> None:
    """Let `numba.njit` leave the functions of some modules as they are, when they are imported."""
    compiled = numba.njit

    def njit(function: Callable[..., object] | None = None, **options: object) -> object:
        if function is None:
            return lambda f: njit(f, **options)
        return function if function.__module__ in modules else compiled(**options)(function)

    numba.njit = njit


def load_modules(tests: list[str]) -> None:
    """Import the modules that tests import, so that forked processes have them."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _silence()
        try:
            pytest.main(["-q", "-p", "no:cacheprovider", "--collect-only", *tests])
            with contextlib.suppress(ImportError):
                importlib.import_module("edl_filter.diagnosis.diagnosis")  # by a fixture of tests/conftest.py
            files = {n: getattr(m, "__file__", None) or "" for n, m in sys.modules.items()}
            names = [n for n, f in files.items() if "site-packages" in f or n.startswith("edl_filter")]
            with os.fdopen(writer, "w") as file:
                file.write("\n".join(names))
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as file:
        names = file.read().split()
    os.waitpid(child, 0)
    for name in names:
        with contextlib.suppress(ImportError):  # some are not meant to be imported by themselves
            importlib.import_module(name)
    numba.njit(lambda x: x)(1.0)  # the first compilation loads the compiler's tables
    gc.freeze()


def _silence() -> None:
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)


def run_tests(tests: list[str], limit: float, changed: set[str], interpreted: bool) -> tuple[str, float]:
    """Run tests in a forked process.

    Parameters
    ----------
    tests : list of str
        Arguments of pytest.
    limit : float
        Time after which the tests are ended, s.
    changed : set of str
        Modules that are read again.
    interpreted : bool
        Do not compile the kernels of these modules.

    Returns
    -------
    outcome : str
        `SURVIVED` where all tests pass.
    duration : float
        s.
    """
    begin = time.monotonic()
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)  # what the tests start is ended with them
        _silence()
        sys.dont_write_bytecode = True  # two mutants of one size in one second would share it
        code = 3
        try:
            forget(changed)
            if interpreted:
                interpret(changed)
            options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow and not effects and not browser"]
            code = int(pytest.main([*options, *tests]))
        finally:
            os._exit(code)
    while time.monotonic() - begin < limit:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            passed = os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0
            return SURVIVED if passed else KILLED, time.monotonic() - begin
        time.sleep(0.01)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return TIMEOUT, time.monotonic() - begin


def outcomes(results: Path) -> dict[tuple[str, Mutant], str]:
    """File and mutant → outcome, of a file of JSON lines; the last one of a mutant that was repeated."""
    by_mutant = {}
    for line in results.read_text().splitlines() if results.is_file() else []:
        entry = json.loads(line)
        mutant = Mutant(**{name: entry[name] for name in Mutant.__dataclass_fields__})
        by_mutant[entry["file"], mutant] = entry["outcome"]
    return by_mutant


def mutate_file(name: str, results: Path, most: int, seed: int, survivors: bool = False) -> None:
    """Run the tests of one file against its mutants, and append the outcomes to a file of JSON lines.

    Parameters
    ----------
    name : str
        File of the package.
    results : Path
        Outcomes that are in it are not repeated.
    most : int
        Number of mutants; those of a file that has more are a random sample.
    seed : int
        Of the sample.
    survivors : bool
        Repeat those that survived.
    """
    tests = [str(ROOT / "tests" / t) for t in TESTS[name]]
    known = outcomes(results)
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder, "src")
        shutil.copytree(ROOT / "src", package)  # with the compiled kernels
        Path(folder, "missions").symlink_to(ROOT / "missions")
        numba.config.BOUNDSCHECK = 1  # a mutant that writes beyond an array fails
        path = package / "edl_filter" / name
        source = path.read_bytes()
        sys.path.insert(0, str(package))
        load_modules(tests)
        for bytecode in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            bytecode.unlink()
        changed = dependents(package, name)
        for _ in range(2):  # the first run compiles the kernels
            outcome, duration = run_tests(tests, float("inf"), changed, name in INTERPRETED)
            if outcome != SURVIVED:
                raise SystemExit(f"{name}: its tests fail without a mutation")
        every = mutants(source)
        sample = sorted(random.Random(seed).sample(every, min(most, len(every))), key=lambda m: m.begin)
        print(f"{name}: {len(sample)} of {len(every)} mutants, {duration:.1f} s for its tests", flush=True)
        for m in sample:
            if (name, m) in known and not (survivors and known[name, m] == SURVIVED):
                continue
            path.write_bytes(m.apply(source))
            outcome, took = run_tests(tests, TIME_FACTOR * duration + TIME_MARGIN, changed, name in INTERPRETED)
            entry = {"file": name, **asdict(m), "outcome": outcome, "seconds": round(took, 2)}
            with results.open("a") as file:
                file.write(json.dumps(entry) + "\n")
            if outcome == SURVIVED:
                print(f"  {m.line}: {m.original}  →  {m.mutated}", flush=True)
        sys.path.remove(str(package))
        forget({m for m in sys.modules if m.partition(".")[0] == "edl_filter"})


def report(results: Path) -> None:
    """Print the number of mutants of each file by their outcome."""
    counts: dict[str, Counter[str]] = {}
    for (name, _), outcome in outcomes(results).items():
        counts.setdefault(name, Counter())[outcome] += 1
    for name, count in counts.items():
        print(f"{name}: {count.total()} mutants, " + ", ".join(f"{n} {o}" for o, n in sorted(count.items())))


def main() -> None:
    """Mutate files and report the survivors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", help="files of the package; without any, all that have tests")
    parser.add_argument("-o", "--output", type=Path, default=Path("study-results/mutation.jsonl"))
    parser.add_argument("--most", type=int, default=120, help="mutants of a file; those of one with more are sampled")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--survivors", action="store_true", help="repeat the mutants that survived")
    parser.add_argument("--report", action="store_true", help="only count the outcomes")
    arguments = parser.parse_args()
    output = arguments.output.absolute()
    output.parent.mkdir(parents=True, exist_ok=True)
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[variable] = "1"  # threads do not survive a fork
    os.environ["HYPOTHESIS_PROFILE"] = "mutation"  # read by tests/conftest.py
    os.chdir(ROOT)
    for name in [] if arguments.report else arguments.files or TESTS:
        mutate_file(name, output, arguments.most, arguments.seed, arguments.survivors)
    report(output)


if __name__ == "__main__":
    main()
