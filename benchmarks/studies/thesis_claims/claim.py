"""What a statement is, and the rule by which a computed number agrees with it or not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

AGREES, DIFFERS, OPEN = "agrees", "differs", "undecided"
SPIRIT, OPPORTUNITY, BOTH = "Spirit", "Opportunity", "both"
#: The thesis states times in steps of five seconds: "near 125 s" is 120 to 130 s.
NEAR = 5.0
#: Number of combined sigmas within which two numbers agree.
SIGMAS = 2.0

#: Reason for each verdict that can occur, or one reason for all of them.
Reason = str | Mapping[str, str]


@dataclass(frozen=True)
class Finding:
    """A computed number as text, its verdict, and the reason."""

    text: str
    verdict: str
    why: str = ""


@dataclass(frozen=True)
class Claim:
    """One statement on one rover, or on both together.

    Attributes
    ----------
    name : str
        Name of the function that computes it.
    chapter, section, statement : str
        Heading of the page, place and content of the statement.
    rover : str
        `SPIRIT`, `OPPORTUNITY` or `BOTH`.
    function : callable
        ``function(flight) -> Finding``, with both flights for `BOTH`.
    """

    name: str
    chapter: str
    section: str
    statement: str
    rover: str
    function: Callable[..., Finding]

    def finding(self, flights: Mapping[str, Any]) -> Finding:
        """Compute the row from the flights by name."""
        if self.rover == BOTH:
            return self.function(flights[SPIRIT], flights[OPPORTUNITY])
        return self.function(flights[self.rover])


#: All statements, in the order of the page.
CLAIMS: list[Claim] = []


def claim(chapter: str, section: str, statement: str, *rovers: str) -> Callable[[Callable], Callable]:
    """Register a function for the rovers that a statement is about."""

    def register(function: Callable) -> Callable:
        CLAIMS.extend(Claim(function.__name__, chapter, section, statement, rover, function) for rover in rovers)
        return function

    return register


def reason(why: Reason, verdict: str) -> str:
    """The reason for a verdict; none where the reasons have another verdict."""
    return why if isinstance(why, str) else why.get(verdict, "")


def judged(text: str, holds: bool, why: Reason = "") -> Finding:
    """A statement that holds or does not."""
    verdict = AGREES if holds else DIFFERS
    return Finding(text, verdict, reason(why, verdict))


def undecided(text: str, why: str) -> Finding:
    """A statement that cannot be checked: its number is lost, or the quantity is not in the data."""
    return Finding(text, OPEN, why)


def about(value: float, sigma: float, stated: float, tolerance: float, unit: str, why: Reason = "") -> Finding:
    """A stated number: agrees within its own "about", or within two sigma where zero is then excluded.

    Where both the stated number and zero are within two sigma the verdict is undecided.
    """
    miss = abs(value - stated)
    if miss <= tolerance:
        verdict = AGREES
    elif miss <= SIGMAS * sigma:
        verdict = AGREES if abs(value) > SIGMAS * sigma else OPEN
    else:
        verdict = DIFFERS
    return Finding(quantity(value, sigma, unit), verdict, reason(why, verdict))


def at_most(value: float, sigma: float, limit: float, unit: str, why: Reason = "") -> Finding:
    """A stated upper limit: differs where the number exceeds it by more than two sigma, undecided up to that."""
    verdict = AGREES if value <= limit else OPEN if value <= limit + SIGMAS * sigma else DIFFERS
    return Finding(quantity(value, sigma, unit), verdict, reason(why, verdict))


def positive(value: float, sigma: float, unit: str, why: Reason = "") -> Finding:
    """A stated sign, positive: undecided within two sigma of zero."""
    verdict = AGREES if value > SIGMAS * sigma else DIFFERS if value < -SIGMAS * sigma else OPEN
    return Finding(quantity(value, sigma, unit), verdict, reason(why, verdict))


def quantity(value: float, sigma: float = 0.0, unit: str = "", digits: int = 2) -> str:
    """Number with its sigma: two digits of a sigma that begins with 1 or 2, otherwise one; `digits` without a sigma.

    Numbers below 1e-3 have one power of ten for both.
    """
    if not np.isfinite(value):
        return "none"
    largest = max(abs(value), sigma)
    power = int(np.floor(np.log10(largest))) if 0.0 < largest < 1e-3 else 0
    value, sigma = value / 10.0**power, sigma / 10.0**power
    places = _places(sigma) if sigma > 0.0 else _places(value, digits)
    value = round(value, places) + 0.0  # no negative zero
    unit = unit if unit in ("", "°") else f" {unit}"
    spread = f" ± {sigma:.{places}f}" if sigma > 0.0 else ""
    if power:
        number = f"({value:.{places}f}{spread})" if spread else f"{value:.{places}f}"
        return f"{number}e{power}{unit}"
    return f"{value:.{places}f}{unit if unit == '°' and spread else ''}{spread}{unit}"


def _places(number: float, digits: int | None = None) -> int:
    """Decimal places with which a number has `digits` significant digits, or those of a sigma."""
    if number == 0.0:
        return 0
    first = int(np.floor(np.log10(abs(number))))
    if digits is None:
        digits = 2 if abs(number) / 10.0**first < 3.0 else 1
    return max(0, digits - 1 - first)
