"""Only requests of the served page are accepted, and only for paths in the folder."""

import pytest
from starlette.testclient import TestClient

from edl_filter.serve.app import make_app
from edl_filter.serve.safety import ForbiddenError, inside

ORIGIN = "http://127.0.0.1:8765"


@pytest.fixture
def client(tmp_path):
    """A client that sends no Origin."""
    return TestClient(make_app(tmp_path, 8765), base_url=ORIGIN)


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "127.0.0.1", "127.0.0.1:80", "127.0.0.1.evil:8765"]
)
@pytest.mark.parametrize("path", ["/", "/plotly.js", "/api/library"])
def test_a_foreign_host_is_refused(client, host, path):
    response = client.get(path, headers={"Host": host})
    assert response.status_code == 403
    assert f"found Host {host}; expected 127.0.0.1:8765 or localhost:8765" in response.json()["error"]


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:8765", "http://127.0.0.1:9", "http://localhost:8765"]
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_foreign_origin_is_refused(client, origin, method):
    response = client.request(method, "/api/job" if method == "GET" else "/api/cancel", headers={"Origin": origin})
    assert response.status_code == 403
    assert f"found Origin {origin}" in response.json()["error"]


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_requests_of_other_sites_are_refused(client, site):
    assert client.get("/workbench.js", headers={"Sec-Fetch-Site": site}).status_code == 403


def test_the_page_itself_may_read(client):
    for headers in ({}, {"Sec-Fetch-Site": "none"}, {"Origin": ORIGIN, "Sec-Fetch-Site": "same-origin"}):
        response = client.get("/api/library", headers=headers)
        assert response.status_code == 200, headers
    assert client.get("/", headers={"Host": "localhost:8765"}).status_code == 200


def test_a_post_needs_an_origin_and_json(client):
    response = client.post("/api/cancel", json={})
    assert (response.status_code, "found no Origin" in response.json()["error"]) == (403, True)
    form = client.post("/api/cancel", content="{}", headers={"Origin": ORIGIN, "Content-Type": "text/plain"})
    assert (form.status_code, "found Content-Type text/plain" in form.json()["error"]) == (403, True)
    assert client.post("/api/cancel", json={}, headers={"Origin": ORIGIN}).status_code == 200


def test_the_page_may_load_from_its_server_only(client):
    policy = client.get("/").headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "http" not in policy


@pytest.mark.parametrize("path", ["..", "../x", "a/../../x", "/etc/passwd", "", "a\\..\\x", "a\0b"])
def test_paths_out_of_the_folder_are_refused(tmp_path, path):
    with pytest.raises(ForbiddenError, match="expected one inside the served folder"):
        inside(tmp_path.resolve(), path)


def test_symlinks(tmp_path):
    root, outside = (tmp_path / "in").resolve(), tmp_path / "out"
    (root / "own").mkdir(parents=True)
    outside.mkdir()
    (root / "out").symlink_to(outside)
    (root / "near").symlink_to(root / "own")
    (root / "loop").symlink_to(root / "loop")
    assert inside(root, "near/new.yaml") == root / "near/new.yaml"
    for path in ("out", "out/new.yaml"):
        with pytest.raises(ForbiddenError, match="leads out of the served folder"):
            inside(root, path)
    assert inside(root, "own") == root / "own"
