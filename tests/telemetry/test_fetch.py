import hashlib
import socket
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

from edl_filter.errors import InputError
from edl_filter.telemetry import fetch
from edl_filter.whole_file import usual_mode


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *args):
        self.server.asked.append(self.path)


@pytest.fixture
def serve():
    """Function that serves a folder on loopback and gives (address, list of requests)."""
    servers = []

    def start(folder):
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
        server.asked = []
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/volume", server.asked

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture
def volume(tmp_path, monkeypatch):
    """Small stand-in for the volume, with its checksums in place of the real ones."""
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


def test_every_file_lands_in_the_cache_and_is_not_fetched_again(volume, serve, tmp_path):
    address, asked = serve(volume.parent)
    folder = fetch.fetch_mer_imu(address)
    assert folder == tmp_path / "cache" / "mer_imu"
    assert (folder / "DATA" / "2HIGHRATE.TAB").read_bytes() == b"DATA/2HIGHRATE.TAB"
    count = len(asked)
    assert count == 9
    assert {p.stat().st_mode & 0o777 for p in folder.rglob("*") if p.is_file()} == {usual_mode()}
    fetch.fetch_mer_imu(address + "/", progress=True)
    assert len(asked) == count
    assert fetch.find_mer_imu() == folder


def test_the_address_of_the_data_folder_will_do(volume, serve):
    address, asked = serve(volume.parent)
    fetch.fetch_mer_imu(address + "/DATA/")
    assert "/volume/DATA/2HIGHRATE.TAB" in asked


def test_a_changed_file_is_refused_and_not_kept(volume, serve, tmp_path):
    (volume / "DATA" / "2HIGHRATE.TAB").write_bytes(b"changed")
    address, _ = serve(volume.parent)
    with pytest.raises(InputError, match=r"volume/DATA/2HIGHRATE.TAB is not the known file, whose sha256 is") as e:
        fetch.fetch_mer_imu(address)
    assert "put the volume's DATA folder under $EDL_FILTER_DATA/pds/mer_imu instead" in str(e.value)
    assert not (tmp_path / "cache" / "mer_imu" / "DATA" / "2HIGHRATE.TAB").exists()


def test_a_missing_file_and_a_dead_server(volume, serve):
    (volume / "AAREADME.txt").unlink()
    address, _ = serve(volume.parent)
    with pytest.raises(InputError, match=r"download failed: .*/AAREADME.txt: the server answered 404; put the"):
        fetch.fetch_mer_imu(address)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(InputError, match=r"download failed: .*/AAREADME.txt: no connection; put the"):
        fetch.fetch_mer_imu(f"http://127.0.0.1:{port}/volume")


def test_where_the_data_are_looked_for(volume, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"is not in .*cache/mer_imu; run `edl-filter fetch mer-imu`, or set EDL"):
        fetch.find_mer_imu()
    for parts in (("mer_imu",), ("pds", "mer_imu")):  # the second is preferred once it is there
        place = tmp_path.joinpath("data", *parts)
        (place / "DATA").mkdir(parents=True)
        (place / "DATA" / "1TRANSFORMED.LBL").touch()
        monkeypatch.setenv("EDL_FILTER_DATA", str(tmp_path / "data"))
        assert fetch.find_mer_imu() == place
    assert fetch.find_mer_imu(volume) == volume
    assert fetch.find_mer_imu(volume / "DATA") == volume / "DATA"
    # a folder that is named is the only one looked at
    with pytest.raises(InputError, match=r"is not in .*elsewhere; run"):
        fetch.find_mer_imu(tmp_path / "elsewhere")


def test_the_cache_without_the_variable_is_the_systems(monkeypatch):
    monkeypatch.delenv("EDL_FILTER_CACHE", raising=False)
    assert "edl-filter" in str(fetch.cache_folder())


def test_the_real_files_have_the_known_checksums(mer_folder, serve, tmp_path):
    (tmp_path / "volume").symlink_to(mer_folder)
    address, _ = serve(tmp_path)
    folder = fetch.fetch_mer_imu(address, cache=tmp_path / "cache")
    assert (folder / "DATA" / "2TRANSFORMED.TAB").read_bytes() == (
        mer_folder / "DATA" / "2TRANSFORMED.TAB"
    ).read_bytes()
