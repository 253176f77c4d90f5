"""Fetch the public MER telemetry by checksum, and find it where it already is."""

from __future__ import annotations

import os
import re
from pathlib import Path

from edl_filter.errors import InputError
from edl_filter.telemetry.pds3 import find_file
from edl_filter.whole_file import usual_mode

#: PDS Atmospheres node, volume merimu_1001.
BASE_URL = "https://pds-atmospheres.nmsu.edu/PDS/data/merimu_1001/"
#: File of the volume → sha256.
REGISTRY = {
    "AAREADME.txt": "0fa71f17f8e0f012eadefb00c7b62b156e15d9f93ead3be199212f2f52a5fe49",
    "DATA/1HIGHRATE.LBL": "86f6a753a8357125bfde2ec2cf16802080438ceafaf5155445ad6d1f5dd917e3",
    "DATA/1HIGHRATE.TAB": "8c34c3448d7aafad590a05eb76b7611fc820c5bed42e222b785fa97a5d5d7a56",
    "DATA/1TRANSFORMED.LBL": "aa4d155e266b2633af864b77a4d9c5e1cf54f0f6eb1270c085f28421f568117f",
    "DATA/1TRANSFORMED.TAB": "a4796482af6ab5e8d955423e423d9a528848a6bad52b7fea280901097ea574a9",
    "DATA/2HIGHRATE.LBL": "be844194cf29f4c153a4d0bb3ecde6f3041c805fb5e6153fd8138f40921151cb",
    "DATA/2HIGHRATE.TAB": "c1e65d7358ff1f660c9463410ada18938ddbb15ddd97f9891f9e768482dfd959",
    "DATA/2TRANSFORMED.LBL": "600aa46817c0e98fdb38ac16a7f6e4eb0bbd33a27cf3904496c134562f5c394a",
    "DATA/2TRANSFORMED.TAB": "3269f400f2a372b150c52897e55ce4a7df270f1fdadf2253f02aeb6ed82e454e",
}
_INSTEAD = "put the volume's DATA folder under $EDL_FILTER_DATA/pds/mer_imu instead"


def cache_folder(cache: str | Path | None = None) -> Path:
    """Folder of fetched data: `cache`, else ``$EDL_FILTER_CACHE``, else the system's for ``edl-filter``."""
    if cache is not None:
        return Path(cache)
    if named := os.environ.get("EDL_FILTER_CACHE"):
        return Path(named)
    import pooch  # slow to import

    return Path(pooch.os_cache("edl-filter"))


def fetch_mer_imu(base_url: str | None = None, cache: str | Path | None = None, progress: bool = False) -> Path:
    """Download what is not in the cache yet of Spirit and Opportunity's IMU telemetry (about 5 MB).

    Parameters
    ----------
    base_url : str
        Address of a copy of the volume, or of its DATA folder; the PDS Atmospheres node if not given.
    cache : path
        Folder for downloads; see `cache_folder`.
    progress : bool
        Show a progress bar on the terminal (standard error; silent if that is no terminal).

    Returns
    -------
    Path
        Folder with ``DATA/*.LBL`` and ``DATA/*.TAB``: ``<cache>/mer_imu``.

    Raises
    ------
    InputError
        No answer from the server, or a file whose sha256 is not the known one.
    """
    import logging

    import pooch
    import requests
    from rich.console import Console
    from rich.progress import track

    folder, base = cache_folder(cache) / "mer_imu", _volume(base_url or BASE_URL)
    pooch.get_logger().setLevel(logging.WARNING)
    console = Console(stderr=True)
    hidden = not (progress and console.is_terminal)
    try:
        store = pooch.create(path=folder, base_url=base, registry=REGISTRY)
        for name in track(list(REGISTRY), "MER telemetry", console=console, disable=hidden, transient=True):
            Path(store.fetch(name)).chmod(usual_mode())  # pooch makes it private
    except ValueError as error:  # pooch's for a hash that does not match
        if "hash" not in str(error):
            raise InputError(f"download failed: {base}{name} ({error}); {_INSTEAD}.") from None
        raise InputError(
            f"download failed: {base}{name} is not the known file, whose sha256 is {REGISTRY[name]}; {_INSTEAD}."
        ) from None
    except requests.exceptions.RequestException as error:
        answer = getattr(error, "response", None)
        reason = f"the server answered {answer.status_code}" if answer is not None else "no connection"
        raise InputError(f"download failed: {base}{name}: {reason}; {_INSTEAD}.") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}).") from None
    return folder


def _volume(url: str) -> str:
    """Address of the volume's folder, also if that of its DATA folder is given."""
    return re.sub("/DATA$", "", url.rstrip("/"), flags=re.IGNORECASE) + "/"


def _holds_tables(folder: Path) -> bool:
    return any(find_file(place, "2TRANSFORMED.LBL") or find_file(place, "1TRANSFORMED.LBL")
               for place in (folder / "DATA", folder))  # fmt: skip


def find_mer_imu(explicit: str | Path | None = None) -> Path:
    """Folder of the MER telemetry that is on this machine.

    The first of: `explicit` (nothing else, if given), ``$EDL_FILTER_DATA/pds/mer_imu``,
    ``$EDL_FILTER_DATA/mer_imu``, the cache that `fetch_mer_imu` fills.

    Raises
    ------
    InputError
        None of them holds the tables; the message says where was looked and what to do.
    """
    if explicit is not None:
        places = [Path(explicit)]
    else:
        data = os.environ.get("EDL_FILTER_DATA")
        places = [Path(data, "pds", "mer_imu"), Path(data, "mer_imu")] if data else []
        places.append(cache_folder() / "mer_imu")
    for place in places:
        if _holds_tables(place):
            return place
    looked = ", ".join(str(place) for place in places)
    raise InputError(
        f"the MER telemetry (volume merimu_1001, DATA/*.LBL and *.TAB) is not in {looked}; run "
        "`edl-filter fetch mer-imu`, or set EDL_FILTER_DATA to the folder that holds pds/mer_imu."
    )
