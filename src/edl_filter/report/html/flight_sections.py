"""Events, trajectory, atmosphere, coefficients, constraints and provenance: the sections about a reconstruction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from edl_filter.mission.mission import PATH_KEYS
from edl_filter.mission.yaml_edit import hide_folders
from edl_filter.report.atmosphere import LARGEST_SIGMA, profile_panels
from edl_filter.report.attitude import total_angle_of_attack
from edl_filter.report.coefficients import MEANINGS, against_database
from edl_filter.report.description import Figure
from edl_filter.report.html.page import Block, Command, Details, Grid, Mark, Note, Plot, Section, Table
from edl_filter.report.instruments import HEADS, instrument_tables
from edl_filter.report.sentences import (
    entry_sentence,
    finding_sentences,
    gas_sentence,
    landing_sentence,
    peak_sentence,
    smoothing_sentence,
)
from edl_filter.report.text import (
    constraint_verdict,
    fixed_digits,
    information_text,
    interval_text,
    nis_text,
    pressure,
    readable,
    sigmas_text,
    with_fixed_sigma,
    words,
)  # fmt: skip
from edl_filter.report.track import ground_track, landing_estimate
from edl_filter.report.trajectory import altitude_over_speed, flight_history
from edl_filter.results.reader import ResultReader
from edl_filter.results.schema.summary import ConstraintSummary, EventState

#: Bins of the curves of a small plot, and heights of plots, pixels.
_SMALL_BINS = 250
_PROFILE_HEIGHT, _COEFFICIENT_HEIGHT = 400, 390


def events(reader: ResultReader) -> Section:
    """Events in order of time, and the sentences about deceleration, landing and entry state."""
    summary = reader.summary
    if summary is None or not summary.events:
        note = Note("There are none: the folder has no summary.json with events.", "muted")
        return Section("events", "Events", [note])
    heads = (
        "event", "UTC", "time (s)", "altitude (km)", "over site (km)", "velocity (m/s)", "flight path (°)", "Mach",
        "q (Pa)", "α total (°)",
    )  # fmt: skip
    ordered = sorted(summary.events.items(), key=lambda event: event[1].time_s)
    sentences = [landing_sentence(summary.landing), entry_sentence(summary.entry_state)]
    if "peak_deceleration" in summary.events:
        sentences.insert(0, peak_sentence(summary.events["peak_deceleration"]))
    explanation = (
        f"Epoch {reader.epoch_utc or 'unknown'} UTC. ± is one sigma; velocity and flight path are relative to the air."
    )
    blocks: list[Block] = [Table("", heads, [_event(name, event) for name, event in ordered], texts=2)]
    blocks += [Note(sentence) for sentence in sentences if sentence]
    explanation += "" if summary.gas is None else f" {gas_sentence(summary.gas)}"
    return Section("events", "Events", [*blocks, Note(explanation, "muted")])


def _event(name: str, e: EventState) -> list[str]:
    numbers = (
        fixed_digits(e.time_s, 2),
        with_fixed_sigma(e.altitude_m, e.altitude_sigma_m, 2, 1e-3),
        fixed_digits(e.height_above_site_m, 2, 1e-3),
        with_fixed_sigma(e.velocity_m_s, e.velocity_sigma_m_s, 1),
        fixed_digits(e.flight_path_deg, 1),
        fixed_digits(e.mach, 2),
        pressure(e.dynamic_pressure_pa),
        with_fixed_sigma(e.alpha_total_deg, e.alpha_total_sigma_deg, 1),
    )
    return [words(name), e.utc.partition("T")[2][:12], *map(readable, numbers)]


def trajectory(reader: ResultReader) -> Section:
    """Trajectory and its sigmas over time, and altitude over speed."""
    if not reader.has("trajectory:time", "trajectory:altitude"):
        note = Note("The folder has no trajectory (result.nc is missing or incomplete).", "muted")
        return Section("trajectory", "Trajectory", [note])
    caption = (
        "Altitude over the ellipsoid, velocity and flight-path angle relative to the air, Mach number, dynamic "
        "pressure; in the lowest panel one sigma of altitude and velocity."
    )
    plots = []
    if reader.has("trajectory:speed"):
        plots.append(Plot.of_figure("altitude_speed", "Altitude against velocity.", altitude_over_speed(reader), 420))
    if reader.has("trajectory:position", "trajectory:longitude"):
        track = Figure("", ((ground_track(reader),),), (1.0,))
        caption_of_track = f"Ground track in km from {landing_estimate(reader).origin}, with a mark every 30 s."
        plots.append(Plot.of_figure("ground_track", caption_of_track, track, 420))
    if reader.has("trajectory:alpha_total"):
        angle = replace(total_angle_of_attack(reader), name="total_angle_of_attack")
        caption_of_angle = "Total angle of attack until the parachute, with bands of one and three sigma."
        plots.append(Plot.of_figure("angle_of_attack", caption_of_angle, Figure("", ((angle,),), (1.0,)), 420))
    history = Plot.of_figure("flight", caption, flight_history(reader), 980)
    return Section("trajectory", "Trajectory", [history, Grid(plots)] if plots else [history])


def atmosphere(reader: ResultReader) -> Section:
    """Profiles with one-sigma bands, and their ratios to the preflight ones."""
    panels = profile_panels(reader)
    if not panels:
        note = Note("The run derived no atmosphere; that needs an aerodynamic database in the mission.", "muted")
        return Section("atmosphere", "Atmosphere", [note])
    gas = None if reader.summary is None else reader.summary.gas
    note = Note(
        "From the drag: density from the axial force and the database, pressure by the hydrostatic integral, "
        "temperature by the gas law. Bands are one sigma. Temperature and ratios are left out where a sigma exceeds "
        f"{LARGEST_SIGMA:.0%}." + ("" if gas is None else f" {gas_sentence(gas)}"),
        "muted",
    )
    plots = [Plot.of_panel(panel, _PROFILE_HEIGHT, _SMALL_BINS) for panel in panels]
    return Section("atmosphere", "Atmosphere", [note, Grid(plots)])


def coefficients(reader: ResultReader) -> Section:
    """A plot of each coefficient, and its judgement by window."""
    key, title = "coefficients", "Coefficients against the database"
    panels = [panel for name in MEANINGS if (panel := against_database(reader, name)) is not None]
    if not panels:
        note = Note("The run has no coefficients; they need an aerodynamic database in the mission.", "muted")
        return Section(key, title, [note])
    blocks: list[Block] = [
        Note(
            "Blue band: three sigmas that the database publishes, which the post-flight comparison uses. Orange band: "
            "one sigma of the flight's value. Shaded times: the vehicle is statically unstable there. Moments are "
            "about the centre of mass. A band may leave the plot where the flight says little; no curve does.",
            "muted",
        ),
        Grid([Plot.of_panel(panel, _COEFFICIENT_HEIGHT, _SMALL_BINS) for panel in panels]),
    ]
    postflight = None if reader.summary is None else reader.summary.postflight
    if postflight is not None and postflight.smoothing is not None:
        blocks.insert(1, Note(smoothing_sentence(postflight.smoothing), "muted"))
    rows = _verdicts(reader)
    if rows:
        heads = ("window", "coefficient", "density", "database minus flight", "3 sigma", "share", "")
        inside = sum(isinstance(row[-1], Mark) and row[-1].tone == "good" for row in rows)
        caption = f"Average differences by window: {inside} of {len(rows)} within the database's 3 sigma"
        blocks.append(Details(caption, [Table("", heads, rows, texts=3, wide=(6,))]))
    return Section(key, title, blocks)


def _verdicts(reader: ResultReader) -> list[list[str | Mark]]:
    group = "postflight/verdicts"
    texts = [reader.text(group, name) for name in ("window", "coefficient", "density")]
    numbers = [reader.variable(group, name) for name in ("mean", "mean_sigma", "three_sigma", "ratio", "within")]
    arrays = [values for values in numbers if values is not None]
    if not texts[0] or len(arrays) < len(numbers):
        return []
    return [
        [
            window, coefficient, density, f"{mean:+.2g} ± {sigma:.1g}", f"{limit:.2g}", f"{100.0 * abs(ratio):.0f} %",
            Mark("✓ within", "good") if within else Mark("▲ outside", "doubt"),
        ]
        for window, coefficient, density, mean, sigma, limit, ratio, within in zip(*texts, *arrays, strict=True)
    ]  # fmt: skip


def constraints(reader: ResultReader) -> Section:
    """One row for each constraint."""
    summary = reader.summary
    if summary is None or not summary.constraints:
        note = Note("The folder has no summary.json with constraints.", "muted")
        return Section("constraints", "Constraints", [note])
    heads = (
        "constraint", "source", "accepted uses", "innovation (sigma)", "NIS", "dof", "99.9 % interval",
        "left out (sigma)", "its NIS (dof)", "information over those before (nats)", "beyond all others (nats)",
        "verdict",
    )  # fmt: skip
    explanation = (
        "Innovations are components over their sigmas (many uses: their mean). NIS is the normalised innovation "
        "squared; it should lie in the interval. Left out: predicted from all other constraints alone, which is the "
        "fairer test. Information: by how much the entropy of the states falls, half the fall of the logarithm of the "
        "determinant of their covariance. First what the constraint adds to everything before it, then what it adds to "
        "all other constraints, before and after: what the estimate would lose without it. Verdict: “outside” and "
        "“below” are about the NIS; below its interval the constraint agrees better than its sigma lets expect."
    )
    rows = [_constraint(name, c) for name, c in summary.constraints.items()]
    return Section(
        "constraints", "Constraints", [Table("", heads, rows, texts=2, wide=(11,)), Note(explanation, "muted")]
    )


def _constraint(name: str, c: ConstraintSummary) -> list[str | Mark]:
    return [
        words(name), c.source, f"{c.accepted_uses} of {c.uses}",
        readable(sigmas_text(c.innovation, c.innovation_sigma)),
        f"{c.nis:.2f}" if c.dof and c.nis is not None else "–", str(c.dof), interval_text(c),
        readable(sigmas_text(c.left_out, c.left_out_sigma)), nis_text(c.left_out_nis, c.left_out_dof),
        information_text(c.information_nats), information_text(c.left_out_information_nats),
        Mark(*constraint_verdict(c)),
    ]  # fmt: skip


def instruments(reader: ResultReader) -> Section:
    """Accelerometer bias before entry, and the calibration of every checking IMU against the driving one."""
    summary = reader.summary
    tables = {} if summary is None else instrument_tables(summary)
    explanation = (
        "Least squares over the difference of the readings of two IMUs up to the parachute: both measure the motion of "
        "one rigid body. Sigmas include the correlation of the residuals. What is beyond a stated sigma belongs into "
        "the mission."
    )
    blocks: list[Block] = [
        Table(title, HEADS, [list(map(readable, row)) for row in rows]) for title, rows in tables.items()
    ]
    missing = "Nothing is estimated: there is no second IMU with enough common samples, and no window before entry."
    return Section("instruments", "Instruments", [*blocks, Note(explanation if blocks else missing, "muted")])


def provenance(reader: ResultReader) -> Section:
    """Program, mission, inputs with checksums, libraries and times of a result."""
    summary = reader.summary
    version = reader.attribute("", "edl_filter_version") or (summary.edl_filter_version if summary else None)
    rows = [
        ("edl-filter", version),
        ("mission", reader.mission),
        ("mission file", Path(str(reader.attribute("", "mission_file") or "")).name),
        ("planet", reader.attribute("", "planet")),
        ("epoch", f"{reader.attribute('', 'epoch_utc')} UTC" if reader.attribute("", "epoch_utc") else None),
        ("made", reader.attribute("", "created_utc")),
    ]
    rows += [(f"input {name}", f"sha256 {value}") for name, value in reader.mapping("", "input_sha256").items()]
    rows += [(f"library {name}", value) for name, value in reader.mapping("", "versions").items()]
    if summary is not None and summary.timing_s:
        parts = ", ".join(f"{words(name)} {value:.2f}" for name, value in summary.timing_s.items())
        rows.append(("time spent", f"{sum(summary.timing_s.values()):.1f} s ({parts})"))
    stated = [[name, str(value)] for name, value in rows if value]
    blocks: list[Block] = [Table("", ("", ""), stated, texts=2)] if stated else []
    if not reader.has_result:
        blocks.append(Note("The folder has no result.nc that can be read; inputs and libraries are unknown.", "muted"))
    blocks += [Note(note) for note in (summary.notes if summary else ())]
    if summary is not None and summary.sample_findings:
        blocks.append(Note("Missing and bad samples, and what was done about them:"))
        blocks += [Note(sentence) for sentence in finding_sentences(summary.sample_findings)]
    if text := reader.attribute("", "mission_yaml"):
        shown = hide_folders(str(text), PATH_KEYS, "mission_yaml")
        blocks.append(Details("The mission as it was run", [Command(shown.rstrip())]))
    return Section("provenance", "Provenance", blocks)
