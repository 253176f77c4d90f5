"""Labels and number formats of all output: figures, report, notebook cards and terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edl_filter.results.schema import DiagnosisContent
    from edl_filter.results.schema.diagnosis import OnsetContent, RankedHypothesis
    from edl_filter.results.schema.summary import ConstraintSummary

#: Labels of events, the most important first: where labels would overlap, the first has precedence.
EVENT_LABELS = {
    "parachute_deploy": "parachute",
    "landing": "landing",
    "peak_deceleration": "peak",
    "entry_interface": "entry",
    "heat_shield_separation": "heat shield",
    "backshell_separation": "backshell",
    "retro_rocket_fire": "rockets",
    "bridle_cut": "bridle cut",
}
REMAINDER_HINT = "Write it as an effect of your own (docs/effects.md), then diagnose with --file my_effect.py."
#: Number of onsets that a sentence lists.
_ONSETS = 3
#: Log evidence against a hypothesis beyond which its number says no more than that it is excluded, nats.
_EXCLUDED = 100.0
#: Largest power of ten of a number in positional notation, and largest number of digits of an estimate.
_POWER, _DIGITS = 6, 9
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def words(name: str) -> str:
    """Name of a channel, constraint or event as words."""
    return name.replace("_", " ")


def event_label(name: str) -> str:
    """Short label of an event."""
    return EVENT_LABELS.get(name, words(name))


def effect_names(names: Iterable[str]) -> str:
    """Effects that the flight does not distinguish, as one text."""
    return " or ".join(names)


def hypothesis_label(hypothesis: RankedHypothesis) -> str:
    """The effect of a hypothesis with those that the flight does not distinguish from it."""
    return effect_names((hypothesis.label, *hypothesis.same_as))


def undetectable_sentence(diagnosis: DiagnosisContent) -> str:
    """Effects that the flight would not show at a plausible size; empty if there is none.

    An effect is counted where the smallest detectable value of each of its sizes exceeds the plausible one.
    """
    ratios = {}
    for label, screened in diagnosis.screening.items():
        sizes = [p for p in screened.parameters.values() if p.plausible]
        detectable = [p.smallest / p.plausible for p in sizes if p.smallest is not None and p.plausible is not None]
        if sizes and min(detectable, default=math.inf) > 1.0:
            ratios[label] = min(detectable, default=math.inf)
    if not ratios:
        return ""
    listed = ", ".join(
        label if math.isinf(ratio) else f"{label} ({number(ratio)})"
        for label, ratio in sorted(ratios.items(), key=lambda item: item[1])
    )
    if len(ratios) == len(diagnosis.screening):
        return (
            "With these sigmas nothing could be found: no effect is detectable at a plausible size. Smallest "
            f"detectable sizes, relative to plausible ones: {listed}."
        )
    return f"Not detectable at a plausible size on this flight (detectable over plausible size): {listed}."


def state_sentences(diagnosis: DiagnosisContent) -> list[str]:
    """The state of a flight: how much fails with the verdict, and what qualifies it."""
    count, verdict, *more = map(readable, diagnosis.state)
    return [f"{count} {verdict}", *more]


def none_gain_text(diagnosis: DiagnosisContent) -> str:
    """Gain of the hypothesis that nothing is missing; a hopeless one in words, which `none_gain_sentence` explains."""
    return "excluded" if _is_excluded(diagnosis) else gain_text(diagnosis.none_gain)


def none_gain_sentence(diagnosis: DiagnosisContent) -> str:
    """Why it is excluded that nothing is missing; empty where it is not."""
    if not _is_excluded(diagnosis):
        return ""
    nats = _with_thousands(-(diagnosis.none_gain or 0.0))
    return (
        f"“Nothing is missing” is excluded, by a log evidence of {nats} nats: the residuals show more noise than is "
        "stated, or a nuisance parameter would have to be many of its sigmas from its stated value."
    )


def limited_probability_sentence(diagnosis: DiagnosisContent) -> str:
    """Why something else is more probable than an effect with a larger gain; empty where it is not.

    The probability of all effects is limited by the share of the misfit that the first one explains.
    """
    something = diagnosis.something_else
    if not diagnosis.ranking:
        return ""
    first = diagnosis.ranking[0]
    least = max(diagnosis.required_gain or 0.0, something.gain or 0.0)
    limited = min(first.gain or 0.0, first.score_gain or 0.0) > least
    if not limited or (something.probability or 0.0) <= (first.probability or 0.0):
        return ""
    return (
        f"“Something else” is more probable than the gains imply: {first.label} explains "
        f"{100.0 * (first.explained_share or 0.0):.0f} % of the misfit, and that share limits the probability of an "
        "effect, however large its gain."
    )


def _is_excluded(diagnosis: DiagnosisContent) -> bool:
    return diagnosis.none_gain is not None and diagnosis.none_gain < -_EXCLUDED


def _with_thousands(value: float) -> str:
    """An integer with thin spaces between thousands."""
    return f"{value:,.0f}".replace(",", "\u202f")


def time_label(epoch_utc: str) -> str:
    """Label of a time axis, without its unit; `epoch_utc` may be empty."""
    return f"time since {epoch_utc} UTC" if epoch_utc else "time since the epoch"


def readable(text: str) -> str:
    """A text with superscript powers of units, ``m/s^2`` → ``m/s²``, and minus signs before negative numbers."""
    first, *parts = text.split("^")
    result = first
    for part in parts:
        length = len(part) - len(part.lstrip("0123456789-"))
        result += part[:length].translate(_SUPERSCRIPTS) + part[length:]
    return re.sub(r"(?<![\w.])-(?=\.?\d)", "−", result)


def number(value: float | None) -> str:
    """A number with three digits; a dash if it is not finite."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value:.3g}"


