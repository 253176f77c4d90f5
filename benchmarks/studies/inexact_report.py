"""Rates, errors and reliability of the study of an inexact world: `python benchmarks/studies/inexact_report.py FILES…`.

Reads the lines that `inexact.py` wrote, prints the numbers as Markdown, and writes them to
``docs/identification-inexact.md`` with a figure of reliability and detection.

A name is right if it or a name that the diagnosis declares indistinguishable from it is hidden in the flight. An effect
is detectable if its expected gain, with the truth known and the same nuisance parameters, exceeds `named_gain_nats`.
"""

import argparse
import os
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from identification_report import DETECTABLE, standardised_errors
from outside_effects import OUTSIDE_EFFECTS
from scipy.stats import beta
from study_lines import read_lines

#: Edges of the bins of probability.
BINS = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
#: Edges of the bins of size, in smallest detectable sizes.
SIZES = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, np.inf)
#: Edges of the bins of the explained share.
SHARES = (0.0, 0.2, 0.4, 0.9, 1.0)
#: Probability from which a wrong name is a confident one.
CONFIDENT = 0.95


def kind_of(line):
    """What is hidden: clean, single, pair or outside."""
    hidden = line["hidden"]
    if not hidden:
        return "clean"
    if len(hidden) == 2:
        return "pair"
    return "outside" if hidden[0] in OUTSIDE_EFFECTS else "single"


def detectable_names(line):
    """Hidden effects whose expected gain exceeds the threshold."""
    return [n for n in line["hidden"] if line["expected_gains"][n] > DETECTABLE]


def group_of(name):
    """A name that was given, with those that are not distinguished from it."""
    return {name.get("label") or name["effect"], *name.get("same_as", ())}


def is_right(name, hidden):
    """Whether a name, or one of its group, is hidden in the flight."""
    return not group_of(name).isdisjoint(hidden)


def is_clean(line):
    """Whether the verdict is that nothing is missing, or nothing beyond the database's uncertainty."""
    return line["verdict"] == "clean" or line["verdict"].startswith("within")


def wrong_names(line):
    """Names that were given and are not hidden."""
    return [name for name in line["named"] if not is_right(name, line["hidden"])]


def is_wrong(line):
    """Whether a flight is not answered as it should be.

    Every name must be right, every detectable effect named, and a flight without a detectable effect called clean or
    undecided; a flight without any effect must be called clean, and one with a detectable effect that is outside the
    catalogue unknown.
    """
    if wrong_names(line):
        return True
    kind, detectable = kind_of(line), detectable_names(line)
    if kind == "clean":
        return not is_clean(line)
    if kind == "outside":
        return line["verdict"] != "unknown" if detectable else not (is_clean(line) or line["verdict"] == "undecided")
    if detectable:
        return not all(any(n in group_of(name) for name in line["named"]) for n in detectable)
    return not (is_clean(line) or line["named"] or line["verdict"] == "undecided")


def parameter_errors(line):
    """Errors of the named effect's parameters in sigmas; None where the first name of a single effect is not right."""
    if kind_of(line) != "single" or line["verdict"] != "missing":
        return None
    first, (name,) = line["ranking"][0], line["hidden"]
    if (first.get("label") or first["effect"]) == name:
        parameters = first["parameters"]
    elif name in first.get("alternatives", {}):
        parameters = first["alternatives"][name]["parameters"]
    else:
        return None
    return standardised_errors(name, line["truth"][name], parameters)


