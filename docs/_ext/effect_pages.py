"""The catalogue of effects in full, from the declarations."""

from __future__ import annotations

from itertools import groupby
from typing import Any


def effects_text(name: str = "") -> str:
    """Markdown of the catalogue by family, or of the effect `name` alone."""
    from edl_filter.effects.registry import catalogue
    from edl_filter.effects.tables import as_plain

    declarations = [as_plain(effect) for key, effect in catalogue().items() if name in ("", key)]
    text = []
    for family, effects in groupby(declarations, key=lambda e: e["family"]):
        text.append(f"## {family.capitalize()}" if family else "## Effects")
        text += [_effect(effect) for effect in effects]
    return "\n\n".join(text)


def catalogue_table() -> str:
    """Markdown table of the catalogue for docs/effects.md, one row for each effect."""
    from edl_filter.effects.registry import catalogue
    from edl_filter.effects.tables import parameters_text

    rows = ["| effect | what it is | parameters, plausible size (1 sigma) or range | how it shows | source |"]
    rows.append("|---|---|---|---|---|")
    for e in catalogue().values():
        cells = (f"`{e.name}`", e.summary, parameters_text(e, "`"), e.shows, e.source)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _effect(effect: dict[str, Any]) -> str:
    lines = [f"### `{effect['name']}`", _sentence(effect["summary"]), f"How it shows: {_sentence(effect['shows'])}"]
    if effect["region"]:
        lines.append(f"Where it acts: {effect['region']}.")
    rows = ["| parameter | unit | what it is | plausible size or range | default |", "|---|---|---|---|---|"]
    rows += [
        f"| `{q['name']}` | {q['unit'] or '–'} | {q['description']} | {_range(q)} | {_default(q)} |"
        for q in effect["parameters"]
    ]
    return "\n\n".join([*lines, "\n".join(rows), f"Source: {_sentence(effect['source'])}"])


def _sentence(text: str) -> str:
    text = text.strip().replace("*", "\\*")
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else text + "."


def _range(q: dict[str, Any]) -> str:
    if q["kind"] == "size":
        return f"± {q['sigma']:g} (1 sigma)"
    if q["low"] is None or q["high"] is None:
        return f"{q['kind']}, in the flight"
    return f"{q['kind']}, {q['low']:g} to {q['high']:g}"


def _default(q: dict[str, Any]) -> str:
    return "never" if q["default"] is None else f"{q['default']:g}"
