"""The folder of a campaign: one small file for each case, so that an interruption loses nothing that is complete.

``campaign.json`` has the campaign and the version of the program, ``cases/NNNNNN/NNNNNNNNN.json`` the record of a case,
``failures/NNNNNN/NNNNNNNNN.json`` why a case has none; each folder holds a thousand cases. A file appears when it is
complete (`edl_filter.io.atomic`), so a case is done if its file exists.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.results.files import write_json
from edl_filter.simulation.campaign_config import Campaign
from edl_filter.simulation.dispersion import load_flight
from edl_filter.types import BoolArray

CASES, FAILURES, CAMPAIGN, STORE = "cases", "failures", "campaign.json", "results.zarr"
#: Cases in one folder.
SHARD = 1000
#: Keys of a campaign that may change between two runs in one folder: records do not depend on them.
FREE_KEYS = ("title", "cases", "time_limit_s", "start_limit_s")


@dataclass(frozen=True)
class CampaignJob:
    """What a process needs to run cases; plain data, sent to workers.

    Attributes
    ----------
    folder : str
        Absolute path of the campaign's folder.
    campaign : dict
        The campaign as plain data.
    source : str or None
        Absolute path of its file, from whose folder relative paths start.
    program : str
        Module that runs the cases in a process of its own.
    version : str
        Of edl-filter, which workers must have.
    """

    folder: str
    campaign: dict[str, Any]
    source: str | None
    program: str = "edl_filter.workflow.campaign_process"
    version: str = __version__

    @classmethod
    def of(cls, campaign: Campaign, folder: Path) -> CampaignJob:
        """Job of a campaign in a folder."""
        source = None if campaign.source is None else str(campaign.source.absolute())
        return cls(str(folder.absolute()), campaign.model_dump(mode="json", exclude_unset=True), source)

    def load(self) -> Campaign:
        """The campaign."""
        source = None if self.source is None else Path(self.source)
        return Campaign.from_dict(self.campaign, str(self.source or "campaign"), source)


@dataclass(frozen=True, eq=False)
class Progress:
    """Which cases are complete.

    Attributes
    ----------
    done, failed : (N,) boolean arrays
        By number; a case is not both.
    """

    done: BoolArray
    failed: BoolArray

    @property
    def missing(self) -> list[int]:
        """Numbers of the cases that have neither a record nor a failure."""
        return [int(n) for n in np.flatnonzero(~(self.done | self.failed))]


def case_path(folder: Path, kind: str, number: int) -> Path:
    """File of a case in `CASES` or `FAILURES`."""
    return folder / kind / f"{number // SHARD:06d}" / f"{number:09d}.json"


def write_record(folder: Path, record: dict[str, Any]) -> None:
    """Write the record of a case on one line; it appears when it is complete.

    Raises
    ------
    InputError
        The disk is full or the folder cannot be written.
    """
    from edl_filter.results.files import finite

    text = json.dumps(finite(record), allow_nan=False) + "\n"
    replace_with(case_path(folder, CASES, record["case"]), lambda path: path.write_text(text, encoding="utf-8"))


def write_failure(folder: Path, campaign: Campaign, number: int, kind: str, message: str, trace: str = "") -> None:
    """Write why a case failed, with the command that repeats it.

    Parameters
    ----------
    folder : Path
        Of the campaign.
    campaign : Campaign
        The campaign.
    number : int
        Of the case.
    kind : str
        ``input``, ``error``, ``time limit`` or ``process ended``.
    message, trace : str
        One sentence; traceback of an error.
    """
    key = campaign.case(number)
    content = {
        "case": number,
        "flight": key.flight,
        "dispersion": key.dispersion,
        "seed": [campaign.seed, number],
        "kind": kind,
        "message": message,
        "command": f"edl-filter campaign {campaign.source or CAMPAIGN} --case {number}",
        "traceback": trace,
    }
    write_json(content, case_path(folder, FAILURES, number))


def read_progress(folder: Path, total: int) -> Progress:
    """Which of the cases 0 to `total` - 1 are complete, and which failed and were not repeated with success.

    Parameters
    ----------
    folder : Path
        Of the campaign.
    total : int
        Number of cases.
    """
    done, failed = np.zeros(total, bool), np.zeros(total, bool)
    for kind, mask in ((CASES, done), (FAILURES, failed)):
        for number in _numbers(folder / kind):
            if number < total:
                mask[number] = True
    return Progress(done, failed & ~done)


def _numbers(folder: Path) -> Iterator[int]:
    for path in folder.glob("[0-9]*/[0-9]*.json"):
        yield int(path.stem)


def read_records(folder: Path, shard: int) -> list[dict[str, Any]]:
    """Records of the cases of one folder of `SHARD` cases, by number."""
    paths = sorted((folder / CASES / f"{shard:06d}").glob("[0-9]*.json"))
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths]


def read_failures(folder: Path) -> list[dict[str, Any]]:
    """Failures, by number."""
    paths = sorted((folder / FAILURES).glob("[0-9]*/[0-9]*.json"))
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths]


def claim_folder(folder: Path, campaign: Campaign) -> None:
    """Check that a folder is empty or holds results of this campaign, and write ``campaign.json``.

    Raises
    ------
    InputError
        It holds those of another campaign or of another version of the program, or cannot be written.
    """
    path = folder / CAMPAIGN
    content = _identity(campaign)
    if path.is_file():
        stated = read_identity(folder)
        if stated["version"] != __version__:
            raise InputError(
                f"{folder}: holds cases of edl-filter {stated['version']}, this is {__version__}; "
                "name another folder with -o."
            )
        for key, text in content["fixed"].items():
            if stated["fixed"].get(key) != text:
                raise InputError(
                    f"{folder}: holds cases of another campaign ({key} differs); name another folder with -o, or "
                    "restore it."
                )
        if stated["campaign"] == content["campaign"]:
            return
    write_json(content, path)


def read_identity(folder: Path) -> dict[str, Any]:
    """Content of ``campaign.json``.

    Raises
    ------
    InputError
        The folder has none.
    """
    try:
        content = json.loads((folder / CAMPAIGN).read_text(encoding="utf-8"))
        if not {"version", "fixed", "campaign"} <= set(content):
            raise ValueError
        return dict(content)
    except (OSError, ValueError):
        raise InputError(f"{folder}: found no {CAMPAIGN}; the folder of a campaign is expected.") from None


def read_campaign(folder: Path) -> Campaign:
    """The campaign of a folder."""
    content = read_identity(folder)
    source = Path(content["source"]) if content.get("source") else None
    return Campaign.from_dict(content["campaign"], str(folder / CAMPAIGN), source)


def _identity(campaign: Campaign) -> dict[str, Any]:
    """Campaign, version, and what must not change: every key, and the texts of scenarios and missions."""
    data = campaign.model_dump(mode="json")
    fixed = {key: _digest(value) for key, value in data.items() if key not in FREE_KEYS}
    for name in campaign.flights:
        flight = load_flight(campaign, name)
        texts: list[Any] = [flight.mission.text]
        if flight.scenario is not None:
            texts += [flight.scenario.model_dump(mode="json"), flight.scenario.model.text]
        fixed[f"files of flights.{name}"] = _digest(texts)
    return {
        "version": __version__,
        "source": None if campaign.source is None else str(campaign.source.absolute()),
        "campaign": campaign.model_dump(mode="json", exclude_unset=True),
        "fixed": fixed,
    }


def _digest(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def ranges_text(numbers: list[int], most: int = 8) -> str:
    """Numbers in ascending order as ranges: ``0-3, 7``; at most `most` of these."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    texts = [str(low) if low == high else f"{low}-{high}" for low, high in ranges[:most]]
    return ", ".join(texts) + (" …" if len(ranges) > most else "")
