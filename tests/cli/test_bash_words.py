"""Completion in bash of words with a colon, by the script that bash sources."""

import os
import shutil
import subprocess
import sys

import pytest

from edl_filter.cli.bash_words import joined_words

PROGRAM = f"{sys.executable} -c 'from edl_filter.cli import main; main()'"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run", "miss"], (["run", "miss"], 1, False)),
        (["run", "builtin", ":", "mer"], (["run", "builtin:mer"], 1, True)),
        (["run", "builtin", ":"], (["run", "builtin:"], 1, True)),
        (["run", "builtin", ":", "mer_a", "--"], (["run", "builtin:mer_a", "--"], 2, False)),
        (["new", "--from", "=", "builtin", ":", "p"], (["new", "--from=builtin:p"], 1, True)),
        ([""], ([""], 0, False)),
    ],
)  # fmt: skip
def test_words_are_joined_at_colons_and_equals_signs(words, expected):
    joined, position, divided = joined_words(["edl-filter", *words], len(words))
    assert (joined[1:], position - 1, divided) == expected


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash on the path")
@pytest.mark.parametrize(
    ("words", "replies"),
    [
        (["run", "builtin", ":", "mer"], ["mer_a", "mer_b"]),  # bash replaces what follows the colon
        (["run", "builtin:mer"], ["builtin:mer_a", "builtin:mer_b"]),  # where COMP_WORDBREAKS has no colon
        (["new", "--from", "=", "builtin", ":", "phoe"], ["phoenix"]),
        (["simulate", "builtin", ":", "m"], ["mer"]),
        (["run", "builtin", ":", "mer_a", "--dry"], ["--dry-run"]),
        (["fetch", ""], ["mer-imu"]),
        (["export", "results", "--to", "c"], ["csv", "ck"]),
        (["vali"], ["validate"]),
    ],
)
def test_completion_by_the_script_of_bash(words, replies, tmp_path):
    program = tmp_path / "edl-filter"
    program.write_text(f'#!/bin/sh\nexec {PROGRAM} "$@"\n')
    program.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    source = {"_EDL_FILTER_COMPLETE": "source_bash"}
    script = subprocess.run([program], env=environment | source, capture_output=True, text=True, check=True).stdout
    quoted = " ".join(f"'{word}'" for word in ("edl-filter", *words))
    script += f"\nCOMP_WORDS=({quoted}); COMP_CWORD={len(words)}; _edl_filter_completion edl-filter"
    script += '\nprintf "%s\\n" "${COMPREPLY[@]}"'
    output = subprocess.run(
        ["bash", "--norc", "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert sorted(output.stdout.split()) == sorted(replies), output.stderr
