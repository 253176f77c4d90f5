"""`report.html`: one file per run that opens without a network.

In: a result folder, read by `results.reader`. Out: the page. `flight_sections`, `diagnosis_sections` and `residual_map`
turn the contents into blocks (text, table, plot; `blocks`); `page` turns blocks into HTML through one template, and one
script draws the plots.
"""

from edl_filter.report.html.page import REPORT, write_report

__all__ = ["REPORT", "write_report"]
