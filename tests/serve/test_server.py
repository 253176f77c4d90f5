"""Port, optional packages and folder of the server."""

import importlib.util

import pytest
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.errors import InputError
from edl_filter.serve.server import check_extra, listen


def test_listens_on_loopback_and_on_a_free_port():
    with listen(0) as listener:
        host, port = listener.getsockname()
        assert host == "127.0.0.1"
        assert port > 0
        with pytest.raises(
            InputError, match=rf"--port {port}: cannot be listened at \(it is taken\); name another, or 0"
        ):
            listen(port)


def test_a_missing_package_is_reported_with_its_extra(monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "uvicorn" else find_spec(name))
    with pytest.raises(InputError, match=r"found no uvicorn; it comes with pip install 'edl-filter\[serve\]'"):
        check_extra()


def test_a_missing_folder_is_refused(tmp_path):
    result = CliRunner().invoke(app, ["serve", str(tmp_path / "none"), "--no-browser"])
    assert result.exit_code == 2
    assert "none: found no such folder" in result.stderr