def binomial_interval(count, total):
    """Clopper and Pearson's 95 % interval of a share."""
    if total == 0:
        return 0.0, 1.0
    low = 0.0 if count == 0 else float(beta.ppf(0.025, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(0.975, count + 1, total - count))
    return low, high


def bootstrap_interval(counts, draws=10_000):
    """95 % interval of a share whose units are correlated within flights: percentile bootstrap over the flights.

    Efron and Tibshirani, An Introduction to the Bootstrap (1993), chapter 13.

    Parameters
    ----------
    counts : (N, 2) array
        Number of units of each flight that are within, and of all.
    """
    flights = np.random.default_rng(18).integers(len(counts), size=(draws, len(counts)))
    within, units = np.moveaxis(counts[flights].sum(axis=1), -1, 0)
    return np.percentile(within / units, (2.5, 97.5))


def share_text(count, total):
    """Count, total, share and its interval."""
    if total == 0:
        return "no flight"
    low, high = binomial_interval(count, total)
    return f"{count} of {total}, {count / total:.1%} ({low:.1%} to {high:.1%})"


def reliability(names):
    """Rows of the table of reliability.

    Parameters
    ----------
    names : sequence of (float, bool)
        Probability of each name, and whether it is right.

    Returns
    -------
    list of (low, high, count, right, mean)
        Bin, number of names and of right ones, mean probability (NaN without a name).
    """
    rows = []
    for low, high in pairwise(BINS):
        inside = [(p, right) for p, right in names if low <= p < high or (high == 1.0 and p == 1.0)]
        mean = float(np.mean([p for p, _ in inside])) if inside else float("nan")
        rows.append((low, high, len(inside), sum(right for _, right in inside), mean))
    return rows


def names_given(lines):
    """Probability of every name that was given, and whether it is right."""
    return [(n["probability"], is_right(n, line["hidden"])) for line in lines for n in line["named"]]


def leading_names(lines):
    """The same for the first of every ranking, whatever the verdict; of pairs, the names that were given."""
    out = names_given([line for line in lines if kind_of(line) == "pair"])
    for line in lines:
        if kind_of(line) != "pair" and line["ranking"]:
            out.append((line["ranking"][0]["probability"], is_right(line["ranking"][0], line["hidden"])))
    return out


def size_of(line):
    """Size of a flight's single hidden effect in smallest detectable sizes: the expected gain grows with its square."""
    (name,) = line["hidden"]
    return float(np.sqrt(max(line["expected_gains"][name], 0.0) / DETECTABLE))


def detection(lines):
    """Rows of the table of detection against size, of the flights with one effect of the catalogue.

    Returns
    -------
    list of (low, high, size, count, named, reported)
        Bin, geometric mean of the sizes (NaN without a flight), number of flights, of those in which the effect is
        named, and of those whose verdict is that something is missing: named, undecided or unknown.
    """
    single = [x for x in lines if kind_of(x) == "single"]
    rows = []
    for low, high in pairwise(SIZES):
        flights = [x for x in single if low <= size_of(x) < high]
        named = sum(any(is_right(n, x["hidden"]) for n in x["named"]) for x in flights)
        reported = sum(not is_clean(x) for x in flights)
        size = float(np.exp(np.mean(np.log([max(size_of(x), 1e-3) for x in flights])))) if flights else float("nan")
        rows.append((low, high, size, len(flights), named, reported))
    return rows


def rate_rows(lines):
    """Rows of the table of rates: what, outcome, goal."""
    of_kind = {k: [x for x in lines if kind_of(x) == k] for k in ("clean", "single", "pair", "outside")}
    clean, single, outside, pairs = (of_kind[k] for k in ("clean", "single", "outside", "pair"))
    rows = [
        ("clean: not called clean", share_text(sum(not is_clean(x) for x in clean), len(clean)), "at most 5 %"),
        ("clean: named something", share_text(sum(bool(x["named"]) for x in clean), len(clean)), ""),
        ("clean: undecided", share_text(sum(x["verdict"] == "undecided" for x in clean), len(clean)), ""),
    ]
    for symbol in clean[0]["increments"] if clean and "increments" in clean[0] else ():
        counts = np.array([x["increments"][symbol] for x in clean])
        (within, cells), (low, high) = counts.sum(axis=0), bootstrap_interval(counts)
        rows.append((
            f"clean: increments of {symbol} within 2 sigma, flown cells (correlated)",
            f"{within} of {cells}, {within / cells:.1%} ({low:.1%} to {high:.1%})", "93 to 97 %",
        ))  # fmt: skip
    for part, text in ((1.0, "plausible size"), (0.5, "half of it"), (None, "both")):
        flights = [x for x in single if detectable_names(x) and part in (x["part"], None)]
        right = sum(any(is_right(n, x["hidden"]) for n in x["named"]) for x in flights)
        goal = "at least 95 %" if part is None else ""
        rows.append((f"detectable effect, {text}: named first", share_text(right, len(flights)), goal))
    flights = [x for x in single if detectable_names(x)]
    undecided = sum(x["verdict"] == "undecided" for x in flights)
    rows.append(("detectable effect: undecided", share_text(undecided, len(flights)), ""))
    flights = [x for x in single if not detectable_names(x)]
    rows += [
        ("not detectable: called clean", share_text(sum(is_clean(x) for x in flights), len(flights)), ""),
        (
            "not detectable: undecided",
            share_text(sum(x["verdict"] == "undecided" for x in flights), len(flights)),
            "",
        ),
        ("not detectable: wrong name", share_text(sum(bool(wrong_names(x)) for x in flights), len(flights)), "none"),
    ]
    confident = sum(any(n["probability"] >= CONFIDENT for n in x["named"]) for x in outside)
    flights = [x for x in outside if detectable_names(x)]
    unknown = sum(x["verdict"] == "unknown" for x in flights)
    rows += [
        (f"outside the catalogue: name with {CONFIDENT:g} or more", share_text(confident, len(outside)), "none"),
        ("outside the catalogue: any name", share_text(sum(bool(x["named"]) for x in outside), len(outside)), ""),
        ("outside, detectable: unknown", share_text(unknown, len(flights)), "at least 80 %"),
    ]
    both = sum(all(any(n in group_of(g) for g in x["named"]) for n in x["hidden"]) for x in pairs)
    detected = sum(all(any(n in group_of(g) for g in x["named"]) for n in detectable_names(x)) for x in pairs)
    wrong = sum(bool(wrong_names(x)) for x in pairs)
    rows += [
        ("pairs: both named", share_text(both, len(pairs)), ""),
        ("pairs: every detectable one named", share_text(detected, len(pairs)), ""),
        ("pairs: wrong name among them", share_text(wrong, len(pairs)), "none"),
    ]
    errors = np.array([e for x in single for e in (parameter_errors(x) or {}).values()])
    within = int(np.sum(np.abs(errors) < 3.0))
    rms = f"{np.sqrt(np.mean(errors**2)):.2f}" if len(errors) else "no parameter"
    rows += [
        ("parameters of right names: within 3 sigma", share_text(within, len(errors)), "at least 98 %"),
        ("parameters of right names: rms of error over sigma", rms, "0.8 to 1.25"),
    ]
    return rows


def reliability_rows(names):
    """Cells of the table of reliability."""
    return [
        (f"{low:g} to {high:g}", str(count), "" if not count else f"{mean:.3f}", share_text(right, count))
        for low, high, count, right, mean in reliability(names)
    ]


def detection_rows(lines):
    """Cells of the table of detection against size."""
    return [
        (f"{low:g} to {high:g}" if np.isfinite(high) else f"more than {low:g}", str(count),
         share_text(named, count), share_text(reported, count))
        for low, high, _, count, named, reported in detection(lines)
    ]  # fmt: skip


def share_rows(lines):
    """Cells of the table of the share that the first name of a ranking explains, by whether it is right.

    Flights with one hidden effect or with something outside the catalogue whose first name gains more than the
    threshold, of which the number with hardly any excess variance is in brackets.
    """
    flights = [x for x in lines if kind_of(x) in ("single", "outside") and x["ranking"]]
    counts = {(low, right): [] for low in SHARES[:-1] for right in (True, False)}
    for x in flights:
        first = x["ranking"][0]
        if first["gain"] > DETECTABLE:
            low = max(edge for edge in SHARES[:-1] if first["explained_share"] >= edge)
            counts[low, is_right(first, x["hidden"])].append(bool(first["at_noise_floor"]))
    return [
        (f"{low:g} to {high:g}", *(f"{len(c)} ({sum(c)})" for c in (counts[low, True], counts[low, False])))
        for low, high in pairwise(SHARES)
    ]


def wrong_rows(lines):
    """Cells of the list of every flight that is not answered as it should be, and of every outlying parameter."""
    rows = []
    for x in lines:
        if not is_wrong(x):
            continue
        gains = ", ".join(f"{x['expected_gains'][n]:.3g}" for n in x["hidden"])
        given = ", ".join(f"{' or '.join(sorted(group_of(n)))} ({n['probability']:.3f})" for n in x["named"])
        rows.append((
            x["vehicle"], str(x["seed"]), " and ".join(x["hidden"]) or "nothing", f"{x['part']:g}", gains,
            x["verdict"] + (f": {given}" if given else ""),
        ))  # fmt: skip
    return rows


def outlier_rows(lines):
    """Cells of the list of parameters beyond three sigma."""
    return [
        (x["vehicle"], str(x["seed"]), x["hidden"][0], f"{x['part']:g}", name, f"{error:+.1f}")
        for x in lines
        for name, error in (parameter_errors(x) or {}).items()
        if abs(error) >= 3.0
    ]


def markdown_table(header, rows):
    """A table in Markdown."""
    return ["| " + " | ".join(cells) + " |" for cells in (header, ["---"] * len(header), *rows)]


def report(lines, figure):
    """Markdown of the study.

    Parameters
    ----------
    lines : sequence of dict
        Of the flights.
    figure : str
        Path of the figure from the page.
    """
    answered = [x for x in lines if "verdict" in x]
    refused = [x for x in lines if "verdict" not in x]
    hours = sum(x["seconds"] for x in lines) / 3600.0
    text = [
        "# Identification where nothing is known exactly",
        "",
        "`make study-inexact` simulates flights whose tables, air, mass and inertia differ from what their mission",
        "states, as much as it states that they may: CA, CN and Cm by smooth random functions of Mach number and angle",
        "with a third of MEVAD's 3 sigma, density by 10 %, winds by 10 m/s, mass by 0.5 % and inertia by 3 %.",
        "*Detectable* is computed with the truth and the same nuisance parameters, before the diagnosis: the expected",
        f"gain of the noise-free residuals exceeds {DETECTABLE:g} nats. Intervals (95 %): Clopper and Pearson,",
        "for correlated cells bootstrap over the flights.",
        "",
        f"{len(answered)} flights were diagnosed, in {hours:.1f} hours of one core; {len(refused)} were not.",
        "The flights of a seed are in random order, so that a part of them is a fair sample.",
        "",
        *markdown_table(("what", "outcome", "goal"), rate_rows(answered)),
        "",
        "## Reliability of the probabilities",
        "",
        "Names that were given, by their probability:",
        "",
        *markdown_table(("probability", "names", "mean", "right"), reliability_rows(names_given(answered))),
        "",
        "The first name of every ranking, whatever the verdict:",
        "",
        *markdown_table(("probability", "names", "mean", "right"), reliability_rows(leading_names(answered))),
        "",
        f"![Reliability of the probabilities, and detection against size]({figure})",
        "",
        "## Detection against size",
        "",
        "Flights with one effect of the catalogue, by its size in smallest detectable sizes (square root of the",
        f"expected gain over {DETECTABLE:g} nats):",
        "",
        *markdown_table(("size", "flights", "named", "named, undecided or unknown"), detection_rows(answered)),
        "",
        "## Explained share",
        "",
        f"First names that gain more than {DETECTABLE:g} nats, by the share that they explain of the log-likelihood",
        "between the model and one that holds; in brackets those that leave hardly any excess variance:",
        "",
        *markdown_table(("explained share", "right name", "wrong name"), share_rows(answered)),
        "",
        "## Flights with a wrong answer",
        "",
        *markdown_table(("vehicle", "seed", "hidden", "part", "expected gain", "answer"), wrong_rows(answered)),
        "",
        "## Parameters beyond three sigma",
        "",
        *markdown_table(("vehicle", "seed", "hidden", "part", "parameter", "error in sigmas"), outlier_rows(answered)),
    ]
    if refused:
        rows = [
            (x["vehicle"], str(x["seed"]), " and ".join(x["hidden"]) or "nothing", x.get("refused") or x["fault"])
            for x in refused
        ]
        text += ["", "## Flights that were not diagnosed", ""]
        text += markdown_table(("vehicle", "seed", "hidden", "reason"), rows)
    return "\n".join(text) + "\n"


def draw(lines, path):
    """Share of right names against their probability, and share of named effects against their size; with intervals."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(11, 4.8), layout="constrained")
    left.plot([0, 1], [0, 1], color="0.6", lw=1, label="probability = share")
    series = (
        (names_given(lines), "names given", "o", 0.0, (-16, -12)),
        (leading_names(lines), "first of every ranking", "s", 0.006, (6, -12)),
    )
    for names, label, marker, shift, offset in series:
        rows = [row for row in reliability(names) if row[2]]
        places = [row[4] + shift for row in rows]
        _plot_shares(left, places, [(row[3], row[2]) for row in rows], marker, label, offset)
    left.set_xlabel("probability of the name (mean of its bin)")
    left.set_ylabel("share of right names, with its 95 % interval")
    left.set_title("Reliability; numbers are counts of names")
    left.set_xlim(-0.03, 1.03)
    rows = [row for row in detection(lines) if row[3]]
    _plot_shares(right, [row[2] for row in rows], [(row[4], row[3]) for row in rows], "o", "named", (-9, 3))
    _plot_shares(
        right, [1.06 * row[2] for row in rows], [(row[5], row[3]) for row in rows], "^",
        "named, undecided or unknown", None,
    )  # fmt: skip
    right.axvline(1.0, color="0.6", lw=1)
    right.set_xscale("log")
    right.set_xlabel("size of the hidden effect in smallest detectable sizes")
    right.set_ylabel("share of flights, with its 95 % interval")
    right.set_title("Detection; numbers are counts of flights")
    for ax in (left, right):
        ax.set_ylim(-0.03, 1.06)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncol=3, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=110)
    plt.close(fig)


def _plot_shares(ax, x, counts, marker, label, offset):
    """Plot shares with their intervals; `counts` are pairs of number and total, which is written at `offset` points."""
    x, y = np.array(x), np.array([count / total for count, total in counts])
    ends = np.array([binomial_interval(*pair) for pair in counts]).reshape(-1, 2)
    ax.errorbar(x, y, yerr=np.abs(ends.T - y), fmt=marker, capsize=3, label=label)
    for px, py, (_, total) in zip(x, y, counts, strict=True) if offset else ():
        ax.annotate(str(total), (px, py), textcoords="offset points", xytext=offset, fontsize=8)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--page", type=Path, default=Path("docs/identification-inexact.md"))
    parser.add_argument("--figure", type=Path, default=Path("docs/figures/identification-inexact.png"))
    a = parser.parse_args()
    lines = [line for path in a.files for line in read_lines(path)]
    text = report(lines, Path(os.path.relpath(a.figure, a.page.parent)).as_posix())
    draw([x for x in lines if "verdict" in x], a.figure)
    a.page.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
