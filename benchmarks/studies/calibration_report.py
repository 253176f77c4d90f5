"""Tables and figures of `calibration.py`: is an error as large as its sigma says? Writes ``docs/calibration.md``.

python benchmarks/studies/calibration_report.py study-results/calibration.jsonl [--inexact study-results/inexact*.jsonl]
"""

import argparse
from collections import defaultdict
from pathlib import Path

import inexact_report
import numpy as np
from calibration import COEFFICIENTS, PHASES
from scipy.stats import chi2, norm
from study_lines import lines_so_far, read_lines

PARTS = ("position", "velocity", "attitude")
QUANTITIES = ("density", "pressure", "temperature", "CA preflight", *COEFFICIENTS)
SIGMAS = (1.0, 2.0, 3.0)
#: Share of a Gaussian within one, two and three sigma.
GAUSSIAN = tuple(float(2.0 * norm.cdf(s) - 1.0) for s in SIGMAS)
START, END = "<!-- numbers: begin -->", "<!-- numbers: end -->"


def nees_interval(dof, count, probability=0.95):
    """Interval of the average NEES over its degrees of freedom, of `count` independent flights."""
    tail = 0.5 * (1.0 - probability)
    return tuple(chi2.ppf([tail, 1.0 - tail], dof * count) / (dof * count))


def robust_nees(values, dof):
    """NEES over its degrees of freedom by the median, which a few flights with large errors do not determine."""
    return float(np.median(values) / chi2.ppf(0.5, dof))


def coverage(z):
    """Shares of the normalised errors ``(N,)`` within one, two and three sigma."""
    size = np.abs(np.asarray(z))
    return [float(np.mean(size <= s)) for s in SIGMAS]


def flights(lines, **wanted):
    """Lines of trustworthy results whose case has the wanted values; a callable decides by the value."""

    def fits(case):
        return all(w(case[k]) if callable(w) else case[k] == w for k, w in wanted.items())

    return [line for line in lines if "refused" not in line and line["trustworthy"] and fits(line["case"])]


def marked(lines):
    """A text on each result that is marked as not trustworthy, and has no part in the tables."""
    texts = []
    for line in lines:
        if "refused" in line or line["trustworthy"]:
            continue
        case, largest = line["case"], max(np.max(np.abs(at["z"])) for at in line["navigation"].values())
        imus = "one IMU" if case["imus"] == 1 else "two IMUs"
        texts.append(f"number {case['number']} ({case['gap']:g} s lost, {imus}; largest error {largest:.1f} sigmas)")
    return texts


def navigation_table(lines):
    """Rows of NEES by phase and part: average and by the median, with the 95 % interval, and coverage of components."""
    rows = []
    low, high = nees_interval(3, len(lines))
    for phase in PHASES:
        for k, part in enumerate(PARTS):
            nees = [line["navigation"][phase]["nees"][k] for line in lines]
            z = np.array([line["navigation"][phase]["z"][3 * k : 3 * k + 3] for line in lines]).ravel()
            rows.append((phase, part, np.mean(nees) / 3.0, robust_nees(nees, 3), low, high, *coverage(z), np.mean(z)))
    return rows


def postflight_table(lines):
    """Rows by quantity: number, mean square, by the median, coverage, bias; all altitudes together."""
    z = defaultdict(list)
    for line in lines:
        for at in line["postflight"].values():
            for name, value in at.items():
                z[name].append(value)
    rows = []
    for name in QUANTITIES:
        values = np.array(z[name])
        if len(values):
            square = values**2
            rows.append(
                (name, len(values), np.mean(square), robust_nees(square, 1), *coverage(values), np.mean(values))
            )
    return rows


def nis_table(lines):
    """NIS over its degrees of freedom by constraint, with the 95 % interval of chi-square, and rejected uses."""
    total = defaultdict(lambda: np.zeros(3))
    for line in lines:
        for name, row in line["nis"].items():
            total[name] += row
    rows = []
    for name, (nis, dof, rejected) in sorted(total.items()):
        low, high = chi2.ppf([0.025, 0.975], dof) / dof
        rows.append((name, int(dof), nis / dof, low, high, int(rejected)))
    return rows


def markdown(header, rows):
    """A table; floats with two digits behind the point."""

    def text(x):
        return f"{x:.2f}" if isinstance(x, float) else str(x)

    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(map(text, row)) + " |" for row in rows)])


def report(lines, inexact=None):
    """The numbers of the page, as Markdown."""
    done, flagged, refused = flights(lines), marked(lines), sum("refused" in line for line in lines)
    out = [
        f"{len(lines)} flights: {len(lines) - refused} reconstructed, of which {len(flagged)} are marked as not "
        f"trustworthy, and {refused} refused with a message. The tables are over the {len(done)} trustworthy ones."
        + (f" Marked: {', '.join(flagged)}." if flagged else "")
        + "\n"
    ]
    navigation_header = ("phase", "part", "NEES/3", "by median", "95 % from", "to", "1 sigma", "2", "3", "bias")
    for title, wanted in (
        ("MER-like, 8 Hz, no lost samples", {"vehicle": "mer", "gap": 0.0}),
        ("Phoenix-like, 20 Hz, no lost samples", {"vehicle": "phoenix", "gap": 0.0}),
        ("With lost samples, second IMU", {"gap": lambda g: g > 0.0, "imus": 2}),
        ("With lost samples, one IMU", {"gap": lambda g: g > 0.0, "imus": 1}),
    ):
        chosen = flights(lines, **wanted)
        if chosen:
            out += [f"**{title}** ({len(chosen)} flights)\n", markdown(navigation_header, navigation_table(chosen)), ""]
    header = ("quantity", "values", "mean z²", "by median", "1 sigma", "2", "3", "bias")
    for title, inexact_world in (("nominal world", False), ("inexact world", True)):
        chosen = flights(lines, inexact=inexact_world)
        if chosen:
            out += [f"**Post-flight quantities, {title}** ({len(chosen)} flights)\n",
                    markdown(header, postflight_table(chosen)), ""]  # fmt: skip
    out += [
        "**Innovations**\n",
        markdown(("constraint", "dof", "NIS/dof", "95 % from", "to", "rejected"), nis_table(done)),
        "",
    ]
    if inexact:
        out += diagnosis_section(inexact)
    return "\n".join(out)


