"""Terminal output of the commands.

In: the content of ``summary.json`` or ``diagnosis.json``, effects of the catalogue, statistics of a campaign. Out: text
and tables on the terminal or in a pipe. Read in this order: `console` (output through rich), `table` (tables that fit
the width of the terminal), then one file per subject: `run`, `diagnosis`, `effects` and `campaign`.
"""
