"""The page ``docs/thesis-claims.md``: all statements as tables, and the rows of the page read again."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from thesis_claims import angles, atmospheres, forces, literature, moments, navigation
from thesis_claims.claim import AGREES, BOTH, CLAIMS, DIFFERS, OPEN, OPPORTUNITY, SPIRIT, Claim, Finding
from thesis_claims.flight import ClaimFlight

PAGE = Path(__file__).parents[3] / "docs" / "thesis-claims.md"
#: Modules in the order of the page: importing them fills `CLAIMS`.
MODULES = (navigation, atmospheres, forces, moments, angles, literature)
_HEAD = "| section | statement | rover | here | verdict | reason, remark |\n|---|---|---|---|---|---|\n"
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_MINUS = re.compile(r"(?<![\w.)])-(?=[\d(])")

INTRODUCTION = """# The thesis, claim by claim

<!-- Made by `make thesis-claims` from benchmarks/studies/thesis_claims.
tests/flights/test_thesis_claims.py computes every row again and compares it. -->

This page has every quantitative or qualitative statement on Spirit and Opportunity in the text of
[the thesis](citations.md), and those of a few other publications. The column *here* has the result of this project from
the same telemetry. The figures of the thesis and the digits of most of its tables were not available ("lost"). The Mach
numbers, Knudsen numbers and temperatures of this page are those of the thesis's gas: CO2 alone, R = 188.92 J/(kg K),
ratio of specific heats 1.3, hard spheres of 4.64e-10 m. ± is one sigma.

**Rules of the verdict.**

- A stated number *agrees* if the computed one is within the range of its "about", or within two combined sigma. If zero
  is within two sigma as well, the statement is *undecided*. "About", "near" and "around" mean 5 s for times (the step
  of the thesis's times), and otherwise about one unit of the last digit, unless the last column states another range.
- A limit *differs* if the computed number exceeds it by more than two sigma; if it exceeds it by less, the statement is
  undecided.
- A sign differs if the other sign is significant by two sigma; within two sigma of zero the statement is undecided.
- A qualitative statement is judged by the criterion in the last column.
- If the number of the thesis is lost or the quantity is not in the data, the statement is undecided.

The sign of a lateral coefficient follows the oscillation. Statements on averages and magnitudes are therefore tested
with the magnitude of the pair (CN, CY) or (Cm, Cn).

"""

PHOENIX = """## Phoenix

No statement on Phoenix is checked, because its telemetry is not available. The package has these parts for it:

- the mission `missions/phoenix.yaml`, with the known numbers of the flight and the source of each. It loads and
  validates; a run stops with a message that names the missing product;
- the processing of fine sampling: `tests/flights/test_archive_form.py` simulates a flight of the Phoenix-like vehicle
  at 200 Hz, writes it as a plain log (CSV, increments, microseconds), converts the log to a flight file and
  reconstructs it;
- the thesis's filters: low-pass of 15 and 17 Hz, second order over 901 points (`telemetry/smoothing.py`).

There is no reader of the format of Phoenix's archive, because no description of this format was available. The format
of the rovers' archive is known: the same tests write a simulated flight in it (TRANSFORMED and HIGHRATE in PDS3 text
with labels, with the archive's repeated rows, gap, register resets and the columns of an IMU that is switched off) and
reconstruct it through the rovers' reader. A reader for Phoenix needs the interface document of the product, with

- names, order, types and units of the columns; increments or rates, and which end of the interval a row's time is;
- the marks of missing and repeated rows, and the events (resets, changes of rate) that the product contains;
- the relation of the spacecraft clock to UTC;
- the transformation from IMU to cruise axes, with the correction to its preliminary matrix that the archive mentions,
  and the cruise axes in body axes;
- the position of the IMU relative to the centre of mass, and the attitude at a known time.
"""


def findings(flights: Mapping[str, ClaimFlight]) -> dict[Claim, Finding]:
    """Every row computed from the two flights by name."""
    order = [module.__name__ for module in MODULES]
    return {claim: claim.finding(flights) for claim in sorted(CLAIMS, key=lambda c: order.index(c.function.__module__))}


def markdown(rows: Mapping[Claim, Finding]) -> str:
    """The page."""
    chapters = list(dict.fromkeys(claim.chapter for claim in rows))
    parts = [INTRODUCTION, summary(rows)]
    for chapter in chapters:
        of_chapter = {c: f for c, f in rows.items() if c.chapter == chapter}
        parts += [f"## {chapter}\n\n", _HEAD, *(_line(c, f) for c, f in of_chapter.items()), "\n"]
    return "".join([*parts, PHOENIX])


def summary(rows: Mapping[Claim, Finding]) -> str:
    """Number of verdicts by rover."""
    lines = ["| | agrees | differs | undecided |\n|---|---|---|---|\n"]
    for rover in (SPIRIT, OPPORTUNITY, BOTH):
        verdicts = [f.verdict for c, f in rows.items() if c.rover == rover]
        lines.append(f"| {rover} | " + " | ".join(str(verdicts.count(v)) for v in (AGREES, DIFFERS, OPEN)) + " |\n")
    return "".join([*lines, "\n"])


def computed_row(claim: Claim, finding: Finding) -> tuple[str, str, str]:
    """Computed number, verdict and reason as the page would have them."""
    return page_rows(_line(claim, finding))[claim.statement, claim.rover]


def page_rows(text: str) -> dict[tuple[str, str], tuple[str, str, str]]:
    """(statement, rover) → (computed, verdict, reason) as a page has them."""
    rows = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and len(cells) == 6 and cells[2] in (SPIRIT, OPPORTUNITY, BOTH):
            rows[cells[1], cells[2]] = cells[3], cells[4].strip("*"), cells[5]
    return rows


def same_to_the_digits(page: str, computed: str) -> bool:
    """Whether two texts have the same words, and numbers that differ by at most one unit of the last digit printed.

    One unit: another machine may round a number the other way.
    """
    if _NUMBER.split(page) != _NUMBER.split(computed):
        return False
    pairs = list(zip(_NUMBER.findall(page), _NUMBER.findall(computed), strict=True))
    same_digits = all(_decimals(a) == _decimals(b) for a, b in pairs)
    return same_digits and all(abs(float(a) - float(b)) <= 1.001 * 10.0 ** -_decimals(a) for a, b in pairs)


def _decimals(number: str) -> int:
    return len(number.partition(".")[2])


def _line(claim: Claim, finding: Finding) -> str:
    mark = "**" if finding.verdict == DIFFERS else ""
    verdict = f"{mark}{finding.verdict}{mark}"
    cells = (claim.section, claim.statement, claim.rover, finding.text or "—", verdict, finding.why)
    assert not any("|" in cell for cell in cells), claim.name
    return _MINUS.sub("−", f"| {' | '.join(cells)} |\n")
