"""A real server, a real Chromium, and a person's words for what is done with them."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from .lab import Lab

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking"]
SCENE = re.compile(r"/experiments/[^/]+/scene/(\?.*)?$")
NO_SCENE = "<!doctype html><title>no scene</title><div id='root'></div>"
expect.set_options(timeout=60_000)
"""For what never comes, not for what comes late: no test says how fast a machine is."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="package")
def base() -> Iterator[str]:
    """Address of a server of this test run."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-c", "from server.cli import main; main()", "serve", "--port", str(port)]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("FTLAB_")}
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    address = f"http://127.0.0.1:{port}"
    try:
        _wait_until_it_answers(address, process)
        yield address
    finally:
        process.terminate()
        process.wait(timeout=120)


def _wait_until_it_answers(address: str, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 300.0
    while time.monotonic() < deadline:
        if process.poll() is not None:
            assert process.stderr is not None
            pytest.fail(f"the server ended before it answered:\n{process.stderr.read()}")
        try:
            urllib.request.urlopen(f"{address}/api/v1/health", timeout=1).close()
            return
        except OSError:
            time.sleep(0.1)
    pytest.fail("the server did not answer within five minutes")


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """One Chromium for all tests of the page, and closed with the last of them: while it is open, Playwright keeps an
    event loop running in this thread, and tests elsewhere want to run their own."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine: none of chromium, chromium-browser, google-chrome is on the PATH")
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    """A fresh profile."""
    fresh = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="dark", accept_downloads=True)
    fresh.set_default_timeout(120_000)
    yield fresh
    fresh.close()


@pytest.fixture(scope="package")
def plain(browser: Browser, base: str) -> Iterator[Page]:
    """A page of this origin on which nothing runs: for what modules work out by themselves."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{base}/static/icon.svg")
    yield page
    context.close()


@pytest.fixture
def lab(context: BrowserContext, base: str, request: pytest.FixtureRequest) -> Iterator[Lab]:
    """The page as it opens for the first time; afterwards its experiments are deleted and its console must be clean.

    Tests marked `scene` have the 3-D scene. The others have an empty frame in its place: drawn in software, it takes
    most of the time of a test that is about something else.
    """
    if request.node.get_closest_marker("scene") is None:
        context.route(SCENE, lambda route: route.fulfill(content_type="text/html", body=NO_SCENE))
    opened = Lab(context.new_page(), base)
    opened.open()
    yield opened
    assert opened.trouble == []
    opened.page.goto("about:blank")
    for experiment in opened.rest("GET", "/experiments"):
        opened.rest("DELETE", f"/experiments/{experiment['id']}")
