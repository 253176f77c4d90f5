"""Download and search of the MER telemetry, with a server on the loopback interface."""

import hashlib
import shutil
import socket
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from edl_filter.errors import InputError
from edl_filter.io.atomic import default_file_mode
from edl_filter.telemetry import fetch


class RecordingHandler(SimpleHTTPRequestHandler):
    def log_message(self, *args):
        self.server.requests.append(self.path)


@pytest.fixture
def serve():
    """Function that serves a folder on loopback and returns (address, list of requested paths)."""
    servers = []

    def start(folder):
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(RecordingHandler, directory=str(folder)))
        server.requests = []
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/volume", server.requests

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture
def volume(tmp_path, monkeypatch):
    """Small substitute for the volume; its checksums replace the real ones."""
    root = tmp_path / "www" / "volume"
    registry = {}
    for name in fetch.REGISTRY:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
        registry[name] = hashlib.sha256(name.encode()).hexdigest()
    monkeypatch.setattr(fetch, "REGISTRY", registry)
    monkeypatch.delenv("EDL_FILTER_DATA", raising=False)
    monkeypatch.setenv("EDL_FILTER_CACHE", str(tmp_path / "cache"))
    return root


def test_every_file_is_cached_and_downloaded_once(volume, serve, tmp_path):
    address, requests = serve(volume.parent)
    folder = fetch.fetch_mer_imu(address)
    assert folder == tmp_path / "cache" / "mer_imu"
    assert (folder / "DATA" / "2HIGHRATE.TAB").read_bytes() == b"DATA/2HIGHRATE.TAB"
    count = len(requests)
    assert count == 9
    assert {p.stat().st_mode & 0o777 for p in folder.rglob("*") if p.is_file()} == {default_file_mode()}
    fetch.fetch_mer_imu(address + "/", progress=True)
    assert len(requests) == count
    assert fetch.find_mer_imu(2) == folder


def test_address_of_the_data_folder_is_accepted(volume, serve):
    address, requests = serve(volume.parent)
    fetch.fetch_mer_imu(address + "/DATA/")
    assert "/volume/DATA/2HIGHRATE.TAB" in requests


def test_changed_file_raises_and_is_not_cached(volume, serve, tmp_path):
    (volume / "DATA" / "2HIGHRATE.TAB").write_bytes(b"changed")
    address, _ = serve(volume.parent)
    with pytest.raises(InputError, match=r"volume/DATA/2HIGHRATE.TAB is not the known file, whose sha256 is") as e:
        fetch.fetch_mer_imu(address)
    assert "put the volume's DATA folder under $EDL_FILTER_DATA/pds/mer_imu instead" in str(e.value)
    assert not (tmp_path / "cache" / "mer_imu" / "DATA" / "2HIGHRATE.TAB").exists()


def test_missing_file_and_unreachable_server_raise(volume, serve):
    (volume / "AAREADME.txt").unlink()
    address, _ = serve(volume.parent)
    with pytest.raises(InputError, match=r"download failed: .*/AAREADME.txt: the server answered 404; put the"):
        fetch.fetch_mer_imu(address)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(InputError, match=r"download failed: .*/AAREADME.txt: no connection; put the"):
        fetch.fetch_mer_imu(f"http://127.0.0.1:{port}/volume")


def test_only_web_addresses_are_read(volume):
    with pytest.raises(InputError, match=r"file:///etc/AAREADME\.txt: expected an address that begins with https"):
        fetch.fetch_mer_imu("file:///etc")


def test_search_order_of_the_folders(volume, tmp_path, monkeypatch):
    assert fetch.find_mer_imu(2) is None
    cache = tmp_path / "cache" / "mer_imu"
    # each has precedence over those before
    for folder in (cache, tmp_path / "data" / "mer_imu", tmp_path / "data" / "pds" / "mer_imu"):
        shutil.copytree(volume, folder)
        monkeypatch.setenv("EDL_FILTER_DATA", str(tmp_path / "data"))
        assert fetch.find_mer_imu(2) == fetch.find_mer_imu(1) == folder


def test_incomplete_download_is_skipped(volume, tmp_path):
    cache = tmp_path / "cache" / "mer_imu"
    shutil.copytree(volume, cache)
    (cache / "DATA" / "2HIGHRATE.TAB").unlink()
    assert fetch.find_mer_imu(2) is None
    assert fetch.find_mer_imu(1) == cache


def test_originals_at_hand_are_not_downloaded(volume, serve, tmp_path, monkeypatch):
    monkeypatch.setenv("EDL_FILTER_DATA", str(tmp_path / "data"))
    folder = tmp_path / "data" / "mer_imu"
    shutil.copytree(volume / "DATA", folder)  # the DATA folder under the volume's name is accepted
    assert fetch.fetch_mer_imu() == folder
    # A stated folder or address is a request for a download, and a changed file is no original
    address, requests = serve(volume.parent)
    assert fetch.fetch_mer_imu(address) == tmp_path / "cache" / "mer_imu"
    assert len(requests) == 9
    monkeypatch.setattr(fetch, "BASE_URL", address)
    (folder / "1HIGHRATE.TAB").write_bytes(b"changed")
    assert fetch.fetch_mer_imu() == tmp_path / "cache" / "mer_imu"


def test_what_is_there_is_recognised_by_its_checksums(volume, serve, tmp_path):
    address, _ = serve(volume.parent)
    sentences = []
    fetch.fetch_mer_imu(address, report=sentences.append)
    table = tmp_path / "cache" / "mer_imu" / "DATA" / "1HIGHRATE.TAB"
    table.write_bytes(b"damaged" + table.read_bytes())
    for _ in range(2):
        fetch.fetch_mer_imu(address, report=sentences.append)
    n = len(fetch.REGISTRY)
    assert sentences == [
        f"{n} of {n} files were downloaded, 0 were there.",
        f"1 of {n} files were downloaded, {n - 1} were there.",
        f"All {n} files are there, with the right checksums; nothing is downloaded.",
    ]
    # a copy of the volume is used in its place
    assert fetch.fetch_mer_imu(cache=tmp_path / "cache" / "mer_imu") == tmp_path / "cache" / "mer_imu"


def test_default_cache_is_the_systems(monkeypatch):
    monkeypatch.delenv("EDL_FILTER_CACHE", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/a cache")
    assert fetch.cache_folder() == Path("/a cache/edl-filter")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert fetch.cache_folder() == Path.home() / ".cache" / "edl-filter"


def test_real_files_have_the_registered_checksums(mer_originals, serve, tmp_path):
    assert fetch.has_original_tables(mer_originals)
    (tmp_path / "volume").symlink_to(mer_originals)
    address, _ = serve(tmp_path)
    folder = fetch.fetch_mer_imu(address, cache=tmp_path / "cache")
    assert (folder / "DATA" / "2TRANSFORMED.TAB").read_bytes() == (
        mer_originals / "DATA" / "2TRANSFORMED.TAB"
    ).read_bytes()
