"""Store, statistics and figures of a campaign's folder, from the cases that are complete."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.results.campaign_statistics import statistics
from edl_filter.results.campaign_store import open_store, write_store
from edl_filter.results.files import FIGURES, write_json
from edl_filter.workflow.campaign_files import (
    SHARD,
    STORE,
    Progress,
    read_campaign,
    read_failures,
    read_progress,
    read_records,
)

STATISTICS = "statistics.json"


def gather(folder: Path) -> Progress:
    """Write ``results.zarr`` from the records of a campaign's folder; which cases it has.

    Raises
    ------
    InputError
        The folder is none of a campaign, or cannot be written.
    """
    campaign = read_campaign(folder)
    progress = read_progress(folder, campaign.total)
    shards = range((campaign.total - 1) // SHARD + 1)
    write_store(
        folder / STORE,
        lambda: (read_records(folder, shard) for shard in shards),
        campaign.groups,
        progress.done,
        progress.failed,
        {
            "title": campaign.title or campaign.name,
            "seed": campaign.seed,
            "analysis": campaign.analysis,
            "edl_filter_version": __version__,
        },
    )
    return progress


def report_campaign(folder: Path) -> dict[str, Any]:
    """Write ``statistics.json`` and figures of a campaign from its store, which is written first.

    Parameters
    ----------
    folder : Path
        Of the campaign.

    Returns
    -------
    dict
        ``statistics``: the content; ``failures``: list of dict; ``paths``: files that were written.

    Raises
    ------
    InputError
        The folder is none of a campaign, no case is done, or it cannot be written.
    """
    from edl_filter.report.campaign import campaign_figures
    from edl_filter.report.matplotlib_renderer import draw, write_canvas

    progress = gather(folder)
    if not progress.done.any():
        raise InputError(f"{folder}: no case is done; 'edl-filter campaign CAMPAIGN -o {folder}' runs them.")
    data = open_store(folder / STORE)
    content = statistics(data)
    paths = [folder / STORE, write_json(content, folder / STATISTICS)]
    for name, figure in campaign_figures(data, content, str(data.attrs["title"])).items():
        paths.append(write_canvas(draw(figure), folder / FIGURES / f"{name}.png"))
    return {"statistics": content, "failures": read_failures(folder), "paths": paths}