def diagnosis_section(lines):
    """Markdown on the probabilities of the diagnosis: false alarms, reliability, and detection against size."""
    answered = [line for line in lines if "verdict" in line]
    clean = [line for line in answered if inexact_report.kind_of(line) == "clean"]
    alarms = inexact_report.share_text(sum(bool(line["named"]) for line in clean), len(clean))
    names = inexact_report.names_given(answered)
    within, rms = (outcome for what, outcome, _ in inexact_report.rate_rows(answered) if what.startswith("parameters"))
    return [
        f"**Diagnosis** ({len(answered)} flights of `make study-inexact`; [figure and all numbers]"
        "(identification-inexact.md))\n",
        f"Clean flights in which an effect is named: {alarms}. Parameters of right names within 3 sigma: {within}; "
        f"rms of error over sigma: {rms}.\n",
        markdown(("probability", "names", "mean", "right"), inexact_report.reliability_rows(names)),
        "",
        markdown(
            ("size in smallest detectable sizes", "flights", "named", "named, undecided or unknown"),
            inexact_report.detection_rows(answered),
        ),
        "",
    ]


def draw(lines, folder):
    """Two figures: NEES by phase with its interval, and coverage of the normalised errors."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.2), sharey=True, layout="constrained")
    for axis, (vehicle, name) in zip(
        axes, (("mer", "MER-like, 8 Hz"), ("phoenix", "Phoenix-like, 20 Hz")), strict=True
    ):
        chosen = flights(lines, vehicle=vehicle, gap=0.0)
        if not chosen:
            continue
        low, high = nees_interval(3, len(chosen))
        axis.axhspan(low, high, color="0.85", label="95 % of a calibrated filter")
        for k, (part, marker) in enumerate(zip(PARTS, "os^", strict=True)):
            mean = [np.mean([line["navigation"][p]["nees"][k] for line in chosen]) / 3.0 for p in PHASES]
            axis.plot(range(len(PHASES)), mean, marker=marker, label=part)
        axis.set_xticks(range(len(PHASES)), [p.replace(" ", "\n") for p in PHASES], fontsize=8)
        axis.set_title(f"{name} ({len(chosen)} flights)", fontsize=10)
        axis.set_ylim(0.0, None)
    axes[0].set_ylabel("NEES over degrees of freedom")
    axes[1].legend(fontsize=8)
    paths = [Path(folder) / "calibration_nees.png", Path(folder) / "calibration_coverage.png"]
    figure.savefig(paths[0], dpi=100)
    plt.close(figure)

    figure, axis = plt.subplots(figsize=(6.0, 3.4), layout="constrained")
    normal = np.linspace(0.0, 3.5, 200)
    axis.plot(normal, 2.0 * norm.cdf(normal) - 1.0, color="black", label="Gaussian")
    inexact = flights(lines, inexact=True)  # in the nominal world the tables have no error for the sigma of CA
    groups = {f"navigation, {p}": np.array([
        line["navigation"][phase]["z"][3 * k : 3 * k + 3] for line in flights(lines) for phase in PHASES
    ]).ravel() for k, p in enumerate(PARTS)}  # fmt: skip
    for name in ("density", "pressure", "temperature"):
        groups[name] = np.array([at[name] for line in inexact for at in line["postflight"].values() if name in at])
    groups["coefficients"] = np.array(
        [at[n] for line in inexact for at in line["postflight"].values() for n in COEFFICIENTS if n in at]
    )
    for name, z in groups.items():
        if len(z):
            axis.plot(np.sort(np.abs(z)), np.arange(1, len(z) + 1) / len(z), label=name, linewidth=1.0)
    axis.set_xlim(0.0, 3.5)
    axis.set_xlabel("size of the error, sigmas")
    axis.set_ylabel("share of the errors within")
    axis.legend(fontsize=7)
    figure.savefig(paths[1], dpi=100)
    plt.close(figure)
    return paths


def insert(page, numbers):
    """Put the numbers between the marks of a page."""
    head, rest = page.split(START, 1)
    return f"{head}{START}\n\n{numbers}\n{END}{rest.split(END, 1)[1]}"


def main():
    """Print the numbers, draw the figures and update the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lines", type=Path)
    parser.add_argument("--inexact", type=Path, nargs="*", default=[])
    parser.add_argument("--page", type=Path, default=Path("docs/calibration.md"))
    a = parser.parse_args()
    lines = read_lines(a.lines)
    inexact = [line for path in a.inexact for line in lines_so_far(path)]
    numbers = report(lines, inexact)
    print(numbers)
    draw(lines, a.page.parent / "figures")
    a.page.write_text(insert(a.page.read_text(encoding="utf-8"), numbers), encoding="utf-8")


if __name__ == "__main__":
    main()
