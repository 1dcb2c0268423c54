"""Files for browsers."""

from __future__ import annotations

import gzip

import pytest
from fastapi.testclient import TestClient
from rest_lab import API

from server.pages import plotly


def test_the_page_and_its_modules_are_served(client: TestClient) -> None:
    page = client.get("/")
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert client.get("/static/index.html").content == page.content
    assert client.get("/static/api.js").headers["content-type"] == "text/javascript; charset=utf-8"
    assert client.get("/", headers={"if-none-match": page.headers["etag"]}).status_code == 304


@pytest.mark.parametrize(
    "name",
    ["../pyproject.toml", "..%2fpyproject.toml", "%2e%2e/pyproject.toml", "panels", "", "none.js", "/etc/passwd"],
)
def test_nothing_beside_the_page_is_served(client: TestClient, name: str) -> None:
    assert client.get(f"/static/{name}").status_code == 404


def test_plotly_comes_from_its_package_compressed_and_stays(client: TestClient) -> None:
    answer = client.get("/vendor/plotly.min.js?v=1", headers={"accept-encoding": "gzip"})
    assert answer.headers["content-encoding"] == "gzip"
    assert int(answer.headers["content-length"]) < 2_000_000
    assert "immutable" in answer.headers["cache-control"]
    file = plotly()
    assert file.compressed is not None
    assert gzip.decompress(file.compressed) == file.content == answer.content
    assert client.get("/vendor/plotly.min.js", headers={"if-none-match": answer.headers["etag"]}).status_code == 304


def test_the_api_page_loads_nothing_from_elsewhere(client: TestClient) -> None:
    for path in ("/docs", "/docs/docs.js", "/docs/docs.css"):
        answer = client.get(path)
        assert answer.status_code == 200
        assert "http://" not in answer.text
        assert "https://" not in answer.text
    assert client.get("/docs/login.html").status_code == 404


def test_large_answers_are_compressed(client: TestClient) -> None:
    answer = client.get(f"{API}/systems", headers={"accept-encoding": "gzip"})
    assert answer.headers["content-encoding"] == "gzip"


def test_without_a_token_there_is_nothing_to_log_in_to(client: TestClient) -> None:
    assert client.get("/login", follow_redirects=False).headers["location"] == "/"


def test_the_version_is_told(client: TestClient) -> None:
    assert set(client.get(f"{API}/version").json()) == {"ftlab", "python", "numpy"}
