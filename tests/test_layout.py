"""The layout of the tests follows that of the code: which file of the code is tested where, and what else is tested.

A file ``src/edl_filter/PACKAGE/NAME.py`` has its tests in ``tests/PACKAGE/test_NAME.py``, or `COVERED_BY` says which
files test it. A file of tests in the folder of a package tests the file or package of its name, or `SUBJECTS` says what
it tests.
"""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
CODE = TESTS.parent / "src" / "edl_filter"
#: Files without anything that a test of its own could find wrong: entry point, version, names of types.
EXCEPTIONS = {"__main__.py", "_version.py", "types.py"}
#: Folder of tests that is no package of the code → what is in it.
OWN_FOLDERS = {
    "data": "flights of another simulator and published tables, which tests read",
    "flights": "whole flights, real and simulated",
    "hostile": "files that are mutated, or made to do harm",
    "notebooks": "the notebooks, executed",
    "studies": "the studies in benchmarks/studies",
}

#: File of the code → files of tests that cover it. Each imports the file, or one that imports it.
COVERED_BY = {
    "aero/increment_tables.py": ["results/test_database_update.py"],
    "aero/increments_file.py": ["results/test_database_update.py"],
    "aero/regimes.py": ["aero/test_transition.py", "diagnosis/residual_analysis/test_residual_map.py"],
    "cli/_base.py": ["cli/test_commands.py", "cli/test_new.py", "cli/test_reconstruction.py"],
    "display.py": ["test_api.py"],
    "effects/forward_model.py": [
        "diagnosis/jacobians/test_coefficient_errors.py", "diagnosis/prediction/test_predicted_readings.py",
        "effects/test_adapters.py", "effects/test_atmosphere.py", "effects/test_initial_state.py",
    ],
    "effects/hook_validation.py": ["effects/test_registry.py"],
    "effects/parameters.py": ["effects/test_base.py", "effects/test_catalogue.py"],
    "effects/types.py": ["effects/test_vehicle.py"],
    "io/atomic.py": ["io/test_output_folder.py"],
    "io/hdf5_guard.py": ["hostile/test_refusals.py"],
    "io/progress.py": ["serve/test_jobs.py"],
    "io/yaml_guard.py": ["hostile/test_refusals.py"],
    "mission/aerodynamics.py": ["results/test_postflight.py"],
    "mission/edit_effects.py": ["test_api.py", "workflow/test_add_effect.py", "workflow/test_improve_model.py"],
    "mission/fields.py": ["mission/test_decision_settings.py", "mission/test_mission.py"],
    "mission/measurements.py": ["mission/test_mission.py"],
    "mission/new_mission.py": ["cli/test_new.py"],
    "mission/problems.py": ["cli/test_new.py", "workflow/test_validate.py"],
    "pipeline/constraints.py": ["pipeline/test_reconstruct.py", "telemetry/test_mer_flight.py"],
    "pipeline/entry_state.py": ["flights/test_mer.py"],
    "pipeline/plausibility.py": ["pipeline/test_trust.py"],
    "pipeline/record_comparison.py": ["pipeline/test_trust.py"],
    "postflight/atmosphere_case.py": ["postflight/test_derive.py"],
    "postflight/coefficients.py": ["postflight/test_derive.py"],
    "postflight/inputs.py": ["postflight/test_derive.py"],
    "report/atmosphere.py": ["report/test_postflight_figures.py"],
    "report/attitude.py": ["report/test_figures.py"],
    "report/coefficients.py": ["report/test_postflight_figures.py"],
    "report/colours.py": ["report/test_residual_map.py"],
    "report/constraints.py": ["report/test_figures.py"],
    "report/html/bundle.py": ["report/html/test_page.py"],
    "report/html/flight_sections.py": ["report/html/test_page.py"],
    "report/motion.py": ["report/test_figures.py"],
    "report/notebook.py": ["test_api.py"],
    "report/rotation.py": ["report/test_postflight_figures.py"],
    "report/terminal/console.py": ["report/terminal/test_widths.py"],
    "report/terminal/run.py": ["report/terminal/test_widths.py", "results/test_summary.py"],
    "report/terminal/table.py": ["report/terminal/test_widths.py"],
    "report/track.py": ["report/test_figures.py"],
    "report/trajectory.py": ["report/test_figures.py"],
    "results/campaign_variables.py": ["results/test_campaign_statistics.py", "workflow/test_campaign_case.py"],
    "results/groups.py": ["results/test_reader.py"],
    "results/hdf5.py": ["results/test_netcdf.py", "results/test_reader.py"],
    "results/reopen.py": ["workflow/test_diagnose_result.py"],
    "results/residual_series.py": ["results/test_reader.py"],
    "results/verdicts.py": ["diagnosis/selection/test_decision.py"],
    "results/result.py": ["test_api.py"],
    "results/schema/diagnosis.py": ["results/test_schema.py"],
    "results/schema/fields.py": ["results/test_schema.py"],
    "results/schema/ledger.py": ["results/test_schema.py"],
    "results/schema/summary.py": ["results/test_schema.py"],
    "serve/overview.py": ["serve/test_app.py"],
    "simulation/flight.py": ["simulation/test_simulate.py"],
    "simulation/increments.py": ["simulation/test_dynamics.py", "simulation/test_motion.py"],
    "simulation/parachute.py": ["simulation/test_dynamics.py", "simulation/test_motion.py"],
    "telemetry/csv_spec.py": ["telemetry/test_csv_log.py"],
    "telemetry/hdf5_checks.py": ["telemetry/test_flight_file.py"],
    "telemetry/mer_register.py": ["telemetry/test_mer_flight.py"],
    "telemetry/mer_segments.py": ["telemetry/test_mer_flight.py"],
    "telemetry/quantisation.py": ["telemetry/test_flight_file.py", "telemetry/test_sample_repair.py"],
    "telemetry/record.py": ["telemetry/test_calibration.py", "telemetry/test_sample_repair.py"],
    "telemetry/spikes.py": ["telemetry/test_sample_repair.py"],
    "workflow/campaign_files.py": ["workflow/test_campaign.py"],
    "workflow/campaign_process.py": ["workflow/test_campaign.py", "workflow/test_campaign_faults.py"],
}  # fmt: skip
#: File of the code that only a command imports → the command, and the file of tests that calls it.
COVERED_BY_COMMAND = {
    "report/terminal/campaign.py": ("campaign", "cli/test_campaign.py"),
    "report/terminal/effects.py": ("effects", "cli/test_diagnosis.py"),
    "workflow/campaign_report.py": ("campaign", "cli/test_campaign.py"),
    "workflow/compare_results.py": ("compare", "workflow/test_improve_model.py"),
    "workflow/draw_figures.py": ("figures", "cli/test_reconstruction.py"),
    "workflow/dry_run.py": ("run", "cli/test_new.py"),
}
#: File of tests that is no file of the code → what it tests.
SUBJECTS = {
    "cli/test_new.py": "starting with a mission of your own: `new`, `missions`, --dry-run, --set",
    "effects/test_catalogue.py": "what holds for all effects of the catalogue",
    "estimation/test_reproducibility.py": "equal bits of kernels that are compiled or read; a million epochs",
    "navigation/test_consistency.py": "errors and innovations of both filters against their sigmas",
    "pipeline/test_lost_samples.py": "a flight that lost a second of its samples",
    "report/html/test_browser.py": "a report in Chromium",
    "report/terminal/test_widths.py": "all tables and texts at the widths of terminals",
    "report/test_postflight_figures.py": "all figures of the post-flight layer",
    "serve/test_browser.py": "the workbench in Chromium",
    "simulation/test_events.py": "events of a simulated flight, which several files share",
    "test_benchmarks.py": "benchmarks",
    "test_docs.py": "pages of the documentation",
    "test_docs_types.py": "types of the programs in the documentation",
    "test_docstrings.py": "docstrings",
    "test_layout.py": "the layout of the tests",
    "test_package_docstrings.py": "docstrings of packages",
    "workflow/test_campaign_faults.py": "a campaign whose processes are killed",
}


