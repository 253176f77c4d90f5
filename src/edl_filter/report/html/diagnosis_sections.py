"""Verdict, hypotheses, missing force and ledger: the sections about a diagnosis, with the next commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from shlex import quote

from edl_filter.errors import InputError
from edl_filter.report.database_update import (
    database_figure,
    discrepancy_sentence,
    nuisance_sentence,
    update_sentence,
)
from edl_filter.report.diagnosis import ledger_levels, waterfall
from edl_filter.report.diagnosis import missing as missing_figure
from edl_filter.report.html.page import Block, Cell, Command, Details, Note, Plot, Section, Table, Verdict
from edl_filter.report.next_step import NextStep, next_step
from edl_filter.report.sentences import recovery_sentence, warnings
from edl_filter.report.text import (
    REMAINDER_HINT,
    below_interval,
    chance,
    effect_names,
    error_fall,
    gain_text,
    limited_probability_sentence,
    none_gain_sentence,
    none_gain_text,
    number,
    parameters_text,
    readable,
    state_sentences,
    undetectable_sentence,
    words,
)  # fmt: skip
from edl_filter.results.files import AS_RUN
from edl_filter.results.reader import ResultReader
from edl_filter.results.schema import DiagnosisContent, LedgerEnd, LedgerStep
from edl_filter.results.schema.diagnosis import ScreenedEffect, SomethingElse
from edl_filter.results.schema.summary import ConstraintSummary

#: Verdict → sign and tone.
_SIGNS = {"clean": ("✓", "good"), "missing": ("▲", "doubt"), "unknown": ("?", "bad"), "undecided": ("?", "bad")}
#: Mission argument of a command if the mission's file is not accessible.
_UNKNOWN_MISSION = "MISSION"
#: Bins of the curves of the missing force and moment.
_LATENT_BINS = 200


def verdict(reader: ResultReader) -> Verdict:
    """The state of the flight, or that it has not been diagnosed yet."""
    summary, diagnosis, ledger = reader.summary, reader.diagnosis, reader.ledger
    doubts = [] if summary is None else warnings(summary)
    doubts += [f"Not read: {problem}" for problem in _file_problems(reader)]
    untrustworthy = summary is not None and not summary.trustworthy
    recovery = summary.recovery if summary is not None and untrustworthy else None
    why = [] if recovery is None else [recovery_sentence(recovery)]
    if diagnosis is None:
        sentence = f"Not diagnosed yet: {_agreement({} if summary is None else summary.constraints)}."
        step = NextStep("Next: see where the model fails and which effect is missing:", (diagnose_command(reader),))
        return Verdict(*(("✗", "bad") if untrustworthy else ("–", "none")), sentence, why, doubts, step)
    first, *more = state_sentences(diagnosis)
    if diagnosis.effects:
        more.append(f"In the model: {', '.join(diagnosis.effects)}.")
    if diagnosis.remainder is not None:
        more.append(f"What is left: {readable(diagnosis.remainder.description)}")
    if ledger and isinstance(ledger[-1], LedgerEnd):
        more.append(readable(ledger[-1].why))
    more += why
    assert reader.folder is not None
    step = next_step(diagnosis, mission_argument(reader), reader.folder)
    sign = ("✗", "bad") if untrustworthy else _SIGNS[diagnosis.verdict]
    return Verdict(*sign, first, more, doubts, step)


def _file_problems(reader: ResultReader) -> list[str]:
    """Messages of files that exist and cannot be read."""
    assert reader.folder is not None
    return [message for name, message in reader.problems.items() if (reader.folder / name).exists()]


def _agreement(constraints: Mapping[str, ConstraintSummary]) -> str:
    if not constraints:
        return "this folder has no summary of the reconstruction"
    outside = [
        words(name)
        for name, c in constraints.items()
        if not c.accepted or (c.consistent is False and not below_interval(c))
    ]
    sentence = f"all {len(constraints)} constraints agree with it"
    if outside:
        sentence = f"{len(outside)} of {len(constraints)} constraints disagree with it ({', '.join(outside)})"
    return f"the flight is reconstructed, and {sentence}"


def diagnose_command(reader: ResultReader) -> str:
    """The command that diagnoses the folder."""
    return f"edl-filter diagnose {quote(str(reader.folder))}"


def mission_argument(reader: ResultReader) -> str:
    """The mission of a result as an argument of a command; ``MISSION`` if its file is not accessible."""
    from edl_filter.mission.files import file_argument, file_has_text

    assert reader.folder is not None
    file, text = reader.attribute("", "mission_file"), str(reader.attribute("", "mission_yaml", ""))
    try:
        if file is not None and file_has_text(Path(str(file)), text):
            return file_argument(Path(str(file)))
    except InputError:  # it can no longer be read
        return _UNKNOWN_MISSION
    as_run = reader.folder / AS_RUN
    return str(as_run) if as_run.is_file() else _UNKNOWN_MISSION


def hypotheses(reader: ResultReader) -> Section:
    """Hypotheses, most probable first; the effects that were only screened open below them."""
    key, title = "hypotheses", "Hypotheses on missing effects"
    diagnosis = reader.diagnosis
    blocks: list[Block] = list(_effects_in_model(reader))
    if diagnosis is None:
        return Section(
            key, title, [*blocks, Note("No hypotheses without a diagnosis:"), Command(diagnose_command(reader))]
        )
    if diagnosis.ranking:
        mission, folder = quote(mission_argument(reader)), quote(str(reader.folder))
        blocks.append(_ranking(diagnosis))
        gaining = [h for h in diagnosis.ranking if h.gain is not None and h.gain > 0.0]
        if gaining:
            blocks.append(Note("To add one of them:"))
        for h in gaining:
            options = (f" --imu {quote(h.imu)}" if h.imu else "") + diagnosis.file_option(h.effect)
            blocks.append(Command(f"edl-filter add {mission} {quote(h.effect)} --from {folder}{options}"))
    else:
        blocks.append(Note("No effect of the catalogue gains enough to be refitted."))
    blocks += [
        Note(f"{effect_names((h.label, name))}: {text}.")
        for h in diagnosis.ranking
        for name, text in h.discriminated_by.items()
    ]
    blocks.append(
        Note(
            "Gain is the logarithm of the evidence relative to the present model at the noise that its residuals show "
            f"(nats; an effect needs {number(diagnosis.required_gain)}); held-out gain is on data that were not "
            "fitted. ± is one sigma.",
            "muted",
        )
    )
    if reason := none_gain_sentence(diagnosis):
        blocks.append(Note(reason, "muted"))
    if limited := limited_probability_sentence(diagnosis):
        blocks.append(Note(limited, "muted"))
    if undetectable := undetectable_sentence(diagnosis):
        blocks.append(Note(undetectable, "muted"))
    blocks += [Note(f"Left out: {reason}", "warning") for reason in diagnosis.failed.values()]
    if diagnosis.screening:
        title_of_details = f"Also screened, and not refitted ({len(diagnosis.screening)})"
        blocks.append(Details(title_of_details, [_screened(diagnosis.screening)]))
    return Section(key, title, blocks)


def _effects_in_model(reader: ResultReader) -> list[Table]:
    effects = {} if reader.summary is None else reader.summary.effects
    rows = [
        [name, readable(parameters_text(effect.parameters)), "kept fixed" if effect.fixed else "refitted"]
        for name, effect in effects.items()
    ]
    return [Table("In the model", ("effect", "size", ""), rows, texts=3)] if rows else []


def _ranking(diagnosis: DiagnosisContent) -> Table:
    rows: list[tuple[float, list[Cell]]] = []
    for h in diagnosis.ranking:
        row: list[Cell] = [
            h.label, chance(h.probability), readable(gain_text(h.gain)), readable(gain_text(h.score_gain)),
            readable(parameters_text(h.parameters)), effect_names(h.same_as) or "nothing",
            f"{words(h.channel)}\n{error_fall(h)}",
        ]  # fmt: skip
        rows.append((h.probability or 0.0, row))
    something = diagnosis.something_else
    none, unnamed = readable(none_gain_text(diagnosis)), readable(gain_text(something.gain))
    rows.append((diagnosis.none or 0.0, ["nothing is missing", chance(diagnosis.none), none, "–", "", "", ""]))
    unnamed_row: list[Cell] = ["something else", chance(something.probability), unnamed, "–", _size(something), "", ""]
    rows.append((something.probability or 0.0, unnamed_row))
    rows.sort(key=lambda row: -row[0])  # stable: of equal ones the one with the most evidence stays first
    heads = (
        "effect", "probability", "gain (nats)", "held-out gain", "size", "confused with", "normalised RMS",
    )  # fmt: skip
    return Table("Hypotheses, most probable first", heads, [row for _, row in rows], wide=(4, 5, 6))


def _size(something: SomethingElse) -> str:
    """Size and form of the unmodelled force and moment; empty where none was estimated."""
    sizes = (
        (something.force_m_s2, "m/s²"),
        (something.angular_acceleration_rad_s2, "rad/s²"),
        (something.rate_rad_s, "rad/s"),
    )
    parts = [f"{number(size)} {unit}" for size, unit in sizes if size]
    if not parts:
        return ""
    lines = ["sigma up to " + "\nand ".join(parts)]
    quantities = [something.form.value] if something.form.is_regressor else []
    if not something.form.is_regressor:
        lines.append(something.form.value)
    if something.with_dynamic_pressure:
        quantities.append("dynamic pressure")
    if quantities:
        lines += ["in proportion to", " and\n".join(quantities)]
    return "\n".join(lines)


def _screened(effects: Mapping[str, ScreenedEffect]) -> Table:
    def gain(effect: ScreenedEffect) -> float:
        return -math.inf if effect.gain is None or not math.isfinite(effect.gain) else effect.gain

    rows = [
        [name, readable(gain_text(e.gain)), parameters_text(e.parameters)]
        for name, e in sorted(effects.items(), key=lambda item: -gain(item[1]))
    ]
    return Table("Effects as linear estimates", ("effect", "gain (nats)", "size, SI units"), rows, wide=(2,))


def missing(reader: ResultReader) -> Section:
    """The missing force and moment with bands of two sigmas, if the diagnosis estimated them."""
    key, title = "left", "Unexplained force and moment"
    diagnosis = reader.diagnosis
    if diagnosis is None:
        return Section(key, title, [Note("Unknown without a diagnosis.", "muted")])
    blocks: list[Block] = []
    if diagnosis.remainder is not None:
        blocks += [Note(readable(diagnosis.remainder.description)), Note(REMAINDER_HINT)]
    if diagnosis.latent is not None:
        caption = "Unexplained force and moment, body axes, with bands of two sigmas; the clearest onsets are marked."
        figure = missing_figure(diagnosis.latent, diagnosis.onsets, reader.title, reader.epoch_utc)
        blocks.append(Plot.of_figure("missing", caption, figure, 560, _LATENT_BINS))
    elif diagnosis.verdict == "unknown":
        blocks.append(Note("The unexplained force and moment were not estimated.", "muted"))
    else:
        reason = (
            "the model holds" if diagnosis.verdict == "clean" else "effects of the catalogue may explain the failure"
        )
        blocks.append(Note(f"They are not estimated, because {reason}.", "muted"))
    return Section(key, title, blocks)


def database(reader: ResultReader) -> Section:
    """Increments of the database over Mach number, with the sentence that names the largest."""
    key, title = "database", "Database and stated uncertainties"
    diagnosis = reader.diagnosis
    if diagnosis is None:
        return Section(key, title, [Note("Unknown without a diagnosis.", "muted")])
    blocks: list[Block] = [Note(nuisance_sentence(diagnosis.nuisances))] if diagnosis.nuisances else []
    if diagnosis.database_update is None:
        exact = Note("The mission states that the database is exact: no increments are estimated.", "muted")
        return Section(key, title, [*blocks, exact])
    sentences = (update_sentence(diagnosis.database_update), discrepancy_sentence(diagnosis.discrepancy_estimate))
    blocks[:0] = [Note(sentence) for sentence in sentences if sentence]
    if reader.database_update is not None:
        caption = (
            "Increments of the coefficients (moment about the nose) at several total angles of attack, with bands of "
            "two sigmas. Grey: the prior decides more than the data. Circles: where the flight has been."
        )
        figure = database_figure(reader.database_update, reader.title)
        blocks.append(Plot.of_figure("database", caption, figure, 620))
    return Section(key, title, blocks)


def ledger(reader: ResultReader) -> Section:
    """Each effect that was added, and the fall of the error by it."""
    key, title = "ledger", "Error by added effect"
    lines = reader.ledger
    if not lines or not ledger_levels(lines):
        note = Note("There is no ledger: no effect was added step by step. The command that does so and keeps one:")
        return Section(key, title, [note, Command(f"edl-filter improve {mission_argument(reader)} -o DIR")])
    caption = "Normalised RMS over all channels and constraints; 1 where the model holds. Dashed: the noise floor."
    end = lines[-1]
    names = list(dict.fromkeys(name for line in lines for name in line.errors))
    heads = ("channel", *("as stated" if k == 0 else f"step {line.step}" for k, line in enumerate(lines)))
    errors = [(line.errors[name].before if name in line.errors else None for line in lines) for name in names]
    rows = [[words(name), *map(number, values)] for name, values in zip(names, errors, strict=True)]
    return Section(
        key,
        title,
        [
            Plot.of_figure("waterfall", caption, waterfall(lines, reader.diagnosis, reader.title), 380),
            _steps(reader),
            *([Note(end.why)] if isinstance(end, LedgerEnd) else []),
            Details("Normalised RMS of every channel, step by step", [Table("", heads, rows)]),
        ],
    )


def _added(step: LedgerStep) -> str:
    """Names of the effect that was added, and of those that were removed."""
    names = effect_names((step.label, *step.same_as))
    return f"{names}; removed: {', '.join(map(readable, step.removed))}" if step.removed else names


def _steps(reader: ResultReader) -> Table:
    steps = [line for line in reader.ledger if isinstance(line, LedgerStep)]
    rows = [
        [
            f"{step.step}", _added(step), readable(parameters_text(step.parameters)),
            number(step.gain), number(step.held_out_score), f"{number(before)} → {number(after)}",
        ]
        for step, (before, after) in zip(steps, pairwise(ledger_levels(reader.ledger)), strict=False)
    ]  # fmt: skip
    heads = ("step", "added", "size as it was added", "gain (nats)", "held-out gain", "normalised RMS")
    return Table("Steps", heads, rows or [["–", "nothing was added", "", "", "", ""]], texts=3)
