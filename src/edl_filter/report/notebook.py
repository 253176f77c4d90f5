"""What a notebook shows of a mission, a reconstruction, a diagnosis and an effect: short HTML tables.

Colours are those of the text around them, so that a dark notebook is as readable as a light one; all text is escaped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from edl_filter.diagnosis.diagnosis_json import diagnosis_content
from edl_filter.effects.tables import size_text
from edl_filter.report.terminal import with_sigma
from edl_filter.report.terminal.diagnosis import chance, number, parameters_text
from edl_filter.results.plain import finite

if TYPE_CHECKING:
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.effects.base import Effect, EffectInstance
    from edl_filter.mission import Mission
    from edl_filter.results.result import Result

#: Rows of failing cells: a person reads no more.
_ROWS = 6
_LINE = "border-bottom:1px solid rgba(128,128,128,.35)"
_CELL = f"padding:.15em .8em .15em 0;text-align:left;vertical-align:top;background:none;color:inherit;{_LINE}"


def mission_card(mission: Mission) -> str:
    """Name, what is measured, and the model."""
    vehicle = mission.vehicle
    mass = f"{with_sigma(vehicle.mass, vehicle.mass_sigma)} kg" if vehicle.mass_sigma else f"{vehicle.mass:g} kg"
    aero = mission.aerodynamics
    constraints = [
        name.replace("_", " ")
        for name in type(mission.constraints).model_fields
        if getattr(mission.constraints, name) is not None
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
    told = finite(result.summary())
    events = [
        (
            name.replace("_", " "),
            f"{e['time_s']:.2f}",
            f"{with_sigma(1e-3 * e['altitude_m'], 1e-3 * e['altitude_sigma_m'])}",
            f"{with_sigma(e['velocity_m_s'], e['velocity_sigma_m_s'])}",
            f"{e['mach']:.2f}",
            f"{with_sigma(e['alpha_total_deg'], e['alpha_total_sigma_deg'])}",
        )
        for name, e in told["events"].items()
    ]
    heads = ("event", "time (s)", "altitude (km)", "velocity (m/s)", "Mach", "total angle (°)")
    constraints = [
        (
            name.replace("_", " "),
            f"{c['accepted_uses']} of {c['uses']}",
            "–" if not c["dof"] else f"{c['nis']:.1f} of {c['dof']}",
            "–" if c["consistent"] is None else ("as stated" if c["consistent"] else "outside its 99.9 % interval"),
        )
        for name, c in told["constraints"].items()
    ]
    parts = [_table(heads, events)]
    if constraints:
        parts.append(_table(("constraint", "accepted", "NIS of dof", "agrees"), constraints))
    if result.effects:
        parts.append(_table(("effect in the model", "parameters"), _refitted(result)))
    return _card(f"{told['title'] or told['mission']}, epoch {told['epoch_utc']} UTC", *parts)


def diagnosis_card(diagnosis: Diagnosis) -> str:
    """Verdict, hypotheses, the worst failures and what is left."""
    told = diagnosis_content(diagnosis)
    ranking = [
        (
            " or ".join((e["effect"], *e["same_as"])),
            chance(e["probability"]),
            number(e["gain"]),
            number(e["score_gain"]),
            parameters_text(e["parameters"]),
            f"{e['channel'].replace('_', ' ')} {number(e['error_before'])} → {number(e['error_after'])}",
        )
        for e in told["ranking"]
    ]
    other = told["something_else"]
    ranking.append(("nothing is missing", chance(told["none"]), number(told["none_gain"]), "–", "", ""))
    ranking.append(("something else", chance(other["probability"]), number(other["score_gain"]), "–", "", ""))
    heads = ("hypothesis", "probability", "gain (nats)", "held out (nats)", "parameters", "normalised RMS")
    parts = [_text(told["sentence"], bold=True)]
    if told["effects"]:
        parts.append(_text(f"In the model: {', '.join(told['effects'])}."))
    cells = told["where"]
    if cells:
        failing = [
            (
                c["channel"].replace("_", " "), c["regime"], f"{c['t0_s']:.0f} to {c['t1_s']:.0f}",
                number(c["normalised_rms"]), f"{number(c['beyond_noise'])} {c['unit'].replace('^2', '²')}",
            )
            for c in cells[:_ROWS]
        ]  # fmt: skip
        more = f" (worst {_ROWS} of {len(cells)})" if len(cells) > _ROWS else ""
        parts.append(_table((f"fails{more}", "regime", "time (s)", "normalised RMS", "beyond noise"), failing))
    else:
        parts.append(_text("No channel fails in any regime."))
    parts.append(_table(heads, ranking))
    if told["remainder"] is not None:
        parts.append(_text(f"What is left: {told['remainder']['description']}"))
    parts += [_text(f"Left out: {reason}") for reason in told["failed"].values()]
    return _card(diagnosis.title, *parts)


def effect_card(effect: Effect) -> str:
    """What an effect declares."""
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


def _refitted(result: Result) -> list[tuple[str, str]]:
    rows = []
    for a in result.effects:
        sigma = result.refit.sigma.get(a.name, {})
        parameters = {
            q.name: {"estimate": a.values[q.name], "sigma": sigma.get(q.name), "unit": q.unit}
            for q in a.effect.parameters
        }
        rows.append((a.name, parameters_text(parameters) + (", held" if a.fixed else "")))
    return rows


def _effects(effects: Sequence[EffectInstance]) -> str:
    said = []
    for a in effects:
        units = {q.name: q.unit for q in a.effect.parameters}
        values = [f"{n} = {v:.4g} {units[n]}".rstrip() for n, v in a.values.items() if v and math.isfinite(v)]
        said.append(f"{a.name} ({', '.join(values) or 'off'})")
    return "\n".join(said) or "none"


def _card(title: str, *parts: str) -> str:
    head = f'<div style="font-weight:600;margin-bottom:.3em">{escape(title)}</div>'
    return f'<div style="color:inherit;max-width:70em">{head}{"".join(parts)}</div>'


def _text(text: str, bold: bool = False) -> str:
    weight = ";font-weight:600" if bold else ""
    return f'<div style="margin:.3em 0{weight}">{escape(text)}</div>'


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose cells are plain text; a line break in one is kept."""
    top = "".join(f'<th scope="col" style="{_CELL};font-weight:600">{escape(h)}</th>' for h in heads)
    body = "".join(
        '<tr style="background:none">'
        + "".join(f'<td style="{_CELL}">{escape(cell).replace(chr(10), "<br>")}</td>' for cell in row)
        + "</tr>"
        for row in rows
    )
    head = f'<thead><tr style="background:none">{top}</tr></thead>' if heads else ""
    return f'<table style="border-collapse:collapse;margin:.4em 0;font-size:90%">{head}<tbody>{body}</tbody></table>'
