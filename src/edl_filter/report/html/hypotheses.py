"""Which effect is missing: the hypotheses with sizes, what they are confused with, and how to add each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from edl_filter.report.html.blocks import Block, Cell, Command, Details, Note, Section, Table
from edl_filter.report.html.commands import add, diagnose, mission_name
from edl_filter.report.html.source import Source
from edl_filter.report.html.words import readable
from edl_filter.report.terminal.diagnosis import chance, number, parameters_text

_KEY, _TITLE = "hypotheses", "Which effect is missing"


def hypotheses(source: Source) -> Section:
    """Hypotheses, most probable first; what else was tried opens below them."""
    told = source.diagnosis
    blocks: list[Block] = list(_in_model(source))
    if not told:
        return Section(_KEY, _TITLE, [*blocks, Note("No hypotheses without a diagnosis:"), Command(diagnose(source))])
    if told["ranking"]:
        mission = mission_name(source)
        blocks += [_ranking(told), Note("To add one of them:")]
        blocks += [Command(add(source, mission, entry)) for entry in told["ranking"]]
    else:
        blocks.append(Note("No effect of the catalogue gains enough to be refitted."))
    blocks += [
        Note(f"{entry['effect']} or {name}: {text}.")
        for entry in told["ranking"]
        for name, text in entry.get("parted_by", {}).items()
    ]
    blocks.append(
        Note(
            "Gain is the logarithm of the evidence over the model as it is at the noise that it shows (nats; from 6 on "
            "an effect is found), so that nothing is missing loses what is to be called noise then; held-out gain is "
            "on data that were not fitted. ± is one sigma.",
            "muted",
        )
    )
    blocks += [Note(f"Left out: {reason}", "warning") for reason in told.get("failed", {}).values()]
    if told.get("undecided"):
        blocks.append(Details(f"Also tried, and not refitted ({len(told['undecided'])})", [_tried(told["undecided"])]))
    return Section(_KEY, _TITLE, blocks)


def _in_model(source: Source) -> list[Table]:
    """Effects that the run has, at their estimates."""
    effects = source.summary.get("effects") or {}
    rows = [[name, readable(parameters_text(e["parameters"])), "kept fixed" if e.get("fixed") else "refitted"]
            for name, e in effects.items()]  # fmt: skip
    return [Table("In the model", ("effect", "size", ""), rows, texts=3)] if rows else []


def _ranking(told: Mapping[str, Any]) -> Table:
    rows: list[tuple[float, list[Cell]]] = []
    for entry in told["ranking"]:
        fall = f"{number(entry['error_before'])} → {number(entry['error_after'])}"
        row: list[Cell] = [
            str(entry["effect"]),
            chance(entry["probability"]),
            readable(number(entry["gain"])),
            readable(number(entry["score_gain"])),
            readable(parameters_text(entry["parameters"])),
            " or ".join(entry["same_as"]) or "nothing",
            f"{entry['channel'].replace('_', ' ')}\n{fall}",
        ]
        rows.append((entry["probability"], row))
    other = told["something_else"]
    none, unnamed = (readable(number(gain)) for gain in (told.get("none_gain"), other["score_gain"]))
    nothing: list[Cell] = ["nothing is missing", chance(told["none"]), none, "–", *[""] * 3]
    something: list[Cell] = ["something else", chance(other["probability"]), unnamed, "–", _something(other), "", ""]
    rows += [(told["none"], nothing), (other["probability"], something)]
    rows.sort(key=lambda one: -one[0])  # stable: of equals the one with the most evidence stays before
    heads = ("effect", "probability", "gain (nats)", "held-out gain", "size", "confused with",
             "normalised RMS")  # fmt: skip
    return Table("Hypotheses, most probable first", heads, [row for _, row in rows], wide=(4, 5, 6))


def _something(other: Mapping[str, Any]) -> str:
    """Size of a force and moment that nobody named."""
    force, turn = other.get("force_m_s2"), other.get("angular_acceleration_rad_s2")
    if force is None or turn is None:
        return ""
    return f"typically {number(force)} m/s²\nand {number(turn)} rad/s²"


def _tried(undecided: Mapping[str, Any]) -> Table:
    rows = [
        [name, readable(number(e["gain"])), _linear(e["parameters"])]
        for name, e in sorted(undecided.items(), key=lambda item: -_finite(item[1]["gain"]))
    ]
    return Table("Effects as linear estimates", ("effect", "gain (nats)", "size, SI units"), rows, wide=(2,))


def _linear(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    return parameters_text({name: {"unit": ""} | dict(value) for name, value in parameters.items()})


def _finite(value: float | None) -> float:
    return -math.inf if value is None or not math.isfinite(value) else value
