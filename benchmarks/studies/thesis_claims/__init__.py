"""The thesis's statements on the rovers, each with the number that this project computes: `make thesis-claims`.

One function per statement, in the module of its chapters: `navigation` (chapters 2 and 3), `atmospheres` (4 to 6),
`forces` (7.1), `moments` (7.2, 7.3), `angles` (8, 9); `literature` has statements of other publications. A function
takes a `flight.ClaimFlight` (or both) and returns a `claim.Finding`: the number with its sigma, the verdict, and the
reason. `page` writes ``docs/thesis-claims.md``; ``tests/flights/test_thesis_claims.py`` computes every row again and
compares it with that page.

The text of the thesis was available without its figures and without the digits of most of its tables.
"""
