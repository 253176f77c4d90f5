"""The plotting library of the pages: one file that the reports of a folder share, or a part of the page.

A browser that opens ``report.html`` loads ``plotly.min.js`` from the page's folder or from the folder above, so that
the results of one study need it once; no network is needed. `with_bundle` puts it into the page itself, which is then
one file.
"""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

from edl_filter.io.atomic import replace_with
from edl_filter.results.files import BUNDLE

#: Element of the page that loads the library.
_ELEMENT = '<script id="plotly"></script>'


def bundle_path() -> Path:
    """Path of the library in the installed plotly package, which is not imported."""
    spec = find_spec("plotly")
    assert spec is not None and spec.submodule_search_locations
    return Path(spec.submodule_search_locations[0]) / "package_data" / BUNDLE


def script_path() -> Path:
    """Path of the script that draws the figures of the report and of the workbench."""
    return Path(__file__).parent / "templates" / "figures.js"


def write_bundle(folder: Path) -> Path:
    """Write the library into a folder unless it or the folder above has it; returns its path."""
    source = bundle_path()
    return bundle_at_hand(folder) or replace_with(folder / BUNDLE, lambda temporary: shutil.copyfile(source, temporary))


def bundle_at_hand(folder: Path) -> Path | None:
    """The library of this version in a folder or the folder above; None if neither has it."""
    size = bundle_path().stat().st_size
    paths = (folder / BUNDLE, folder.absolute().parent / BUNDLE)
    return next((path for path in paths if path.is_file() and path.stat().st_size == size), None)


def with_bundle(page: str) -> str:
    """The page as one file, with the library in it."""
    return page.replace(_ELEMENT, f'<script id="plotly">{bundle_path().read_text(encoding="utf-8")}</script>', 1)
