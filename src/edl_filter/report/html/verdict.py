"""First things: the verdict in one sentence, what warns of it, and the events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from edl_filter.report.html.blocks import Block, Note, Section, Table
from edl_filter.report.html.commands import diagnose
from edl_filter.report.html.source import Source
from edl_filter.report.html.words import readable
from edl_filter.report.terminal import entry_sentence, landing_sentence, peak_sentence, warnings

#: Verdict → sign, tone and the word before the sentence.
_WORDS = {"clean": ("✓", "good"), "missing": ("▲", "doubt"), "unknown": ("?", "bad")}


@dataclass(frozen=True)
class Verdict:
    """What stands at the top of the page.

    Attributes
    ----------
    sign, tone : str
    sentence : str
    more : list of str
        What should be read with it.
    command : str
        What gives a verdict; empty where there is one.
    """

    sign: str
    tone: str
    sentence: str
    more: list[str]
    command: str = ""


def verdict(source: Source) -> Verdict:
    """The verdict of the diagnosis, or that there is none yet."""
    constraints = source.summary.get("constraints", {})
    more = warnings(constraints)
    told = source.diagnosis
    if not told:
        return Verdict("–", "none", f"Not diagnosed yet: {_agreement(constraints)}.", more, diagnose(source))
    sign, tone = _WORDS.get(told["verdict"], ("?", "bad"))
    if told.get("effects"):
        more.append(f"In the model: {', '.join(told['effects'])}.")
    if told.get("remainder"):
        more.append(f"What is left: {readable(told['remainder']['description'])}")
    if source.ledger and source.ledger[-1].get("why"):
        more.append(readable(str(source.ledger[-1]["why"])))
    return Verdict(sign, tone, str(told["sentence"]), more)


def _agreement(constraints: dict[str, Any]) -> str:
    if not constraints:
        return "this folder has no summary of the reconstruction"
    bad = [name.replace("_", " ") for name, c in constraints.items() if not c["accepted"] or c["consistent"] is False]
    said = f"all {len(constraints)} constraints agree with it"
    if bad:
        said = f"{len(bad)} of {len(constraints)} constraints disagree with it ({', '.join(bad)})"
    return f"the flight is reconstructed, and {said}"


def events(source: Source) -> Section:
    """Events in order of time, and the sentences that a run ends with."""
    found, told = source.summary.get("events", {}), source.summary
    if not found:
        return Section(
            "events", "Events", [Note("There are none: the folder has no summary.json with events.", "muted")]
        )
    heads = ("event", "UTC", "time (s)", "altitude (km)", "over site (km)", "velocity (m/s)", "flight path (°)",
             "Mach", "q (Pa)", "α total (°)")  # fmt: skip
    rows = [_event(name, found[name]) for name in source.events]
    blocks: list[Block] = [Table("", heads, rows, texts=2)]
    if "acceleration_single_m_s2" in found.get("peak_deceleration", {}):
        blocks.append(Note(peak_sentence(found["peak_deceleration"])))
    if told.get("landing", {}).get("miss_m") is not None:
        blocks.append(Note(landing_sentence(told["landing"])))
    if told.get("entry_state"):
        blocks.append(Note(entry_sentence(told["entry_state"])))
    blocks.append(
        Note(
            f"Epoch {str(told.get('epoch_utc', 'unknown')).replace('T', ' ')} UTC. ± is one sigma; velocity and flight "
            "path are relative to the air.",
            "muted",
        )
    )
    return Section("events", "Events", blocks)


def _event(name: str, e: dict[str, Any]) -> list[str]:
    return [
        name.replace("_", " "),
        str(e.get("utc", "")).partition("T")[2][:12],
        _fixed(e.get("time_s"), 2),
        _with(e.get("altitude_m"), e.get("altitude_sigma_m"), 1e-3, 2),
        _fixed(e.get("height_above_site_m"), 2, 1e-3),
        _with(e.get("velocity_m_s"), e.get("velocity_sigma_m_s"), 1.0, 1),
        _fixed(e.get("flight_path_deg"), 1),
        _fixed(e.get("mach"), 2),
        "" if e.get("dynamic_pressure_pa") is None else f"{e['dynamic_pressure_pa']:.3g}"
        if e["dynamic_pressure_pa"] < 1.0 else f"{e['dynamic_pressure_pa']:.0f}",
        _with(e.get("alpha_total_deg"), e.get("alpha_total_sigma_deg"), 1.0, 1),
    ]  # fmt: skip


def _fixed(value: float | None, digits: int, scale: float = 1.0) -> str:
    return "" if value is None else f"{scale * value:.{digits}f}".replace("-", "−")


def _with(value: float | None, sigma: float | None, scale: float, digits: int) -> str:
    """Value and sigma with as many digits as show the sigma."""
    if value is None:
        return ""
    if sigma is None:
        return _fixed(value, digits, scale)
    while digits < 4 and round(scale * sigma, digits) == 0.0:
        digits += 1
    return f"{_fixed(value, digits, scale)} ± {scale * sigma:.{digits}f}"
