"""A run and a check of telemetry on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from edl_filter.report.instruments import HEADS, instrument_tables
from edl_filter.report.sentences import (
    effect_lines,
    entry_sentence,
    finding_sentences,
    gas_sentence,
    landing_sentence,
    peak_sentence,
    postflight_lines,
    warnings,
)  # fmt: skip
from edl_filter.report.terminal.console import echo, empty_table
from edl_filter.report.terminal.table import Table
from edl_filter.report.text import (
    constraint_verdict,
    fixed_digits,
    information_text,
    interval_text,
    nis_text,
    pressure,
    sigmas_text,
    words,
)  # fmt: skip
from edl_filter.results.schema import Summary
from edl_filter.results.schema.summary import ConstraintSummary, EventState, SampleFindingSummary
from edl_filter.results.summary import finding_content

if TYPE_CHECKING:
    from edl_filter.telemetry.record import ImuRecord, Telemetry

#: Findings about samples that the terminal lists.
MOST_FINDINGS = 12

#: Tone of a judgement → colour, and the judgement in one word if it has one.
_TONES = {"good": ("green", "ok"), "doubt": ("yellow", ""), "bad": ("red", "")}


def print_run(written: Mapping[str, Any]) -> None:
    """Print a run's events, constraints, correction of the entry state, and the paths of its files.

    Parameters
    ----------
    written : mapping
        As `workflow.run.write_outputs` returns it.
    """
    summary = Summary.of(written["content"])
    peak = summary.events.get("peak_deceleration")
    alarm = "red" if not summary.trustworthy else "yellow"
    echo(
        *(f"[bold {alarm}]{escape(warning)}[/bold {alarm}]" for warning in warnings(summary)),
        f"[bold]{summary.title or summary.mission}[/bold], epoch {summary.epoch_utc} UTC",
        *_finding_lines(summary.sample_findings),
        events_table(summary.events),
        "" if peak is None else peak_sentence(peak),
        constraints_table(summary.constraints),
        information_table(summary.constraints),
        entry_sentence(summary.entry_state),
        landing_sentence(summary.landing),
        *_instruments(summary),
        *effect_lines(summary.effects),
        *postflight_lines(summary.postflight),
        "" if summary.gas is None else gas_sentence(summary.gas),
    )
    echo(
        f"Written in {sum(summary.timing_s.values()):.1f} s: {written['result']}",
        f"Summary: {written['summary']}",
        f"Report: {written['report']} (open it in a browser)",
        wrap=False,
    )


def _finding_lines(findings: Sequence[SampleFindingSummary]) -> list[str]:
    """Missing and bad samples, the first of many, under one heading."""
    if not findings:
        return []
    return ["[bold]Missing and bad samples[/bold]", *finding_sentences(findings, MOST_FINDINGS)]


def events_table(events: Mapping[str, EventState]) -> Table:
    """Events in order of time."""
    heads = ("time s", "altitude km", "over site km", "velocity m/s", "Mach", "q Pa", "alpha_t deg")
    table = empty_table("Events", ("event",), heads, optional=("over site km",))
    for name, e in events.items():
        table.add_row(
            words(name),
            f"{e.time_s:.2f}",
            f"{fixed_digits(e.altitude_m, 3, 1e-3)} ± {fixed_digits(e.altitude_sigma_m, 3, 1e-3)}",
            fixed_digits(e.height_above_site_m, 2, 1e-3),
            f"{fixed_digits(e.velocity_m_s, 1)} ± {fixed_digits(e.velocity_sigma_m_s, 1)}",
            fixed_digits(e.mach, 2),
            pressure(e.dynamic_pressure_pa),
            f"{fixed_digits(e.alpha_total_deg, 2)} ± {fixed_digits(e.alpha_total_sigma_deg, 2)}",
        )
    return table


def _instruments(summary: Summary) -> list[Table]:
    """Calibration of the IMUs; what is stated is in the report only, where there is room."""
    tables = []
    for title, rows in instrument_tables(summary).items():
        table = empty_table(title, HEADS[:1], HEADS[1:4])
        for row in rows:
            table.add_row(*row[:4])
        tables.append(table)
    return tables


def constraints_table(constraints: Mapping[str, ConstraintSummary]) -> Table:
    """Constraints: innovations in the forward pass, and differences from the predictions from all others."""
    heads = ("uses", "innovation", "NIS (dof)", "99.9 %", "left out", "its NIS")
    omissible = ("99.9 %", "its NIS", "uses")
    table = empty_table("Constraints (in sigmas)", ("constraint",), heads, last_texts=("",), optional=omissible)
    for name, c in constraints.items():
        table.add_row(
            words(name),
            f"{c.accepted_uses}/{c.uses}",
            sigmas_text(c.innovation, c.innovation_sigma),
            nis_text(c.nis, c.dof, 1),
            interval_text(c),
            sigmas_text(c.left_out, c.left_out_sigma),
            nis_text(c.left_out_nis, c.left_out_dof, 1),
            _judgement(*constraint_verdict(c)),
        )
    return table


def information_table(constraints: Mapping[str, ConstraintSummary]) -> Table:
    """Information gain of each constraint: over all measurements before it, and over all other constraints."""
    table = empty_table("Information gain (nats)", ("constraint",), ("over those before", "beyond all others"))
    for name, c in constraints.items():
        row = information_text(c.information_nats), information_text(c.left_out_information_nats)
        table.add_row(words(name), *row)
    return table


def _judgement(verdict: str, tone: str) -> str:
    if tone not in _TONES:
        return "–"
    colour, word = _TONES[tone]
    return f"[{colour}]{word or verdict.removeprefix('▲ ')}[/{colour}]"


def telemetry_lines(telemetry: Telemetry) -> list[str]:
    """Contents of telemetry, one line each."""
    lines = [f"epoch {telemetry.epoch_utc} UTC"]
    if telemetry.epoch_sclk is not None:
        lines[0] += f", SCLK {telemetry.epoch_sclk:.3f} s"
    lines.append(_imu_line("driving", telemetry.driving))
    lines += [_imu_line("checking", record) for record in telemetry.checking]
    if telemetry.attitude is not None:
        lines.append(f"on-board attitude: {len(telemetry.attitude.time)} quaternions")
    if telemetry.altimeter is not None:
        lines.append(f"altimeter: {len(telemetry.altimeter.time)} heights")
    stated = [name for name in ("initial", "landing", "parachute") if getattr(telemetry, name) is not None]
    if stated:
        lines.append(f"stated: {', '.join(stated)}")
    findings = [SampleFindingSummary.of(finding_content(f)) for f in telemetry.findings]
    return lines + list(telemetry.notes) + finding_sentences(findings, MOST_FINDINGS)


def _imu_line(role: str, record: ImuRecord) -> str:
    sources = [record.sources[k] for k in sorted(set(record.source.tolist()))]
    name = "" if record.name == role else f" ({record.name})"
    times = f"{record.start:.2f} to {record.time[-1]:.2f} s"
    return f"{role} IMU{name}: {len(record)} samples, {times} ({', '.join(sources)})"
