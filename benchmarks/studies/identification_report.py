"""From the study's answers to a table and a figure: `python benchmarks/studies/identification_report.py FILES…`.

Reads the lines that `identification.py` wrote and prints the rates, the misses and the confusion as Markdown; with
``--figure PATH`` it draws the confusion matrix.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from edl_filter.effects.catalogue import catalogue

DETECTABLE = 6.0
OUTSIDE = ("oscillating_jet", "leak", "slosh")


def names_of(line):
    """What was named first, with its partners; or the verdict."""
    if line.get("verdict") != "missing":
        return (line.get("verdict") or "refused",)
    first = line["ranking"][0]
    return (first["effect"], *first["same_as"])


def inside(line):
    """Whether every estimated size is within three sigma of the truth; None where that is not asked."""
    if (
        line.get("verdict") != "missing"
        or len(line["hidden"]) != 1
        or line["ranking"][0]["effect"] != line["hidden"][0]
    ):
        return None
    truth = line["truth"][line["hidden"][0]]
    if line["hidden"][0] == "gravity_oblateness":
        truth = {"J2": abs(truth["J2"]) * 1.960454e-3 / 2e-3}
    found = line["ranking"][0]["parameters"]
    apart = {n: found[n]["estimate"] - v for n, v in truth.items() if found[n]["sigma"] > 0}
    if line["hidden"][0] == "density_wave":  # minus A is A half a turn on
        turned = found["A"]["estimate"] * truth["A"] < 0.0
        apart["A"] = abs(found["A"]["estimate"]) - abs(truth["A"])
        phase = found["phase"]["estimate"] - truth["phase"] + np.pi * turned
        apart["phase"] = (phase + np.pi) % (2.0 * np.pi) - np.pi
    return all(abs(d) < 3.0 * found[n]["sigma"] for n, d in apart.items())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--figure", type=Path)
    a = parser.parse_args()
    lines = [json.loads(text) for path in a.files for text in path.read_text().splitlines()]
    single = [line for line in lines if len(line["hidden"]) == 1 and line["hidden"][0] not in OUTSIDE]
    flown = [line for line in single if "verdict" in line]
    seen = [line for line in flown if line["expected_gain"] > DETECTABLE]
    right = [line for line in seen if line["hidden"][0] in names_of(line)]
    hidden = [line for line in flown if line["expected_gain"] <= DETECTABLE]
    clean = [line for line in lines if not line["hidden"]]
    outside = [line for line in lines if line["hidden"] and line["hidden"][0] in OUTSIDE and "verdict" in line]
    pairs = [line for line in lines if len(line["hidden"]) == 2 and "verdict" in line]
    sized = [inside(line) for line in right if inside(line) is not None]
    print("| what | flights | outcome |\n|---|---|---|")
    print(f"| detectable effect | {len(seen)} | right name first: {len(right)} |")
    print(f"| the same, estimate | {len(sized)} | all sizes within 3 sigma: {sum(sized)} |")
    print(
        f"| not detectable | {len(hidden)} | named all the same: {sum(x['hidden'][0] in names_of(x) for x in hidden)}, "
        f"another name: {sum(x['verdict'] == 'missing' and x['hidden'][0] not in names_of(x) for x in hidden)} |"
    )
    print(f"| clean | {len(clean)} | false alarms: {sum(x.get('verdict') != 'clean' for x in clean)} |")
    print(
        f"| outside the catalogue | {len(outside)} | unknown: {sum(x['verdict'] == 'unknown' for x in outside)}, "
        f"wrongly named: {sum(x['verdict'] == 'missing' for x in outside)} |"
    )
    print(f"| pairs | {len(pairs)} | both named: {sum(set(x['hidden']) <= set(x.get('named', ())) for x in pairs)} |")
    print(f"| not flown (tumbled) or faulty | {sum('verdict' not in x for x in lines)} | |")
    print("\nNot right:\n\n| vehicle | hidden | part | expected gain | outcome |\n|---|---|---|---|---|")
    for x in [*seen, *clean, *outside, *pairs]:
        named = names_of(x)
        wrong = (
            named[0] != "clean" if not x["hidden"] else x["verdict"] != "unknown" if x in outside
            else not set(x["hidden"]) <= set(x.get("named", ())) if x in pairs else x["hidden"][0] not in named
        )  # fmt: skip
        if wrong:
            also = f", named in all: {', '.join(x['named'])}" if x.get("named") else ""
            print(
                f"| {x['vehicle']} | {', '.join(x['hidden']) or 'nothing'} | {x['part']} | "
                f"{x.get('expected_gain', float('nan')):.3g} | {' or '.join(named)}{also} |"
            )
    for x in lines:
        if "verdict" not in x:
            print(
                f"| {x['vehicle']} | {', '.join(x['hidden'])} | {x['part']} | | {x.get('refused') or x.get('fault')} |"
            )
    if a.figure:
        draw(seen, clean, outside, a.figure)


def draw(seen, clean, outside, path):
    """Confusion matrix: hidden down, named across."""
    rows = [*catalogue(), *OUTSIDE, "nothing"]
    columns = [*catalogue(), "unknown", "clean"]
    counts = Counter()
    for x in [*seen, *clean, *outside]:
        hidden = x["hidden"][0] if x["hidden"] else "nothing"
        named = names_of(x)
        counts[hidden, hidden if hidden in named else named[0]] += 1
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
