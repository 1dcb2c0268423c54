"""In Chromium: the API's page and a report are drawn, and reach for no other server."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from rest_lab import Flight, Served, served

pytestmark = pytest.mark.browser
playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking"]


@pytest.fixture(scope="module")
def server() -> Iterator[Served]:
    with served() as server:
        yield server


@pytest.fixture
def page() -> Iterator[Any]:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 600, "height": 450})
        page.foreign = []
        page.on(
            "request",
            lambda r: (
                None if "//127.0.0.1:" in r.url or r.url[:5] in ("blob:", "data:") else page.foreign.append(r.url)
            ),
        )
        page.wrong = []
        page.on("console", lambda m: page.wrong.append(m.text) if m.type == "error" else None)
        yield page
        browser.close()


@pytest.mark.parametrize("what", ["/docs", "report"])
def test_pages_made_of_data_are_drawn_without_a_word_of_complaint(server: Served, page: Any, what: str) -> None:
    with httpx.Client(base_url=server.base, timeout=120.0) as client:
        flight = Flight(client)
        flight.advance(epochs=50)
        page.goto(server.base + (what if what == "/docs" else f"{flight.path}/report"))
        page.wait_for_selector("#injectFault" if what == "/docs" else "#charts .js-plotly-plot", timeout=120_000)
    assert page.foreign == []
    assert page.wrong == []
