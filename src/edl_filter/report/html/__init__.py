"""`report.html`: one file per run that opens without a network, for people who did not make the run.

`write_report` builds it from a results folder alone. Each section is a small function from the folder's content to
blocks (text, table, plot); one template turns blocks into HTML, and one script draws the plots.
"""

from edl_filter.report.html.page import REPORT, write_report

__all__ = ["REPORT", "write_report"]
