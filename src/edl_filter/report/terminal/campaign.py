"""Statistics of a campaign on the terminal."""

from __future__ import annotations

from typing import Any

from edl_filter.report.terminal.console import echo, empty_table


def print_statistics(content: dict[str, Any], failures: list[dict[str, Any]]) -> None:
    """Print counts, landing ellipses, coverage and failures of a campaign.

    Parameters
    ----------
    content : dict
        As in ``statistics.json``.
    failures : list of dict
        Failed cases, of which the first ones are printed with the command that repeats them.
    """
    groups = empty_table(
        "Cases", ("flight", "dispersion"), ("done", "failed", "missing", "trusted", "landing 95 % ellipse, km")
    )
    for group in content["groups"]:
        cases = group["cases"]
        landing = group.get("landing", {})
        shown = landing.get("without landing constraint") or landing.get("truth") or landing.get("estimate")
        text = (
            "–" if shown is None else f"{1e-3 * shown['semi_major_95_m']:.3g} × {1e-3 * shown['semi_minor_95_m']:.3g}"
        )
        trusted = f"{group['trustworthy']:.1%}" if "trustworthy" in group else "–"
        groups.add_row(
            group["flight"], group["dispersion"], str(cases["done"]), str(cases["failed"]), str(cases["missing"]),
            trusted, text,
        )  # fmt: skip
    coverage = empty_table(
        "Coverage at rest and before the parachute (normal: 68, 95, 99.7 %)", ("flight", "dispersion", "phase", "part"),
        ("1 sigma", "2 sigma", "3 sigma", "NEES per dof"),
    )  # fmt: skip
    covered = False
    for group in content["groups"]:
        for row in group.get("coverage", ()):
            if row["phase"] in ("before parachute", "rest") and row["part"] != "all":
                covered = True
                shares = (f"{share:.1%}" for share in row["within_sigmas"])
                coverage.add_row(
                    group["flight"], group["dispersion"], row["phase"], row["part"], *shares,
                    f"{row['nees_per_dof']:.2f}",
                )  # fmt: skip
    echo(groups, *([coverage] if covered else []))
    for failure in failures[:5]:
        echo(f"Case {failure['case']} failed ({failure['kind']}): {failure['message']}".replace("[", r"\["))
        echo(f"  {failure['command']}")
    if len(failures) > 5:
        echo(f"{len(failures) - 5} more cases failed; the folder failures has all.")
