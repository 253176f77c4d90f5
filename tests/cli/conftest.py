"""Commands in an empty folder."""

import pytest
from typer.testing import CliRunner

from edl_filter.cli import app


@pytest.fixture
def cli(tmp_path, monkeypatch):
    """Function that runs a command in an empty folder, without access to real data."""
    monkeypatch.delenv("EDL_FILTER_DATA", raising=False)
    monkeypatch.setenv("EDL_FILTER_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return lambda *args: CliRunner().invoke(app, [str(a) for a in args])
