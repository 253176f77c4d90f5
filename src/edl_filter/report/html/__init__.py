"""`report.html`: one file per run that opens without a network.

In: a result folder, read by `results.reader`. Out: the page.

Read in this order: `page` has the blocks (text, table, plot) and turns them into HTML through one template;
`flight_sections`, `diagnosis_sections` and `residual_map` turn the contents of the result into blocks; `bundle` is the
plotting library, with which one script of the template draws the plots.
"""

from pathlib import Path

from edl_filter.report.html import diagnosis_sections as diagnosis
from edl_filter.report.html import flight_sections as flight
from edl_filter.report.html.page import write_page
from edl_filter.report.html.residual_map import residual_map

#: Sections after the verdict, in the order of the page.
SECTIONS = (
    flight.events, residual_map, diagnosis.hypotheses, diagnosis.missing, diagnosis.database, diagnosis.ledger,
    flight.trajectory, flight.atmosphere, flight.coefficients, flight.constraints, flight.instruments,
    flight.provenance,
)  # fmt: skip


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` from the contents of a result folder.

    Parameters
    ----------
    folder : path
        Folder of a run, with or without a diagnosis and a ledger. The report states which parts are missing.

    Returns
    -------
    Path
        ``report.html`` in the folder.

    Raises
    ------
    InputError
        The folder has neither a result nor a summary, or it cannot be written.
    """
    return write_page(Path(folder), diagnosis.verdict, SECTIONS)
