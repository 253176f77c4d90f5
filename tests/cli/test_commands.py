"""The program: version, help, exit codes."""

import os
import pty
import subprocess
import sys
from contextlib import suppress

import pytest
from command_checks import assert_refused

from edl_filter import __version__
from edl_filter.cli import commands
from edl_filter.mission import shipped_mission

COMMANDS = (
    "run", "new", "missions", "validate", "convert", "simulate", "export", "fetch", "demo", "effects", "add",
    "diagnose", "compare", "improve", "identifiability", "campaign", "serve",
)  # fmt: skip


def test_version(cli):
    result = cli("--version")
    assert result.exit_code == 0
    assert result.stdout.strip() == f"edl-filter {__version__}"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(cli, command):
    result = cli(command, "--help")
    assert result.exit_code == 0
    assert f"Example: edl-filter {command}" in result.stdout


def test_importing_the_commands_imports_no_large_package():
    code = (
        "import sys, edl_filter.cli; "
        "large = 'numpy numba xarray pydantic scipy matplotlib h5py dask distributed zarr'.split(); "
        "print([m for m in large if m in sys.modules])"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"


def test_a_run_without_figures_imports_only_what_it_uses(tmp_path):
    """Imports were two thirds of the time of a run."""
    names = (
        "matplotlib", "scipy.signal", "scipy.stats", "scipy.interpolate", "scipy.optimize", "pandas", "xarray",
        "plotly", "filterpy", "requests", "edl_filter.diagnosis", "edl_filter.simulation",
    )  # fmt: skip
    code = (
        "import sys\n"
        "from edl_filter.cli import main\n"
        f"sys.argv = ['edl-filter', 'run', 'builtin:practice_mer', '--no-figures', '-o', {str(tmp_path / 'out')!r}]\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        f"print([name for name in {names} if name in sys.modules], file=sys.stderr)"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stderr.strip() == "[]"


@pytest.mark.parametrize(("stated", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_blas_has_one_thread_unless_the_user_states_another_number(monkeypatch, stated, threads):
    environment = dict(stated)
    monkeypatch.setattr(os, "environ", environment)
    monkeypatch.setattr(commands, "app", lambda prog_name: None)
    commands.main()
    assert environment["OPENBLAS_NUM_THREADS"] == threads and environment["MKL_NUM_THREADS"] == "1"


@pytest.mark.parametrize("command", [[], *([name] for name in sorted(COMMANDS))])
def test_help_takes_less_than_0_3_s(command):
    call = [sys.executable, "-c", "from edl_filter.cli import main; main()", *command, "--help"]
    durations = []
    for _ in range(4):
        begin = os.times()
        subprocess.run(call, capture_output=True, check=True)
        end = os.times()
        # processor time of the child process, which does not depend on other processes
        durations.append(end.children_user + end.children_system - begin.children_user - begin.children_system)
    assert min(durations) < 0.3


@pytest.mark.parametrize("command", ["validate", "run"])
def test_a_closed_pipe_is_no_error(command, tmp_path):
    call = [sys.executable, "-m", "edl_filter", command, "builtin:practice_mer"]
    call += ["-o", str(tmp_path), "--no-figures"] if command == "run" else []
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        errors = process.stderr.read()
    assert (process.returncode, errors) == (0, "")


def test_usage_errors_exit_2(cli):
    assert_refused(cli("run"), "Missing argument")
    assert_refused(cli("run", "a", "--nonsense"), "--nonsense")
    assert_refused(cli("export", "a", "--naif-id", "x", "--to", "csv"), "naif-id")


def test_an_error_of_the_package_exits_1(cli, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("edl_filter.mission.Mission.load", broken)
    result = cli("run", "builtin:practice_mer")
    assert result.exit_code == 1
    assert "ZeroDivisionError: oops" in result.stderr
    assert "--debug" in result.stderr
    assert "Traceback" not in result.stderr
    debugged = cli("--debug", "run", "builtin:practice_mer")
    assert debugged.exit_code == 1
    assert "Traceback" in debugged.stderr


def test_debug_shows_the_traceback_of_wrong_input(cli):
    result = cli("--debug", "run", "nowhere.yaml")
    assert result.exit_code == 2
    assert "Traceback" in result.stderr and "nowhere.yaml" in result.stderr


CODE = """
from pathlib import Path
from edl_filter.effects import Effect, Parameter

Path(__file__).with_name("executed").write_text("yes")


class Bump(Effect):
    name = "bump"
    description = "A bump of the density."
    parameters = (Parameter("a", "", "amplitude", 0.1, low=-1.0, high=1.0),)

    def density(self, p, altitude):
        return 1.0 + p["a"] * (altitude > 1e9)
"""


def test_a_check_runs_no_code_of_a_mission_and_other_commands_name_the_file(cli, tmp_path, caplog):
    (tmp_path / "bump.py").write_text(CODE)
    mission = tmp_path / "mission.yaml"
    entry = "\neffects:\n  - {name: bump, file: bump.py, parameters: {a: 0.1}}\n"
    mission.write_text(shipped_mission("practice_mer").read_text() + entry)
    result = cli("validate", str(mission))
    assert result.exit_code == 0, result.output
    assert "not checked: the effect in bump.py" in result.output
    assert not (tmp_path / "executed").exists()
    with caplog.at_level("INFO", logger="edl_filter"):
        cli("effects", "--file", str(tmp_path / "bump.py"))
    assert (tmp_path / "executed").exists()
    assert f"runs the code of {tmp_path / 'bump.py'}" in caplog.text


def test_the_status_line_of_a_terminal_has_no_thread():
    """With another thread a diagnosis would not use copies of its process."""
    code = (
        "import threading\n"
        "from edl_filter.cli._base import progress\n"
        "with progress('diagnosing', quiet=False) as step:\n"
        "    step('first step')\n"
        "    print(threading.active_count())\n"
    )
    terminal, end = pty.openpty()
    process = subprocess.Popen([sys.executable, "-c", code], stdin=end, stdout=end, stderr=end)
    os.close(end)
    output = b""
    with suppress(OSError):  # the end of a terminal
        while part := os.read(terminal, 1024):
            output += part
    os.close(terminal)
    assert process.wait() == 0
    assert b"diagnosing: first step" in output and b"1\r\n" in output
