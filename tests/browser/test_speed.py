"""How quick the page is while an experiment flies at ten times real time: on a machine of its own, at the pace of the
reference machine."""

from __future__ import annotations

import statistics
import time

import pytest
from playwright.sync_api import expect

from tests.bench.measure import pace

from .lab import Lab

pytestmark = pytest.mark.alone

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


COUNT_DRAWINGS = """() => {
  const react = window.Plotly.react;
  window.drawings = 0;
  window.Plotly.react = (...figure) => { window.drawings += 1; return react(...figure); };
}"""

ROUNDS = 3
"""A figure counts if one of so many rounds reaches it: others may use the machine meanwhile."""


def slowness(seconds: float = 0.3) -> float:
    """How much longer a piece of work takes here and now than on a reference machine of its own; at least 1.

    Others take their share of the time, and this machine may be the slower one.
    """
    started, worked = time.perf_counter(), time.process_time()
    slower = pace(seconds)
    crowding = (time.perf_counter() - started) / max(1e-3, time.process_time() - worked)
    return max(1.0, crowding) * max(1.0, slower)


def test_a_click_on_inject_is_a_mark_within_300_ms(lab: Lab) -> None:
    lab.open_long_flight()
    page = lab.page
    expect(page.frame_locator("ft-scene iframe").locator("canvas").first).to_be_visible(timeout=40_000)
    page.locator("ft-bench select[name=kind]").select_option("noise")
    page.locator("ft-bench input[name=magnitude]").fill("1e-9")
    lab.run()
    measured = []
    for _ in range(ROUNDS):
        delays, slower = [], slowness()
        for _ in range(20):
            delays.append(page.evaluate(INJECT_AND_WAIT))
            page.wait_for_timeout(130)
        p95 = statistics.quantiles(delays, n=20)[-1]
        slower = 0.5 * (slower + slowness())
        print(f"inject to mark: median {statistics.median(delays):.0f} ms, p95 {p95:.0f} ms, slowness {slower:.1f}")
        measured.append(p95 / slower)
        if measured[-1] <= 300.0:
            break
    assert min(measured) <= 300.0, measured


def test_ten_live_charts_leave_half_of_the_main_thread(lab: Lab) -> None:
    lab.open_long_flight()
    page = lab.page
    shown = page.evaluate(
        """async () => {
          const { store } = await import('/static/store.js');
          const { show } = await import('/static/session.js');
          show(store.get().description.charts.slice(0, 10).map((chart) => chart.id));
          return store.get().shown.length;
        }"""
    )
    assert shown == 10
    expect(page.locator("ft-charts .chart")).to_have_count(10)
    page.evaluate(COUNT_DRAWINGS)
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def spent() -> tuple[float, float, int]:
        metrics = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
        return metrics["TaskDuration"], page.evaluate("performance.now()") / 1000.0, page.evaluate("window.drawings")

    lab.run()
    drawings, share = 0, 1.0
    for _ in range(ROUNDS):  # the first may see the scene being compiled, and no frame come
        before, start, drawn = spent()
        page.wait_for_timeout(5000)
        after, end, all_drawn = spent()
        slower = max(1.0, pace())
        drawings, busy = all_drawn - drawn, (after - before) / (end - start)
        share = busy / slower
        print(
            f"main thread busy {busy:.0%} with ten live charts at 10x, {share:.0%} at the reference pace "
            f"(pace {slower:.2f}), {drawings} drawn in {end - start:.1f} s"
        )
        live = drawings >= 20 / slower
        if live and share <= 0.5:
            break
    assert lab.experiment()["clock"]["state"] == "running"
    assert live, f"the charts were not live: {drawings} drawn"
    assert share <= 0.5


def test_the_page_is_ready_soon(lab: Lab) -> None:
    measured = []
    for _ in range(ROUNDS):
        ready = lab.page.evaluate("performance.getEntriesByName('ready')[0]?.startTime")
        slower = slowness()
        print(f"ready to run after {ready:.0f} ms, slowness {slower:.1f}")
        measured.append(ready / slower)
        if measured[-1] < 3000.0:
            break
        lab.page.reload()
        expect(lab.page.locator("ft-topbar .play")).to_be_enabled()
    assert min(measured) < 3000.0, measured
