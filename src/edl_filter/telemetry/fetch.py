"""Public MER telemetry: download with checksums (`fetch_mer_imu`), search on this machine (`find_mer_imu`)."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from edl_filter._version import __version__
from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.telemetry.pds3 import find_in_volume

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
#: Longest time without an answer of the server, s.
_TIMEOUT = 60.0
_ALTERNATIVE = "put the volume's DATA folder under $EDL_FILTER_DATA/pds/mer_imu instead"


def cache_folder(cache: str | Path | None = None) -> Path:
    """Folder of downloads: `cache`, else ``$EDL_FILTER_CACHE``, else the system's cache folder of ``edl-filter``."""
    if cache is not None:
        return Path(cache)
    if folder := os.environ.get("EDL_FILTER_CACHE"):
        return Path(folder)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "edl-filter" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "edl-filter"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "edl-filter"


def fetch_mer_imu(
    base_url: str | None = None,
    cache: str | Path | None = None,
    progress: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> Path:
    """Locate or download Spirit's and Opportunity's IMU telemetry, volume merimu_1001 (about 5 MB).

    Nothing is downloaded where neither `base_url` nor `cache` is stated and ``$EDL_FILTER_DATA`` has the original
    tables, or where the folder `cache` itself is a copy of the volume. A file in the cache is downloaded again only if
    its checksum is wrong.

    Parameters
    ----------
    base_url : str, optional
        Address of a copy of the volume, or of its DATA folder; by default the PDS Atmospheres node.
    cache : path, optional
        Folder of downloads; see `cache_folder`.
    progress : bool
        Show a progress bar on standard error if that is a terminal.
    report : callable
        Called with a sentence on what is there already and what was downloaded.

    Returns
    -------
    Path
        Folder with ``DATA/*.LBL`` and ``DATA/*.TAB``: that of the original tables, or ``<cache>/mer_imu``.

    Raises
    ------
    InputError
        No answer from the server, or a file with another sha256 than that of `REGISTRY`.
    """
    at_hand = _data_folders() if cache is None else [Path(cache)]
    for folder in at_hand if base_url is None else []:
        if has_original_tables(folder):
            report("All tables are there, with the right checksums; nothing is downloaded.")
            return folder
    from rich.console import Console
    from rich.progress import track

    folder, base = cache_folder(cache) / "mer_imu", _volume_url(base_url or BASE_URL)
    present = [name for name in REGISTRY if _has_checksum(folder / name, REGISTRY[name])]
    console = Console(stderr=True)
    hidden = not (progress and console.is_terminal)
    for name in track(list(REGISTRY), "MER telemetry", console=console, disable=hidden, transient=True):
        if name not in present:
            content = _downloaded(base + name)
            if hashlib.sha256(content).hexdigest() != REGISTRY[name]:
                raise InputError(
                    f"download failed: {base}{name} is not the known file, whose sha256 is {REGISTRY[name]}; "
                    f"{_ALTERNATIVE}."
                )
            replace_with(folder / name, partial(Path.write_bytes, data=content))
    if len(present) == len(REGISTRY):
        report(f"All {len(REGISTRY)} files are there, with the right checksums; nothing is downloaded.")
    else:
        report(f"{len(REGISTRY) - len(present)} of {len(REGISTRY)} files were downloaded, {len(present)} were there.")
    return folder


def _downloaded(address: str) -> bytes:
    """Content of a file of a web server."""
    from http.client import HTTPException
    from urllib.error import HTTPError
    from urllib.request import Request, urlopen

    if not address.startswith(("https://", "http://")):
        raise InputError(f"download failed: {address}: expected an address that begins with https:// or http://.")
    try:
        with urlopen(Request(address, headers={"User-Agent": f"edl-filter/{__version__}"}), timeout=_TIMEOUT) as answer:
            return bytes(answer.read())
    except HTTPError as error:
        reason = f"the server answered {error.code}"
    except (OSError, HTTPException, ValueError):  # also an address that is none, and an answer that ends early
        reason = "no connection"
    raise InputError(f"download failed: {address}: {reason}; {_ALTERNATIVE}.")


def _has_checksum(path: Path, sha256: str) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == sha256


def _volume_url(url: str) -> str:
    """Address of the volume's folder, from that address or that of its DATA folder."""
    return re.sub("/DATA$", "", url.rstrip("/"), flags=re.IGNORECASE) + "/"


def has_original_tables(folder: Path) -> bool:
    """Whether a folder has all tables and labels of the volume, with the checksums of `REGISTRY`."""
    for name, sha256 in REGISTRY.items():
        if name.startswith("DATA/"):
            path = find_in_volume(folder, Path(name).name)
            if path is None or not _has_checksum(path, sha256):
                return False
    return True


def _data_folders() -> list[Path]:
    """Folders below ``$EDL_FILTER_DATA`` that may have the volume."""
    data = os.environ.get("EDL_FILTER_DATA")
    return [Path(data, "pds", "mer_imu"), Path(data, "mer_imu")] if data else []


def find_mer_imu(spacecraft: int) -> Path | None:
    """Locate the volume's tables of one rover on this machine.

    The folders are searched in this order: ``$EDL_FILTER_DATA/pds/mer_imu``, ``$EDL_FILTER_DATA/mer_imu``, the cache of
    `fetch_mer_imu`. A folder without all four files of the rover (an interrupted download) is skipped.

    Parameters
    ----------
    spacecraft : {1, 2}
        1 is MER-B Opportunity, 2 is MER-A Spirit.

    Returns
    -------
    Path or None
        The volume's folder or its DATA folder; None if there is none.
    """
    names = [Path(name).name for name in REGISTRY if name.startswith(f"DATA/{spacecraft}")]
    for folder in (*_data_folders(), cache_folder() / "mer_imu"):
        if all(find_in_volume(folder, name) for name in names):
            return folder
    return None
