"""Replacement of ``<!-- generated: KIND NAME -->`` in pages by Markdown from the declarations of the package.

The text is generated while Sphinx reads the page and is not written to a file, so it cannot be out of date.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from command_pages import commands_text
from effect_pages import effects_text
from file_pages import build_finished, file_text
from mission_keys import keys_text
from notebook_pages import notebook_text

if TYPE_CHECKING:  # the tests use this without Sphinx
    from sphinx.application import Sphinx

PLACEHOLDER = re.compile(r"^<!-- generated: (?P<kind>[a-z]+)(?: (?P<name>[\w.]+))? -->$", re.MULTILINE)


def _mission(_: str) -> str:
    from edl_filter.mission import Mission

    return keys_text(Mission)


def _scenario(_: str) -> str:
    from edl_filter.simulation import Scenario

    return keys_text(Scenario)


def _campaign(_: str) -> str:
    from edl_filter.simulation.campaign_config import Campaign

    return keys_text(Campaign)


KINDS: dict[str, Callable[[str], str]] = {
    "campaign": _campaign,
    "commands": lambda _: commands_text(),
    "effects": effects_text,
    "file": file_text,
    "mission": _mission,
    "notebook": notebook_text,
    "scenario": _scenario,
}


def fill(text: str, page: str) -> str:
    """`text` of the `page` with all placeholders replaced.

    Raises
    ------
    ValueError
        A placeholder has an unknown kind.
    """

    def generated(placeholder: re.Match[str]) -> str:
        kind = placeholder["kind"]
        if kind not in KINDS:
            raise ValueError(f"{page}: found 'generated: {kind}'; accepted are {', '.join(KINDS)}.")
        return KINDS[kind](placeholder["name"] or "")

    return PLACEHOLDER.sub(generated, text)


def _read(_: Sphinx, page: str, source: list[str]) -> None:
    source[0] = fill(source[0], page)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    app.connect("source-read", _read)
    app.connect("build-finished", build_finished)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