def code_files():
    return {p.relative_to(CODE).as_posix() for p in CODE.rglob("*.py") if p.name != "__init__.py"} - EXCEPTIONS


def test_files():
    """Files of tests in the folders of packages, relative to the tests."""
    names = (p.relative_to(TESTS) for p in TESTS.rglob("test_*.py"))
    return {n.as_posix() for n in names if n.parts[0] not in OWN_FOLDERS}


test_files.__test__ = False


def mirror(file):
    """Where the tests of a file of the code are looked for."""
    path = Path(file)
    return (path.parent / f"test_{path.name}").as_posix()


def module_of(path):
    parts = ("edl_filter", *path.relative_to(CODE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(p): p for p in CODE.rglob("*.py")}


def module_named(text):
    """The module with which a dotted name begins, such as ``edl_filter.results.hdf5._write_group``; or None."""
    parts = text.replace(":", ".").split(".")
    names = (".".join(parts[:k]) for k in range(len(parts), 1, -1))
    return next((n for n in names if n in MODULES), None)


def imports_of_node(node):
    """Modules of the package that a node of a syntax tree imports or names in a text."""
    if isinstance(node, ast.Import):
        return {a.name for a in node.names} & set(MODULES)
    if isinstance(node, ast.ImportFrom):
        submodules = {f"{node.module}.{a.name}" for a in node.names} & set(MODULES)
        exported = {e for a in node.names if (e := exports(node.module).get(a.name))}
        return submodules | exported | ({node.module} & set(MODULES))
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("edl_filter."):
        return {module_named(node.value)} - {None}
    return set()


@cache
def exports(module):
    """Name that a package imports from one of its modules, now or when it is first used → that module."""
    path = MODULES.get(module)
    if path is None or path.name != "__init__.py":
        return {}
    nodes = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.ImportFrom)]
    return {a.asname or a.name: n.module for n in nodes for a in n.names if n.module in MODULES}


