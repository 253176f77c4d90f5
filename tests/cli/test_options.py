"""Completion of commands, options and names in a shell."""

import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("words", "completions"),
    [
        ("edl-filter vali", ["validate"]),
        ("edl-filter run builtin:practice_m", ["builtin:practice_mer"]),
        ("edl-filter add m.yaml remnant", ["remnant_torque"]),
        ("edl-filter run --dry", ["--dry-run"]),
    ],
)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion(shell, words, completions):
    """The protocol of the CLI library, which its scripts for the shells use."""
    environment = os.environ | {
        "_EDL_FILTER_COMPLETE": f"complete_{shell}", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1),
        "_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }  # fmt: skip
    call = [sys.executable, "-c", "from edl_filter.cli import main; main()"]
    output = subprocess.run(call, env=environment, capture_output=True, text=True, check=False).stdout
    for completion in completions:
        assert completion.replace(":", "\\\\:" if shell == "zsh" else ":") in output
    assert len(output.splitlines()) == len(completions) or shell == "zsh"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_is_printed(shell):
    environment = os.environ | {"_EDL_FILTER_COMPLETE": f"source_{shell}"}
    call = [sys.executable, "-c", "from edl_filter.cli import main; main()"]
    script = subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout
    assert "edl-filter" in script and "_EDL_FILTER_COMPLETE=complete_" + shell in script
