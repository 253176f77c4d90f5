"""Notebook cards of a mission, a result, a diagnosis and an effect: short HTML tables.

Colours are those of the text around them, so that a dark notebook is as readable as a light one; all text is escaped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from edl_filter.effects.tables import size_text
from edl_filter.report.text import (
    fixed_digits,
    none_gain_sentence,
    number,
    parameters_text,
    ranking_rows,
    readable,
    state_sentences,
    with_sigma,
    words,
)  # fmt: skip
from edl_filter.results.files import finite
from edl_filter.results.schema import DiagnosisContent, Summary

if TYPE_CHECKING:
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.effects.base import Effect, EffectInstance
    from edl_filter.mission import Mission
    from edl_filter.results.result import Result

#: Largest number of failing cells in a card.
_ROWS = 6
_LINE = "border-bottom:1px solid rgba(128,128,128,.35)"
_CELL = f"padding:.15em .8em .15em 0;text-align:left;vertical-align:top;background:none;color:inherit;{_LINE}"


def mission_card(mission: Mission) -> str:
    """Name, telemetry and model."""
    vehicle = mission.vehicle
    mass = f"{with_sigma(vehicle.mass, vehicle.mass_sigma)} kg" if vehicle.mass_sigma else f"{vehicle.mass:g} kg"
    aero = mission.aerodynamics
    constraints = [
        words(name) for name in type(mission.constraints).model_fields if getattr(mission.constraints, name) is not None
    ]
    rows = [
        ("mission", mission.name),
        ("planet", mission.planet.name),
        ("telemetry", mission.telemetry.format),
        ("vehicle", f"{mass}, diameter {vehicle.diameter:g} m"),
        ("aerodynamic database", "none" if aero is None else aero.continuum),
        ("preflight density", f"known to {100.0 * mission.atmosphere.density_sigma:g} % (1 sigma)"),
        ("constraints", ", ".join(constraints) or "none"),
        ("effects in the model", _effects(mission.active_effects())),
    ]
    return _card(mission.title or mission.name, _table((), rows))


def result_card(result: Result) -> str:
    """Events with sigmas, and how the constraints agree."""
    summary = Summary.of(finite(result.summary()))
    events = [
        (
            words(name),
            f"{e.time_s:.2f}",
            _in_km(e.altitude_m, e.altitude_sigma_m),
            with_sigma(e.velocity_m_s, e.velocity_sigma_m_s),
            fixed_digits(e.mach, 2),
            with_sigma(e.alpha_total_deg, e.alpha_total_sigma_deg),
        )
        for name, e in summary.events.items()
    ]
    heads = ("event", "time (s)", "altitude (km)", "velocity (m/s)", "Mach", "total angle (°)")
    constraints = [
        (
            words(name),
            f"{c.accepted_uses} of {c.uses}",
            f"{c.nis:.1f} of {c.dof}" if c.dof and c.nis is not None else "–",
            "–" if c.consistent is None else ("as stated" if c.consistent else "outside its 99.9 % interval"),
        )
        for name, c in summary.constraints.items()
    ]
    parts = [_table(heads, events)]
    if constraints:
        parts.append(_table(("constraint", "accepted", "NIS of dof", "agrees"), constraints))
    if summary.effects:
        rows = [
            (name, parameters_text(e.parameters) + (", held" if e.fixed else "")) for name, e in summary.effects.items()
        ]
        parts.append(_table(("effect in the model", "parameters"), rows))
    return _card(f"{summary.title or summary.mission}, epoch {summary.epoch_utc} UTC", *parts)


def _in_km(value: float | None, sigma: float | None) -> str:
    return with_sigma(None if value is None else 1e-3 * value, None if sigma is None else 1e-3 * sigma)


def diagnosis_card(diagnosis: Diagnosis) -> str:
    """Verdict, hypotheses, the worst failures and the remainder."""
    content = DiagnosisContent.of(diagnosis.content())
    heads = ("hypothesis", "probability", "gain (nats)", "held out (nats)", "parameters", "normalised RMS")
    first, *qualifying = state_sentences(content)
    parts = [_text(first, bold=True), *map(_text, qualifying)]
    if content.effects:
        parts.append(_text(f"In the model: {', '.join(content.effects)}."))
    cells = content.where
    if cells:
        failing = [
            (
                words(c.channel), c.regime, f"{c.t0_s:.0f} to {c.t1_s:.0f}", number(c.normalised_rms),
                f"{number(c.excess_rms)} {readable(c.unit)}",
            )
            for c in cells[:_ROWS]
        ]  # fmt: skip
        more = f" (worst {_ROWS} of {len(cells)})" if len(cells) > _ROWS else ""
        parts.append(_table((f"fails{more}", "regime", "time (s)", "normalised RMS", "beyond noise"), failing))
    else:
        parts.append(_text("No channel fails in any regime."))
    parts.append(_table(heads, ranking_rows(content)))
    if reason := none_gain_sentence(content):
        parts.append(_text(reason))
    if content.remainder is not None:
        parts.append(_text(f"What is left: {content.remainder.description}"))
    parts += [_text(f"Left out: {reason}") for reason in content.failed.values()]
    return _card(diagnosis.title, *parts)


def effect_card(effect: Effect) -> str:
    """Declarations of an effect."""
    rows = [(q.name, q.description, size_text(q)) for q in effect.parameters]
    parts = [_text(f"{effect.summary} ({effect.family}; {effect.region})")]
    parts += [_text(f"Shows: {effect.shows}")] if effect.shows else []
    parts.append(_table(("parameter", "meaning", "plausible size (1 sigma) or range"), rows))
    parts += [_text(f"Source: {effect.source}")] if effect.source else []
    return _card(effect.name, *parts)


def catalogue_card(effects: Mapping[str, Effect]) -> str:
    """One row for each effect."""
    rows = [(e.name, e.family, e.summary, ", ".join(q.name for q in e.parameters)) for e in effects.values()]
    return _card("Effects that a model may lack", _table(("effect", "family", "what it is", "parameters"), rows))


def _effects(effects: Sequence[EffectInstance]) -> str:
    lines = []
    for a in effects:
        units = {q.name: q.unit for q in a.effect.parameters}
        values = [f"{n} = {v:.4g} {units[n]}".rstrip() for n, v in a.values.items() if v and math.isfinite(v)]
        lines.append(f"{a.name} ({', '.join(values) or 'off'})")
    return "\n".join(lines) or "none"


def _card(title: str, *parts: str) -> str:
    head = f'<div style="font-weight:600;margin-bottom:.3em">{escape(title)}</div>'
    return f'<div style="color:inherit;max-width:70em">{head}{"".join(parts)}</div>'


def _text(text: str, bold: bool = False) -> str:
    weight = ";font-weight:600" if bold else ""
    return f'<div style="margin:.3em 0{weight}">{escape(text)}</div>'


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose cells are plain text with line breaks."""
    top = "".join(f'<th scope="col" style="{_CELL};font-weight:600">{escape(h)}</th>' for h in heads)
    body = "".join(
        '<tr style="background:none">'
        + "".join(f'<td style="{_CELL}">{escape(cell).replace(chr(10), "<br>")}</td>' for cell in row)
        + "</tr>"
        for row in rows
    )
    head = f'<thead><tr style="background:none">{top}</tr></thead>' if heads else ""
    return f'<table style="border-collapse:collapse;margin:.4em 0;font-size:90%">{head}<tbody>{body}</tbody></table>'
