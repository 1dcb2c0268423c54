"""At 1280 x 720 and 1024 x 768 nothing cuts the meaning, and at 390 px there is one column that can be read."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from .lab import Lab

CUT = """() => {
  const canvas = document.createElement('canvas').getContext('2d');
  const bad = [];
  const seen = (names, parts) => [...document.querySelectorAll(names.map((n) => `${n} ${parts}`).join())]
    .filter((e) => e.checkVisibility());
  for (const select of seen(['ft-topbar', 'ft-bench', 'ft-settings', 'ft-scene'], 'select')) {
    if (!select.selectedOptions.length) continue;
    const style = getComputedStyle(select);
    canvas.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    const room = select.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - 16;
    const text = select.selectedOptions[0].textContent.trim();
    if (canvas.measureText(text).width > room + 1) bad.push(['select', text, room]);
  }
  for (const text of document.querySelectorAll('ft-diagram text')) {
    if (text.textContent.includes('…')) bad.push(['block', text.textContent]);
  }
  const boxes = [...seen(['ft-score', 'ft-faults', 'ft-subsystems', 'ft-log .event'], '*'),
    ...seen(['ft-topbar'], 'button'), ...seen(['ft-scene'], 'h2')];
  for (const e of boxes) {
    const { display, overflowX } = getComputedStyle(e);
    if (['inline', 'contents'].includes(display)) continue;
    const low = overflowX !== 'visible' && e.scrollHeight > e.clientHeight + 1;
    if (e.scrollWidth > e.clientWidth + 1 || low) bad.push([e.localName, e.className, e.textContent.slice(0, 40)]);
  }
  return bad;
}"""
COVERED = """() => {
  const [toast, score] = ['.toast', 'ft-score'].map((name) => document.querySelector(name).getBoundingClientRect());
  return toast.left < score.right && score.left < toast.right && toast.top < score.bottom && score.top < toast.bottom;
}"""
TOUCHING = """() => {
  const bad = [];
  for (const axis of ['.ruler .ticks', 'ft-timeline .ticks']) {
    const boxes = [...document.querySelectorAll(`${axis} span`)].map((e) => e.getBoundingClientRect());
    boxes.forEach((box, i) => i && box.left < boxes[i - 1].right + 2 && bad.push([axis, i]));
    const { right } = document.querySelector(axis).closest('ft-charts, ft-timeline').getBoundingClientRect();
    if (boxes.at(-1).right > right) bad.push([axis, 'beyond the end']);
  }
  return bad;
}"""
REACHED = """() => ['ft-topbar .play', 'ft-score', 'ft-charts .chart', 'ft-bench .primary', 'ft-diagram svg',
  'ft-timeline .track', 'ft-log .events', 'ft-scene h2'].filter((name) => {
    const box = document.querySelector(name).getBoundingClientRect();
    const beyond = box.bottom + scrollY > document.documentElement.scrollHeight + 1;
    return box.width < 60 || box.left < -1 || box.right > innerWidth + 1 || beyond;
  })"""
FLOWN = [("zhang-1992-visible", 72.0, "C1"), ("yang-2016-scenario-1", 120.0, "BD2")]


@pytest.mark.parametrize(("scenario", "until", "channel"), FLOWN)
def test_nothing_cuts_the_meaning(lab: Lab, scenario: str, until: float, channel: str) -> None:
    made = lab.rest("POST", "/experiments", {"scenario": scenario})["id"]
    lab.rest("POST", f"/experiments/{made}/advance", {"until": until})
    lab.open(f"/?experiment={made}")
    page = lab.page
    option = page.locator("ft-bench select[name=channel] option", has_text=channel).first
    page.locator("ft-bench select[name=channel]").select_option(option.get_attribute("value"))
    expect(page.locator("ft-score dd.value").first).to_be_visible()
    for width, height in ((1440, 900), (1280, 720), (1024, 768)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(f"() => ({CUT})().length === 0 || performance.now() % 5000 > 4900")
        assert page.evaluate(CUT) == [], (width, height)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        expect(page.locator("ft-scene .legend")).to_be_in_viewport(ratio=1)
        assert page.evaluate(TOUCHING) == []
        lab.inject()
        expect(page.locator(".toast").last).to_be_visible()
        assert not page.evaluate(COVERED)
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate(REACHED) == []
    assert page.evaluate(TOUCHING) == []
    page.locator("ft-log .event").last.scroll_into_view_if_needed()
    expect(page.locator("ft-log .event").last).to_be_in_viewport()
