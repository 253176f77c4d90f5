"""Table and figure of the study's results: `python benchmarks/studies/identification_report.py FILES…`.

Reads the lines that `identification.py` wrote and prints the rates, the errors and the confusion as Markdown; with
``--figure PATH`` it draws the confusion matrix.
"""

import argparse
from collections import Counter
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from identification import OUTSIDE, TRUE_J2
from study_lines import read_lines

from edl_filter.effects.registry import catalogue
from edl_filter.mission.decision_settings import DecisionSettings

#: Expected gain from which an effect is detectable, nats.
DETECTABLE = DecisionSettings().named_gain_nats


def names_of(line):
    """The first name, with those that are not distinguished from it; or the verdict."""
    if line.get("verdict") != "missing":
        return (line.get("verdict") or "refused",)
    first = line["ranking"][0]
    return (first["effect"], *first["same_as"])


def standardised_errors(name, truth, parameters):
    """Errors of the estimates in their sigmas, by parameter.

    Parameters
    ----------
    name : str
        The hidden effect.
    truth : dict
        Parameter → true value, in the units of the effect.
    parameters : dict
        Parameter → ``estimate`` and ``sigma``; those that were not estimated have a sigma of zero.
    """
    if name == "gravity_oblateness":
        truth = {"J2": abs(truth["J2"]) * TRUE_J2 / 2e-3}
    errors = {n: parameters[n]["estimate"] - v for n, v in truth.items() if (parameters[n]["sigma"] or 0.0) > 0.0}
    if name == "density_wave":  # minus A is A half a turn on
        opposite = parameters["A"]["estimate"] * truth["A"] < 0.0
        errors["A"] = abs(parameters["A"]["estimate"]) - abs(truth["A"])
        phase = parameters["phase"]["estimate"] - truth["phase"] + np.pi * opposite
        errors["phase"] = (phase + np.pi) % (2.0 * np.pi) - np.pi
    return {n: e / parameters[n]["sigma"] for n, e in errors.items()}


def estimates_agree(line):
    """Whether every estimated size is within three sigma of the truth; None where the name is not the hidden one."""
    if (
        line.get("verdict") != "missing"
        or len(line["hidden"]) != 1
        or line["ranking"][0]["effect"] != line["hidden"][0]
    ):
        return None
    name = line["hidden"][0]
    errors = standardised_errors(name, line["truth"][name], line["ranking"][0]["parameters"])
    return all(abs(e) < 3.0 for e in errors.values())


def is_wrong(line, outside):
    """Whether the names or the verdict are not those of what was hidden."""
    names = names_of(line)
    if not line["hidden"]:
        return names[0] != "clean"
    if line in outside:
        return line["verdict"] != "unknown"
    if len(line["hidden"]) == 2:
        return not set(line["hidden"]) <= set(line.get("named", ()))
    return line["hidden"][0] not in names


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--figure", type=Path)
    a = parser.parse_args()
    lines = [line for path in a.files for line in read_lines(path)]
    single = [line for line in lines if len(line["hidden"]) == 1 and line["hidden"][0] not in OUTSIDE]
    diagnosed = [line for line in single if "verdict" in line]
    detectable = [line for line in diagnosed if line["expected_gain"] > DETECTABLE]
    correct = [line for line in detectable if line["hidden"][0] in names_of(line)]
    undetectable = [line for line in diagnosed if line["expected_gain"] <= DETECTABLE]
    clean = [line for line in lines if not line["hidden"]]
    outside = [line for line in lines if line["hidden"] and line["hidden"][0] in OUTSIDE and "verdict" in line]
    pairs = [line for line in lines if len(line["hidden"]) == 2 and "verdict" in line]
    agreement = [estimates_agree(line) for line in correct if estimates_agree(line) is not None]
    named = sum(x["hidden"][0] in names_of(x) for x in undetectable)
    misnamed = sum(x["verdict"] == "missing" and x["hidden"][0] not in names_of(x) for x in undetectable)
    print("| what | flights | outcome |\n|---|---|---|")
    print(f"| detectable effect | {len(detectable)} | right name first: {len(correct)} |")
    print(f"| the same, estimate | {len(agreement)} | all sizes within 3 sigma: {sum(agreement)} |")
    print(f"| not detectable | {len(undetectable)} | named all the same: {named}, another name: {misnamed} |")
    print(f"| clean | {len(clean)} | false alarms: {sum(x.get('verdict') != 'clean' for x in clean)} |")
    print(
        f"| outside the catalogue | {len(outside)} | unknown: {sum(x['verdict'] == 'unknown' for x in outside)}, "
        f"wrongly named: {sum(x['verdict'] == 'missing' for x in outside)} |"
    )
    print(f"| pairs | {len(pairs)} | both named: {sum(set(x['hidden']) <= set(x.get('named', ())) for x in pairs)} |")
    print(f"| not flown (tumbled) or faulty | {sum('verdict' not in x for x in lines)} | |")
    print("\nNot right:\n\n| vehicle | hidden | part | expected gain | outcome |\n|---|---|---|---|---|")
    for x in [*detectable, *clean, *outside, *pairs]:
        if is_wrong(x, outside):
            also = f", named in all: {', '.join(x['named'])}" if x.get("named") else ""
            print(
                f"| {x['vehicle']} | {', '.join(x['hidden']) or 'nothing'} | {x['part']} | "
                f"{x.get('expected_gain', float('nan')):.3g} | {' or '.join(names_of(x))}{also} |"
            )
    for x in lines:
        if "verdict" not in x:
            print(
                f"| {x['vehicle']} | {', '.join(x['hidden'])} | {x['part']} | | {x.get('refused') or x.get('fault')} |"
            )
    if a.figure:
        draw(detectable, clean, outside, a.figure)


def draw(detectable, clean, outside, path):
    """Confusion matrix: hidden effects in the rows, names in the columns."""
    rows = [*catalogue(), *OUTSIDE, "nothing"]
    columns = [*catalogue(), "unknown", "clean"]
    counts = Counter()
    for x in [*detectable, *clean, *outside]:
        hidden = x["hidden"][0] if x["hidden"] else "nothing"
        names = names_of(x)
        counts[hidden, hidden if hidden in names else names[0]] += 1
    matrix = np.array([[counts[r, c] for c in columns] for r in rows])
    share = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
    fig, ax = plt.subplots(figsize=(11, 10.5), layout="constrained")
    ax.imshow(share, cmap="cividis", vmin=0, vmax=1, aspect="auto")
    for i, j in np.argwhere(matrix):
        ax.text(j, i, matrix[i, j], ha="center", va="center", color="black" if share[i, j] > 0.5 else "white")
    ax.set_xticks(range(len(columns)), columns, rotation=60, ha="right")
    ax.set_yticks(range(len(rows)), rows)
    ax.set_xlabel("named first, alone or with declared partners")
    ax.set_ylabel("hidden in the flight")
    ax.set_title("Identification on simulated flights: number of flights")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