def gain_text(gain: float | None) -> str:
    """A gain in nats; below a thousandth it is rounding of two equal log-likelihoods, and zero is written."""
    return "0" if gain is not None and abs(gain) < 1e-3 else number(gain)


def chance(probability: float | None) -> str:
    """A probability with three decimals, or that it is close to one or zero."""
    if probability is None:
        return "–"
    if probability > 0.999:
        return "> 0.999"
    return "< 0.001" if probability < 0.001 else f"{probability:.3f}"


def pressure(value: float | None) -> str:
    """A dynamic pressure in Pa."""
    return "" if value is None else f"{value:.3g}" if value < 1.0 else f"{value:.0f}"


def short(value: float) -> str:
    """A normalised innovation squared or a limit of it."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"


def with_sigma(estimate: float | None, sigma: float | None) -> str:
    """Estimate and sigma to the second digit of the sigma: ``129.000 ± 0.013``, ``(1.75300 ± 0.00020)e-3``."""
    if estimate is None:
        return "–"
    if not sigma or not math.isfinite(sigma) or not math.isfinite(estimate):
        return f"{estimate:.4g}"
    power = math.floor(math.log10(max(abs(estimate), sigma)))
    places = 1 - math.floor(math.log10(sigma))
    if power + places >= _DIGITS:
        return f"{estimate:.{_DIGITS}g} ± {sigma:.2g}"
    if places >= 0 and (places <= _POWER or power >= -1):
        return f"{estimate:.{places}f} ± {sigma:.{places}f}"
    if places < 0 and power < _POWER:
        return f"{estimate:.0f} ± {sigma:.0f}"
    places = max(places + power, 0)
    return f"({estimate / 10.0**power:.{places}f} ± {sigma / 10.0**power:.{places}f})e{power}"


def fixed_digits(value: float | None, digits: int, scale: float = 1.0) -> str:
    """A number with a fixed number of decimals; empty if it is None."""
    return "" if value is None else f"{scale * value:.{digits}f}"


def with_fixed_sigma(value: float | None, sigma: float | None, digits: int, scale: float = 1.0) -> str:
    """Value and sigma with a number of decimals, or with more if the sigma would be zero."""
    if value is None or sigma is None:
        return fixed_digits(value, digits, scale)
    while digits < 4 and round(scale * sigma, digits) == 0.0:
        digits += 1
    return f"{fixed_digits(value, digits, scale)} ± {scale * sigma:.{digits}f}"


def parameters_text(parameters: Mapping[str, Any]) -> str:
    """Estimates with sigmas and units, one line each; parameters without a finite value are omitted.

    Parameters
    ----------
    parameters : mapping
        Name → estimate of `edl_filter.results.schema` (`Estimate`, `EffectParameter`, …) or its plain data.
    """
    lines = []
    for name, parameter in parameters.items():
        value = dict(parameter) if isinstance(parameter, Mapping) else parameter.model_dump()
        if value["estimate"] is None or not math.isfinite(value["estimate"]):
            continue
        unit = f" {value['unit']}" if value.get("unit") else ""
        lines.append(f"{name} {with_sigma(value['estimate'], value['sigma'])}{unit}")
    return "\n".join(lines)


def error_fall(hypothesis: RankedHypothesis) -> str:
    """Fall of the normalised RMS of the channel that a hypothesis reduces most."""
    return f"{number(hypothesis.error_before)} → {number(hypothesis.error_after)}"


def ranking_rows(diagnosis: DiagnosisContent) -> list[tuple[str, ...]]:
    """Rows of the ranking as text: the hypotheses, then "nothing is missing" and "something else".

    Parameters
    ----------
    diagnosis : DiagnosisContent
        With its ranking.

    Returns
    -------
    list of tuple of str
        Columns: effect, probability, gain, held-out gain, parameters, fall of the normalised RMS.
    """
    something = diagnosis.something_else
    return [
        *(
            (
                hypothesis_label(h), chance(h.probability), gain_text(h.gain), gain_text(h.score_gain),
                parameters_text(h.parameters), f"{words(h.channel)} {error_fall(h)}",
            )
            for h in diagnosis.ranking
        ),
        ("nothing is missing", chance(diagnosis.none), none_gain_text(diagnosis), "–", "", ""),
        ("something else", chance(something.probability), gain_text(something.gain), "–", "", ""),
    ]  # fmt: skip


def onset_text(onsets: Sequence[OnsetContent]) -> str:
    """Times from which the clearest channels fail."""
    first = [f"{words(o.channel)} from {o.time_s:.1f} s" for o in onsets[:_ONSETS]]
    more = len(onsets) - len(first)
    return f"Residuals grow: {', '.join(first)}{f', and {more} more' if more else ''}."


def interval_text(constraint: ConstraintSummary) -> str:
    """Interval that contains the NIS of a constraint with 99.9 %."""
    limits = constraint.nis_interval_99_9
    return "–" if limits is None else f"{short(limits[0])} – {short(limits[1])}"


def sigmas_text(values: Sequence[float | None], sigmas: Sequence[float | None]) -> str:
    """Components of a vector over their sigmas; of more than three components, the largest."""
    ratios = [
        v / s if v is not None and s and s > 0.0 and math.isfinite(v) and math.isfinite(s) else None
        for v, s in zip(values, sigmas, strict=True)
    ]
    if len(ratios) <= 3:
        return "  ".join("–" if r is None else f"{round(r, 1) + 0.0:+.1f}" for r in ratios)
    sizes = [abs(r) for r in ratios if r is not None]
    return f"≤ {max(sizes):.1f}" if sizes else "–"


def nis_text(nis: float | None, dof: int, digits: int = 2) -> str:
    """Normalised innovation squared with its degrees of freedom."""
    return f"{nis:.{digits}f} ({dof})" if dof and nis is not None else "–"


def information_text(value: float | None) -> str:
    """Information gain in nats: two decimals below ten, otherwise one."""
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}"


def constraint_verdict(constraint: ConstraintSummary) -> tuple[str, str]:
    """Judgement of a constraint, and its tone: ``bad``, ``muted``, ``good`` or ``doubt``."""
    if not constraint.accepted:
        return f"✗ {constraint.uses - constraint.accepted_uses} rejected", "bad"
    if constraint.consistent is None:
        return "– not judged", "muted"
    if not constraint.consistent:
        return ("▲ below" if below_interval(constraint) else "▲ outside"), "doubt"
    return "✓ accepted", "good"


def below_interval(constraint: ConstraintSummary) -> bool:
    """Whether the NIS is below its interval: a better agreement than the stated sigmas let expect."""
    interval = constraint.nis_interval_99_9
    return constraint.nis is not None and interval is not None and constraint.nis < interval[0]
