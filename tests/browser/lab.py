"""A person's words for what is done with the page."""

from __future__ import annotations

import json
import urllib.request
from typing import Any

from playwright.sync_api import Page, expect

SCENE_NOISE = ("GL Driver Message", "THREE.", "Evaluating a string as JavaScript", "WebGL")
"""What the 3-D viewer says in its own frame under software rendering and a strict policy."""
SLOW_NOISE = ("was preloaded using link preload but not used within a few seconds",)
"""Chromium, where a page's first modules take seconds to run. What is preloaded is used: it draws the charts."""


class Lab:
    """The page, and what a person does with it."""

    def __init__(self, page: Page, base: str) -> None:
        self.page = page
        self.base = base
        self.trouble: list[str] = []
        self.refusals_expected = False
        page.on("console", lambda m: self._note(f"{m.type}: {m.text}") if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: self._note(str(error)))

    def _note(self, text: str) -> None:
        refused = self.refusals_expected and text.startswith("error: Failed to load resource: the server responded")
        if not refused and not any(noise in text for noise in SCENE_NOISE + SLOW_NOISE):
            self.trouble.append(text)

    def open_long_flight(self) -> None:
        """Half an hour with no fault in it, on the first scenario's system."""
        scenario = self.rest("GET", "/scenarios/zhang-1992-visible")
        long = {**scenario, "id": "long", "title": "Half an hour", "duration": 1800.0, "faults": []}
        experiment = self.rest("POST", "/experiments", {"scenario": long})["id"]
        self.rest("PATCH", f"/experiments/{experiment}/clock", {"speed": 10})
        self.open(f"/?experiment={experiment}")

    def open(self, address: str = "/") -> None:
        self.page.goto(address if address.startswith("http") else self.base + address)
        expect(self.page.locator("ft-topbar .play")).to_be_enabled()

    def without_scene(self) -> None:
        """For tests that are about something else: the scene is folded and costs nothing."""
        self.page.get_by_role("button", name="hide", exact=True).click()

    def rest(self, method: str, path: str, body: object = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            f"{self.base}/api/v1{path}", data, {"content-type": "application/json"}, method=method
        )
        with urllib.request.urlopen(request, timeout=300) as answer:
            return json.loads(answer.read() or b"null")

    @property
    def id(self) -> str:
        return str(self.page.evaluate("new URL(location.href).searchParams.get('experiment')"))

    def experiment(self) -> Any:
        return self.rest("GET", f"/experiments/{self.id}")

    def fly_until(self, time: float) -> None:
        """Fast, and the page is told."""
        self.rest("POST", f"/experiments/{self.id}/advance", {"until": time})
        self.page.wait_for_function(
            "(t) => Number(document.querySelector('ft-timeline .head').ariaValueNow) >= t - 1e-6", arg=time
        )

    def run(self) -> None:
        self.page.locator("ft-topbar .play", has_text="Run").click()
        expect(self.page.locator("ft-topbar .play")).to_have_text("Pause")

    def pause(self) -> None:
        self.page.locator("ft-topbar .play", has_text="Pause").click()
        expect(self.page.locator("ft-topbar .play")).to_have_text("Run")

    @property
    def now(self) -> float:
        return float(self.experiment()["clock"]["time"])

    def look_at_start(self) -> None:
        self.page.locator("ft-timeline .head").focus()
        self.page.keyboard.press("Home")

    def inject(self, magnitude: str | None = None) -> None:
        form = self.page.locator("ft-bench form")
        if magnitude is not None:
            form.get_by_label("Magnitude").fill(magnitude)
        form.get_by_role("button", name="Inject", exact=True).click()

    def marks(self, kind: str) -> Any:
        return self.page.locator(f"ft-charts .marks .mark.{kind}")
