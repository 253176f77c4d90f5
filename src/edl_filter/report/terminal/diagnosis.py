"""A diagnosis on the terminal: where the model fails, which effect is missing, what to type next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from edl_filter.report.terminal import with_sigma
from edl_filter.report.terminal.console import echo, table

#: Normalised RMS that is called noise.
_NOISE = 1.1
#: Failing cells that are shown: a person reads no more.
_ROWS = 8
#: Onsets that are told.
_ONSETS = 3


def print_diagnosis(told: Mapping[str, Any], written: Sequence[str], following: Sequence[str]) -> None:
    """Print a diagnosis.

    Parameters
    ----------
    told : dict
        The content of ``diagnosis.json``.
    written : sequence of str
        Paths, one line each.
    following : sequence of str
        Commands to type next.
    """
    colour = {"clean": "green", "missing": "yellow"}.get(told["verdict"], "red")
    parts: list[str | Table] = [f"[bold {colour}]{escape(told['sentence'])}[/bold {colour}]"]
    if told["effects"]:
        parts.append(f"In the model: {', '.join(told['effects'])}.")
    parts.append(where_table(told) if told["where"] else "No channel fails in any regime.")
    parts += [onset_text(told)] if told["onsets"] else []
    parts.append(ranking_table(told))
    for entry in told["ranking"]:
        parts += [f"{entry['effect']} or {name}: {escape(text)}." for name, text in entry["parted_by"].items()]
    if told["remainder"] is not None:
        parts.append(f"What is left: {escape(told['remainder']['description'])}")
        parts.append("Write it as an effect of your own (docs/effects.md), then diagnose with --file my_effect.py.")
    parts += [f"[red]Left out: {escape(reason)}[/red]" for reason in told["failed"].values()]
    echo(*parts, *(f"Written: {escape(path)}" for path in written))
    if following:
        echo("Next:", *(f"  {escape(command)}" for command in following))


def print_comparison(told: Mapping[str, Any]) -> None:
    """Print results side by side, as `diagnosis.side_by_side` gives them."""
    results = told["results"]
    names = [f"{k + 1}" for k in range(len(results))]
    echo(*(f"{k}: {escape(r['path'])}{_verdict(r)}" for k, r in zip(names, results, strict=True)))
    errors = table("Normalised RMS by channel (1: the model holds)", ("channel",), (*names, "fall"))
    for channel, fall in told["fall_percent"].items():
        values = [number(r["residuals"].get(channel)) for r in results]
        ends = [results[k]["residuals"].get(channel) for k in (0, -1)]
        quiet = all(v is not None and v < _NOISE for v in ends)  # a fall within the noise says nothing
        errors.add_row(channel.replace("_", " "), *values, "–" if fall is None or quiet else f"{fall:.1f} %")
    nis = table("Constraints: NIS per dof", ("constraint",), tuple(names))
    for name in dict.fromkeys(n for r in results for n in r["nis_per_dof"]):
        nis.add_row(name.replace("_", " "), *(number(r["nis_per_dof"].get(name)) for r in results))
    effects = table("Effects in the model", ("effect",), after=tuple(names))
    known = list(dict.fromkeys(n for r in results for n in r["effects"]))
    for name in known:
        effects.add_row(name, *(parameters_text(r["effects"].get(name, {}).get("parameters", {})) for r in results))
    echo(errors, nis, effects if known else "No effects in any of the models.")
    for k, r in zip(names, results, strict=True):
        if r["score_gain"] is not None:
            echo(f"Held-out gain of {k} over the one before: {number(r['score_gain'])} nats.")


def _verdict(result: Mapping[str, Any]) -> str:
    return "" if result["verdict"] is None else f" (diagnosed: {result['verdict']})"


def print_identifiability(told: Mapping[str, Any]) -> None:
    """Print what `diagnosis.identifiability` found."""
    made = table(
        "Smallest size that would be found (6 nats), beside the plausible one",
        ("effect", "parameter"),
        ("smallest", "plausible", "ratio"),
        ("confused with",),
    )
    for effect in told["effects"]:
        alike = ", ".join(f"{name} ({r:.2f})" for name, r in effect["confused_with"].items())
        for k, (name, value) in enumerate(effect["parameters"].items()):
            unit = f" {value['unit']}" if value["unit"] else ""
            made.add_row(
                effect["effect"] if k == 0 else "",
                name,
                "none" if value["smallest"] is None else f"{value['smallest']:.2g}{unit}",
                f"{value['plausible']:.2g}",
                "–" if value["ratio"] is None else f"{value['ratio']:.2g}",
                alike if k == 0 else "",
            )
    model = told["in_model"]
    lines = [f"[red]Left out: {escape(reason)}[/red]" for reason in told["failed"].values()]
    echo(made, f"In the model already: {', '.join(model)}." if model else "", *lines)
    echo("A ratio above 1: an effect of plausible size would not be found on this flight.")


def where_table(told: Mapping[str, Any]) -> Table:
    """Cells that fail, worst first."""
    cells = told["where"]
    more = f" (the worst {_ROWS} of {len(cells)})" if len(cells) > _ROWS else ""
    heads = ("from s", "to s", "sigmas", "beyond noise", "database")
    made = table(f"Where it fails{more}", ("channel", "regime"), heads)
    for cell in cells[:_ROWS]:
        matters = cell["over_database_sigma"]
        made.add_row(
            cell["channel"].replace("_", " "),
            cell["regime"],
            f"{cell['t0_s']:.0f}",
            f"{cell['t1_s']:.0f}",
            number(cell["normalised_rms"]),
            f"{number(cell['beyond_noise'])} {cell['unit']}",
            "–" if matters is None or not math.isfinite(matters) else f"{number(matters)} sigma",
        )
    return made


def onset_text(told: Mapping[str, Any]) -> str:
    """When the clearest channels begin to fail."""
    said = [f"{o['channel'].replace('_', ' ')} from {o['time_s']:.1f} s" for o in told["onsets"][:_ONSETS]]
    more = len(told["onsets"]) - len(said)
    return f"It begins: {', '.join(said)}{f', and {more} more' if more else ''}."


def ranking_table(told: Mapping[str, Any]) -> Table:
    """Hypotheses, most probable first, with none and something else below them."""
    made = table(
        "Hypotheses (gains in nats; held-out: on data that were not fitted)",
        ("effect",),
        ("probability", "gain", "held-out"),
        ("parameters", "error before → after"),
    )
    for entry in told["ranking"]:
        made.add_row(
            " or ".join((entry["effect"], *entry["same_as"])),
            chance(entry["probability"]),
            number(entry["gain"]),
            number(entry["score_gain"]),
            parameters_text(entry["parameters"]),
            f"{entry['channel'].replace('_', ' ')} {number(entry['error_before'])} → {number(entry['error_after'])}",
        )
    made.add_section()
    other = told["something_else"]
    made.add_row("nothing is missing", chance(told["none"]), number(told.get("none_gain", 0.0)), "–", "", "")
    made.add_row("something else", chance(other["probability"]), number(other["score_gain"]), "–", "", "")
    return made


def parameters_text(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Estimates with sigmas and units, a line each; what has no finite value is left out."""
    lines = []
    for name, value in parameters.items():
        if value["estimate"] is None or not math.isfinite(value["estimate"]):
            continue
        unit = f" {value['unit']}" if value["unit"] else ""
        lines.append(f"{name} {with_sigma(value['estimate'], value['sigma'])}{unit}")
    return "\n".join(lines)


def chance(probability: float) -> str:
    """A probability in two digits, or that it is next to one or nothing."""
    if probability > 0.999:
        return "> 0.999"
    return "< 0.001" if probability < 0.001 else f"{probability:.3f}"


def number(value: float | None) -> str:
    """Three digits, in full as far as a person reads them."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value:.3g}"