@cache
def imports(path):
    """Modules of the package that a file imports, anywhere in it but for type checking, or names in a text."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    blocks = [n.body for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    typing_only = {n for block in blocks for statement in block for n in ast.walk(statement)}
    return set().union(*(imports_of_node(n) for n in ast.walk(tree) if n not in typing_only))


def imports_of_test(file):
    """As `imports`, with those of the fixtures of the folder."""
    path = TESTS / file
    fixtures = path.with_name("conftest.py")
    return imports(path) | (imports(fixtures) if path.parent != TESTS and fixtures.exists() else set())


def calls_command(file, command):
    """Whether a file of tests calls a function with the name of a command as first argument."""
    calls = (n for n in ast.walk(ast.parse((TESTS / file).read_text(encoding="utf-8"))) if isinstance(n, ast.Call))
    return any(c.args and isinstance(c.args[0], ast.Constant) and c.args[0].value == command for c in calls)


def test_every_file_of_the_code_has_a_file_of_tests_or_is_listed_with_those_that_cover_it():
    without = {f for f in code_files() if not (TESTS / mirror(f)).exists()}
    assert without == COVERED_BY.keys() | COVERED_BY_COMMAND.keys()
    assert not COVERED_BY.keys() & COVERED_BY_COMMAND.keys()


def test_every_file_of_tests_has_a_file_of_the_code_or_a_subject():
    packages = {mirror(p.parent.relative_to(CODE).as_posix() + ".py") for p in CODE.rglob("*/__init__.py")}
    named = {mirror(f) for f in code_files()} | packages
    assert test_files() - named == SUBJECTS.keys()


def test_every_folder_of_tests_is_a_package_of_the_code_or_is_listed():
    folders = {p.parent.relative_to(TESTS).as_posix() for p in TESTS.rglob("*.py")} - {"."}
    packages = {p.parent.relative_to(CODE).as_posix() for p in CODE.rglob("*/__init__.py")}
    assert folders - packages == OWN_FOLDERS.keys()


def test_every_file_of_tests_that_is_named_exists():
    """In the pages, and in the list of files that take longest: a name without a file would be ignored there."""
    root = TESTS.parent
    pages = [*root.glob("*.md"), root / "Makefile", *root.glob("docs/**/*.md"), *root.glob("benchmarks/**/*.py")]
    texts = (p.read_text(encoding="utf-8") for p in pages if p.name != "CHANGELOG.md" and "_build" not in p.parts)
    named = {n.removeprefix("tests/") for text in texts for n in re.findall(r"\btests/[\w/]+\.py\b", text)}
    statements = ast.parse((TESTS / "conftest.py").read_text(encoding="utf-8")).body
    assigned = {ast.unparse(n.targets[0]): n.value for n in statements if isinstance(n, ast.Assign)}
    named |= set(ast.literal_eval(assigned["LONGEST"]))
    assert len(named) > 40
    placeholder = re.compile("PACKAGE|NAME|FAMILY")
    assert [n for n in sorted(named) if not placeholder.search(n) and not (TESTS / n).is_file()] == []


@pytest.mark.parametrize("file", COVERED_BY)
def test_what_covers_a_file_imports_it_or_one_that_imports_it(file):
    module = module_of(CODE / file)
    near = {m for m, path in MODULES.items() if module in imports(path)} | {module}
    for test in COVERED_BY[file]:
        assert near & imports_of_test(test), test


@pytest.mark.parametrize("file", COVERED_BY_COMMAND)
def test_what_covers_a_file_through_a_command_calls_the_command_that_imports_it(file):
    command, test = COVERED_BY_COMMAND[file]
    commands = [p for p in (CODE / "cli").glob("*.py") if module_of(CODE / file) in imports(p)]
    functions = {n.name for p in commands for n in ast.parse(p.read_text(encoding="utf-8")).body if hasattr(n, "name")}
    assert command in functions and calls_command(test, command)


@pytest.mark.parametrize(
    ("text", "modules"),
    [
        ("from edl_filter.results import hdf5", {"edl_filter.results", "edl_filter.results.hdf5"}),
        ("from edl_filter.mission import Mission", {"edl_filter.mission", "edl_filter.mission.mission"}),
        ("def f():\n    import edl_filter.errors", {"edl_filter.errors"}),
        ("patch('edl_filter.results.hdf5._write_group')", {"edl_filter.results.hdf5"}),
        ("x = {'a': 'edl_filter.report.notebook:card'}", {"edl_filter.report.notebook"}),
        ("import numpy; from numpy import linalg", set()),
        ("if TYPE_CHECKING:\n    import edl_filter.errors\nimport edl_filter.io", {"edl_filter.io"}),
    ],
)
def test_imports_are_read_in_all_their_forms(text, modules, tmp_path):
    file = tmp_path / "some.py"
    file.write_text(text)
    assert imports(file) == modules
