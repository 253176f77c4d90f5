"""A diagnosis, a comparison of results and the detectability of effects on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape

from edl_filter.report.database_update import discrepancy_sentence, nuisance_sentence, update_sentence
from edl_filter.report.next_step import NextStep
from edl_filter.report.terminal.console import echo, empty_table
from edl_filter.report.terminal.table import Table
from edl_filter.report.text import (
    effect_names,
    limited_probability_sentence,
    none_gain_sentence,
    number,
    onset_text,
    parameters_text,
    ranking_rows,
    state_sentences,
    undetectable_sentence,
    words,
)  # fmt: skip
from edl_filter.results.schema import DiagnosisContent

#: Largest number of failing cells that are printed.
_ROWS = 8


def print_diagnosis(
    content: DiagnosisContent | Mapping[str, Any],
    written: Sequence[str],
    following: NextStep,
    warnings: Sequence[str] = (),
) -> None:
    """Print a diagnosis.

    Parameters
    ----------
    content : DiagnosisContent or mapping
        Content of ``diagnosis.json``.
    written : sequence of str
        Paths of the files, one line each.
    following : NextStep
        What to do next.
    warnings : sequence of str
        Reasons not to trust the result that is diagnosed.
    """
    diagnosis = DiagnosisContent.of(content)
    colour = {"clean": "green", "missing": "yellow"}.get(diagnosis.verdict, "red")
    parts: list[str | Table] = [f"[bold red]{escape(warning)}[/bold red]" for warning in warnings]
    first, *more = state_sentences(diagnosis)
    parts += [f"[bold {colour}]{escape(first)}[/bold {colour}]", *(escape(sentence) for sentence in more)]
    if diagnosis.effects:
        parts.append(f"In the model: {', '.join(diagnosis.effects)}.")
    parts.append(where_table(diagnosis) if diagnosis.where else "No channel fails in any regime.")
    if diagnosis.onsets:
        parts.append(onset_text(diagnosis.onsets))
    parts += [ranking_table(diagnosis), none_gain_sentence(diagnosis), limited_probability_sentence(diagnosis)]
    for h in diagnosis.ranking:
        parts += [f"{effect_names((h.label, name))}: {escape(text)}." for name, text in h.discriminated_by.items()]
    if diagnosis.remainder is not None:
        parts.append(f"What is left: {escape(diagnosis.remainder.description)}")
    remarks = (
        undetectable_sentence(diagnosis),
        discrepancy_sentence(diagnosis.discrepancy_estimate),
        nuisance_sentence(diagnosis.nuisances),
        update_sentence(diagnosis.database_update),
    )
    parts += [escape(t) for t in remarks if t]
    parts += [f"[red]Left out: {escape(reason)}[/red]" for reason in diagnosis.failed.values()]
    echo(*parts)
    echo(*(f"Written: {escape(path)}" for path in written), wrap=False)
    if following.commands:
        echo(escape(following.sentence), *(f"  {escape(command)}" for command in following.commands))


def where_table(diagnosis: DiagnosisContent) -> Table:
    """Cells that fail, worst first."""
    cells = diagnosis.where
    more = f" (the worst {_ROWS} of {len(cells)})" if len(cells) > _ROWS else ""
    heads = ("from s", "to s", "sigmas", "beyond noise", "database")
    table = empty_table(f"Where it fails{more}", ("channel", "regime"), heads, optional=("database",))
    for cell in cells[:_ROWS]:
        beyond = f"{number(cell.excess_rms)} {cell.unit}" if cell.excess_rms else "–"
        database = number(cell.over_database_sigma or None)
        table.add_row(
            words(cell.channel),
            cell.regime,
            f"{cell.t0_s:.0f}",
            f"{cell.t1_s:.0f}",
            number(cell.normalised_rms),
            beyond,
            database if database == "–" else f"{database} sigma",
        )
    return table


def ranking_table(diagnosis: DiagnosisContent) -> Table:
    """Hypotheses, most probable first, with nothing and something else below them."""
    required = "" if diagnosis.required_gain is None else f", {diagnosis.required_gain:.3g} needed"
    table = empty_table(
        f"Hypotheses (gains in nats{required}; held-out: on data that were not fitted)",
        ("effect",),
        ("probability", "gain", "held-out"),
        ("parameters",),
        ("error before → after",),
    )
    *hypotheses, nothing, something = ranking_rows(diagnosis)
    for row in hypotheses:
        table.add_row(*row)
    table.add_section()
    table.add_row(*nothing)
    table.add_row(*something)
    return table


def print_comparison(comparison: Mapping[str, Any]) -> None:
    """Print results side by side.

    Parameters
    ----------
    comparison : mapping
        As `workflow.compare_results.compare_results` returns it.
    """
    results = comparison["results"]
    names = [f"{k + 1}" for k in range(len(results))]
    doubts = [(k, r["headline"]) for k, r in zip(names, results, strict=True) if r["headline"]]
    echo(*(f"[bold red]{k}: {escape(headline)}[/bold red]" for k, headline in doubts))
    echo(*(f"{k}: {escape(r['path'])}{_verdict(r)}" for k, r in zip(names, results, strict=True)))
    errors = empty_table(
        "Normalised RMS of the residuals, by channel (1: the model holds)", ("channel",), (*names, "fall")
    )
    for channel, fall in comparison["fall_percent"].items():
        values = [r["residuals"].get(channel) for r in results]
        limits = [(values[k], results[k]["minimum_rms"]) for k in (0, -1)]
        at_noise = all(v is not None and v < limit for v, limit in limits)  # the fall is not significant
        errors.add_row(words(channel), *map(number, values), "–" if fall is None or at_noise else f"{fall:.1f} %")
    nis = empty_table(
        "Innovations of the filter, by constraint: NIS per degree of freedom", ("constraint",), tuple(names)
    )
    for name in dict.fromkeys(n for r in results for n in r["nis_per_dof"]):
        nis.add_row(words(name), *(number(r["nis_per_dof"].get(name)) for r in results))
    effects = empty_table("Effects in the model", ("effect",), last=tuple(names))
    effect_list = list(dict.fromkeys(n for r in results for n in r["effects"]))
    for name in effect_list:
        effects.add_row(name, *(parameters_text(r["effects"].get(name, {}).get("parameters", {})) for r in results))
    echo(errors, nis, effects if effect_list else "No effects in any of the models.")
    for k, r in zip(names, results, strict=True):
        if r["score_gain"] is not None:
            echo(f"Held-out gain of {k} over the one before: {number(r['score_gain'])} nats.")


def _verdict(result: Mapping[str, Any]) -> str:
    return "" if result["verdict"] is None else f" (diagnosed: {result['verdict']})"


def print_identifiability(content: Mapping[str, Any]) -> None:
    """Print the smallest detectable size of each effect.

    Parameters
    ----------
    content : mapping
        As `diagnosis.detectability.detectability` returns it.
    """
    table = empty_table(
        f"Smallest size that would be named (gain of {content['required_gain']:g} nats), and the plausible one",
        ("effect", "parameter"),
        ("smallest", "plausible", "ratio"),
        last_texts=("confused with",),
    )
    for effect in content["effects"]:
        confused = ", ".join(f"{name} ({r:.2f})" for name, r in effect["confused_with"].items())
        for k, (name, value) in enumerate(effect["parameters"].items()):
            unit = f" {value['unit']}" if value["unit"] else ""
            table.add_row(
                effect["effect"] if k == 0 else "",
                name,
                "none" if value["smallest"] is None else f"{value['smallest']:.2g}{unit}",
                f"{value['plausible']:.2g}",
                "–" if value["ratio"] is None else f"{value['ratio']:.2g}",
                confused if k == 0 else "",
            )
    model = content["in_model"]
    lines = [f"[red]Left out: {escape(reason)}[/red]" for reason in content["failed"].values()]
    echo(table, f"In the model already: {', '.join(model)}." if model else "", *lines)
    echo("A ratio above 1: an effect of plausible size would not be named on this flight.")
