"""How quick the page is while an experiment flies at ten times real time, in a real Chromium.

Milliseconds of the wall: run it on a machine that does nothing else.
"""

from __future__ import annotations

from statistics import median
from typing import Any

from playwright.sync_api import Page, expect, sync_playwright

from tests.bench.measure import Figure, percentile
from tests.bench.server import served
from tests.browser.conftest import ARGUMENTS, CHROMIUM
from tests.browser.lab import Lab

INJECT_AND_WAIT = """() => new Promise((done) => {
  const marks = document.querySelector('ft-charts .marks');
  const before = marks.querySelectorAll('.mark.injected').length;
  const started = performance.now();
  const watch = new MutationObserver(() => {
    if (marks.querySelectorAll('.mark.injected').length <= before) return;
    watch.disconnect();
    done(performance.now() - started);
  });
  watch.observe(marks, { childList: true });
  document.querySelector('ft-bench button.primary').click();
})"""
SHOW_TEN = """async () => {
  const { store } = await import('/static/store.js');
  const { show } = await import('/static/session.js');
  show(store.get().description.charts.slice(0, 10).map((chart) => chart.id));
}"""
CLICKS, WATCHED = 30, 6000


def click_to_mark(lab: Lab) -> list[float]:
    """Delays [ms] from a click on Inject to the mark in the charts."""
    lab.open_long_flight()
    page = lab.page
    expect(page.frame_locator("ft-scene iframe").locator("canvas").first).to_be_visible(timeout=60_000)
    page.locator("ft-bench select[name=kind]").select_option("noise")
    page.locator("ft-bench input[name=magnitude]").fill("1e-3")
    lab.run()
    delays = []
    for _ in range(CLICKS):
        delays.append(float(page.evaluate(INJECT_AND_WAIT)))
        page.wait_for_timeout(700)
    return delays


def busy_with_ten_charts(lab: Lab) -> float:
    """Share of the main thread that ten live charts take."""
    lab.open_long_flight()
    page = lab.page
    page.evaluate(SHOW_TEN)
    expect(page.locator("ft-charts .chart")).to_have_count(10)
    session: Any = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    lab.run()
    page.wait_for_timeout(3000)  # the scene is compiled meanwhile
    before, start = spent(session, page)
    page.wait_for_timeout(WATCHED)
    after, end = spent(session, page)
    return (after - before) / (end - start)


def spent(session: Any, page: Page) -> tuple[float, float]:
    """Processor seconds of the main thread, and the page's own clock [s]."""
    metrics = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
    return metrics["TaskDuration"], page.evaluate("performance.now()") / 1000.0


def figures() -> list[Figure]:
    """Click to mark, share of the main thread, page ready; nothing where there is no Chromium."""
    if CHROMIUM is None:
        return []
    with served() as base, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        lab = Lab(browser.new_page(viewport={"width": 1440, "height": 900}), base)
        lab.open()
        ready = lab.page.evaluate("performance.getEntriesByName('ready')[0]?.startTime")
        delays, busy = click_to_mark(lab), busy_with_ten_charts(lab)
        browser.close()
    return [
        Figure(
            "page",
            "click on Inject to the mark at 10x, 95th percentile",
            percentile(delays, 0.95),
            "ms",
            300.0,
            "most",
            f"median {median(delays):.0f} ms, wall",
        ),
        Figure("page", "share of the main thread, ten live charts at 10x", 100.0 * busy, "%", 50.0, "most"),
        Figure("page", "ready to run after", ready, "ms", 3000.0, "most", "wall"),
    ]
