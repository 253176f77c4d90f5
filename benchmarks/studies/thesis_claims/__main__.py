"""Compute all statements from the two shipped missions and write the page."""

import sys

from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from thesis_claims.claim import OPPORTUNITY, SPIRIT
from thesis_claims.flight import ClaimFlight
from thesis_claims.page import PAGE, findings, markdown


def main() -> int:
    """Write ``docs/thesis-claims.md``."""
    missions = {SPIRIT: "builtin:mer_a", OPPORTUNITY: "builtin:mer_b"}
    flights = {rover: ClaimFlight(reconstruct(Mission.load(name))) for rover, name in missions.items()}
    rows = findings(flights)
    PAGE.write_text(markdown(rows), encoding="utf-8")
    print(f"{PAGE}: {len(rows)} rows")
    return 0


if __name__ == "__main__":
    sys.exit(main())
