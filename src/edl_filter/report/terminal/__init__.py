"""What a run and a check say on the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from edl_filter.telemetry.record import ImuRecord, Telemetry

#: Columns where the output is no terminal and has no width of its own.
_WIDTH = 118
#: Digits before or behind the point that are written out; beyond, a power of ten stands behind the number.
_PLACES = 6
#: Digits of an estimate at most.
_DIGITS = 9
#: Share of a constraint's uses that may fail the gate before a run warns.
_USUAL_REJECTIONS = 0.05


def print_run(written: dict[str, Any]) -> None:
    """Print a run's events, constraints, what gave in the entry state, and where the outputs are.

    Parameters
    ----------
    written : dict
        As `results.write_outputs` gives it.
    """
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_WIDTH)
    with console.capture() as captured:  # rich would end the program where a reader such as head goes away
        _print(console, written)
    typer.echo(captured.get(), nl=False)


def _print(console: Console, written: dict[str, Any]) -> None:
    told = written["content"]
    console.print(f"[bold]{told['title'] or told['mission']}[/bold], epoch {told['epoch_utc']} UTC")
    console.print(events_table(told["events"]))
    if "peak_deceleration" in told["events"]:
        console.print(peak_sentence(told["events"]["peak_deceleration"]))
    console.print(constraints_table(told["constraints"]))
    for warning in warnings(told["constraints"]):
        console.print(f"[bold red]{warning}[/bold red]")
    console.print(entry_sentence(told["entry_state"]))
    if told["landing"].get("miss_m") is not None:
        console.print(landing_sentence(told["landing"]))
    for line in effect_lines(told["effects"]):
        console.print(line)
    for line in postflight_lines(told.get("postflight")):
        console.print(line)
    seconds = sum(told["timing_s"].values())
    console.print(f"Written in {seconds:.1f} s: {written['result']}", soft_wrap=True)
    console.print(f"Summary: {written['summary']}", soft_wrap=True)
    console.print(f"Report: {written['report']} (open it in a browser)", soft_wrap=True)
    if written["figures"]:
        console.print(f"Figures: {written['figures'][0].parent} ({len(written['figures'])} files)", soft_wrap=True)


def effect_lines(effects: dict[str, dict[str, Any]]) -> list[str]:
    """One line for each effect in the model, with the parameters that are not zero and their sigmas."""
    from edl_filter.effects.instances import lookup
    from edl_filter.effects.registry import catalogue

    lines = []
    for key, e in effects.items():
        estimate = {q: v["estimate"] for q, v in e["parameters"].items() if v["estimate"] is not None}
        values = ", ".join(_estimate(q, e["parameters"][q]) for q, v in estimate.items() if v and math.isfinite(v))
        name = key.split(" in ")[0]
        known = lookup(catalogue(), name)
        off = known is not None and not any(estimate.get(q.name) for q in known.sizes)
        where = f" in {e['imu']}" if e["imu"] else ""
        lines.append(f"Effect in the model: {name}{where} ({'off' if off else values}).")
    return lines


def _estimate(name: str, value: dict[str, Any]) -> str:
    unit = f" {value['unit']}" if value["unit"] and value["sigma"] else ""
    return f"{name} {with_sigma(value['estimate'], value['sigma'])}{unit}"


def with_sigma(estimate: float, sigma: float | None) -> str:
    """Both to the second digit of the sigma: ``129.000 ± 0.013``, ``(1.75300 ± 0.00020)e-3``."""
    if not sigma or not math.isfinite(sigma) or not math.isfinite(estimate):
        return f"{estimate:.4g}"
    power = math.floor(math.log10(max(abs(estimate), sigma)))
    places = 1 - math.floor(math.log10(sigma))
    if power + places >= _DIGITS:
        return f"{estimate:.{_DIGITS}g} ± {sigma:.2g}"
    if 0 <= places <= _PLACES:
        return f"{estimate:.{places}f} ± {sigma:.{places}f}"
    if places < 0 and power < _PLACES:
        return f"{estimate:.0f} ± {sigma:.0f}"
    places = max(places + power, 0)
    return f"({estimate / 10.0**power:.{places}f} ± {sigma / 10.0**power:.{places}f})e{power}"


def events_table(events: dict[str, dict[str, Any]]) -> Table:
    """Events in order of time."""
    table = Table(title="Events", title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column("event", no_wrap=True)
    for head in ("time s", "altitude km", "over site km", "velocity m/s", "Mach", "q Pa", "alpha_t deg"):
        table.add_column(head, justify="right")
    for name, e in events.items():
        height = e.get("height_above_site_m")
        table.add_row(
            name.replace("_", " "),
            f"{e['time_s']:.2f}",
            f"{1e-3 * e['altitude_m']:.3f} ± {1e-3 * e['altitude_sigma_m']:.3f}",
            "" if height is None else f"{1e-3 * height:.2f}",
            f"{e['velocity_m_s']:.1f} ± {e['velocity_sigma_m_s']:.1f}",
            f"{e['mach']:.2f}",
            f"{e['dynamic_pressure_pa']:.3g}" if e["dynamic_pressure_pa"] < 1.0 else f"{e['dynamic_pressure_pa']:.0f}",
            f"{e['alpha_total_deg']:.2f} ± {e['alpha_total_sigma_deg']:.2f}",
        )
    return table


def peak_sentence(peak: dict[str, Any]) -> str:
    """Largest deceleration before the parachute."""
    return (
        f"Peak deceleration: {peak['acceleration_m_s2']:.1f} m/s² as the mean of two samples, "
        f"{peak['acceleration_single_m_s2']:.1f} m/s² in one."
    )


def constraints_table(constraints: dict[str, dict[str, Any]]) -> Table:
    """Constraints: how far off on the way forwards, and against all others."""
    table = Table(title="Constraints (in sigmas)", title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column("constraint", no_wrap=True)
    for head in ("uses", "innovation", "NIS (dof)", "99.9 %", "left out", "its NIS"):
        table.add_column(head, justify="right")
    table.add_column("")
    for name, c in constraints.items():
        table.add_row(
            name.replace("_", " "),
            f"{c['accepted_uses']}/{c['uses']}",
            _sigmas(c["innovation"], c["innovation_sigma"]),
            f"{c['nis']:.1f} ({c['dof']})" if c["dof"] else "–",
            _interval(c["nis_interval_99_9"]),
            _sigmas(c["left_out"], c["left_out_sigma"]),
            f"{c['left_out_nis']:.1f} ({c['left_out_dof']})" if c["left_out_dof"] else "–",
            _verdict(c),
        )
    return table


def _sigmas(values: list[float], sigmas: list[float]) -> str:
    """Components over their sigmas; many of them as the largest."""
    ratio = [v / s if s > 0.0 and math.isfinite(s) else math.nan for v, s in zip(values, sigmas, strict=True)]
    shown = ["–" if math.isnan(r) else f"{r:+.1f}" for r in ratio]
    if len(shown) <= 3:
        return " ".join(shown)
    known = [abs(r) for r in ratio if not math.isnan(r)]
    return f"≤ {max(known):.1f}" if known else "–"


def _interval(limits: list[float] | None) -> str:
    if limits is None:
        return "–"
    low, high = limits
    return f"{low:.1g} – {high:.1f}" if low < 1.0 else f"{low:.0f} – {high:.0f}"


def _verdict(c: dict[str, Any]) -> str:
    if not c["accepted"]:
        return f"[red]{c['uses'] - c['accepted_uses']} rejected[/red]"
    if c["consistent"] is None:
        return "–"
    return "[green]ok[/green]" if c["consistent"] else "[yellow]outside[/yellow]"


def warnings(constraints: dict[str, dict[str, Any]]) -> list[str]:
    """Sentences about constraints that the reconstruction contradicts: one that must hold, or one use of twenty."""
    found = []
    for name, c in constraints.items():
        rejected = c["uses"] - c["accepted_uses"]
        must_hold = name in ("landing", "parachute") or name.startswith("rest_")
        if rejected > (0 if must_hold else _USUAL_REJECTIONS * c["uses"]):
            found.append(
                f"WARNING: {name.replace('_', ' ')} contradicts all else and was rejected in {rejected} of {c['uses']} "
                "uses; that usually means wrong units, wrong axes or a wrong calibration. Do not trust this result."
            )
    return found


def entry_sentence(entry: dict[str, Any]) -> str:
    """What had to give in the entry state."""
    distance = math.dist(entry["position_change_m"], (0.0, 0.0, 0.0))
    speed = math.dist(entry["velocity_change_m_s"], (0.0, 0.0, 0.0))
    sentence = f"Entry state: moved by {distance / 1e3:.2f} km and {speed:.2f} m/s"
    if "entry_frame" in entry["states"]:
        left = math.dist(entry["rotation_leaves_m"], (0.0, 0.0, 0.0))
        sentence += f"; a rotation of its frame by {entry['rotation_deg']:.3f} deg explains all but {left / 1e3:.2f} km"
    epoch = entry["states"].get("entry_epoch")
    if epoch is not None:
        sentence += f", with its epoch off by {epoch['estimate'][0]:+.2f} ± {epoch['sigma'][0]:.2f} s"
    return sentence + "."


def landing_sentence(landing: dict[str, Any]) -> str:
    """Where the vehicle came down, and where it would have without the landing constraint."""
    latitude = landing["lat_deg"]
    sentence = (
        f"Landing: {abs(latitude):.4f} {'S' if latitude < 0.0 else 'N'} {landing['lon_deg']:.4f} E, "
        f"{landing['miss_m']:.0f} ± {landing['sigma_m']:.0f} m from the site"
    )
    if out := landing.get("left_out"):
        sentence += f"; predicted without it {out['miss_m'] / 1e3:.2f} ± {out['sigma_m'] / 1e3:.2f} km away"
    return sentence + "."


def postflight_lines(told: dict[str, Any] | None) -> list[str]:
    """What the coefficients say, in a few lines."""
    if told is None:
        return []
    domain = told["domain_s"]
    marks = [f"{name} {span[0]:.0f}-{span[1]:.0f} s" for name, span in told["instabilities_s"].items() if span]
    within = [a for a in told["averages"] if a["pair"] == "IMU-accels"]
    worst = max(within, key=lambda a: abs(a["percent"]), default=None)
    lines = [
        f"Aerodynamics from {domain['start']:.0f} s (forces from {domain['useful']:.0f} s); instabilities: "
        + (", ".join(marks) or "none found")
        + "."
    ]
    if worst is not None:
        lines.append(
            f"Database less flight, forces: at most {abs(worst['percent']):.0f} % of the database's 3 sigma "
            f"({worst['coefficient']}, {worst['window']})."
        )
    return lines


def telemetry_lines(telemetry: Telemetry) -> list[str]:
    """What telemetry holds, a line each."""
    lines = [f"epoch {telemetry.epoch_utc} UTC"]
    if telemetry.epoch_sclk is not None:
        lines[0] += f", SCLK {telemetry.epoch_sclk:.3f} s"
    lines.append(_imu_line("driving", telemetry.driving))
    lines += [_imu_line("checking", record) for record in telemetry.checking]
    if telemetry.attitude is not None:
        lines.append(f"on-board attitude: {len(telemetry.attitude.time)} quaternions")
    if telemetry.altimeter is not None:
        lines.append(f"altimeter: {len(telemetry.altimeter.time)} heights")
    known = [n for n in ("initial", "landing", "parachute") if getattr(telemetry, n) is not None]
    if known:
        lines.append(f"stated: {', '.join(known)}")
    return lines + list(telemetry.notes)


def _imu_line(role: str, record: ImuRecord) -> str:
    used = [record.sources[k] for k in sorted(set(record.source.tolist()))]
    name = "" if record.name == role else f" ({record.name})"
    return f"{role} IMU{name}: {len(record)} samples, {record.start:.2f} to {record.time[-1]:.2f} s ({', '.join(used)})"
