"""Completion in bash of words with a colon, such as ``builtin:mer_a``.

bash divides the command line at the characters of ``COMP_WORDBREAKS``, which contain the colon and the equals sign: the
word before the cursor is ``mer_`` where ``builtin:mer_`` is typed, and a completion replaces that part only. The
completion of typer expects whole words.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout

_BREAKS = (":", "=")


def complete_whole_words(complete: Callable[[], None]) -> None:
    """Complete the words of a bash command line, joined again at colons and equals signs.

    Parameters
    ----------
    complete : callable
        Prints one completion per line for the words in the environment, ``COMP_WORDS`` (one per line) and
        ``COMP_CWORD``, and may raise SystemExit.
    """
    words, position, divided = joined_words(os.environ["COMP_WORDS"].split("\n"), int(os.environ["COMP_CWORD"]))
    if not divided:
        complete()
        return
    os.environ["COMP_WORDS"], os.environ["COMP_CWORD"] = "\n".join(words), str(position)
    value = words[position].rpartition("=")[2]
    known = value[: value.rfind(":") + 1]
    output = io.StringIO()
    try:
        with redirect_stdout(output):
            complete()
    finally:
        for line in output.getvalue().splitlines():
            sys.stdout.write(line.removeprefix(known) + "\n")


def joined_words(words: list[str], position: int) -> tuple[list[str], int, bool]:
    """Words as they were typed.

    Parameters
    ----------
    words : list of str
        As bash divides them, up to the end of the line.
    position : int
        Index of the word before the cursor.

    Returns
    -------
    words : list of str
        Up to the cursor.
    position : int
        Index of the word before the cursor among them.
    divided : bool
        Whether bash had divided that word.
    """
    joined: list[str] = []
    divided = False
    for k, word in enumerate(words[: position + 1]):
        divided = k > 1 and (word in _BREAKS or words[k - 1] in _BREAKS)
        if divided:
            joined[-1] += word
        else:
            joined.append(word)
    return joined, len(joined) - 1, divided
