"""The 3-D scene in its frame: drawn, and without the viewer's own panels."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from .lab import Lab

pytestmark = pytest.mark.scene

OVERLAPPING = """(selector) => {
  const all = [...document.querySelectorAll(selector)].map((e) => [e.textContent, e.getBoundingClientRect()]);
  const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
  return all.flatMap(([one, a], i) => all.slice(i + 1).filter(([, b]) => meet(a, b)).map(([two]) => [one, two]));
}"""


def test_the_scene_is_drawn_and_the_viewers_panel_is_hidden(lab: Lab) -> None:
    frame = lab.page.frame_locator("ft-scene iframe")
    expect(frame.locator("canvas").first).to_be_visible(timeout=120_000)
    for panel in ("[data-floating-window]", "#root .mantine-Paper-root", "#webgl-software-rendering"):
        for found in frame.locator(panel).all():
            expect(found).to_be_hidden()
    names = lab.page.locator("ft-scene .name")
    expect(names.first).to_be_visible()
    assert lab.page.evaluate(OVERLAPPING, "ft-scene .name") == []
    legend = lab.page.locator("ft-scene .legend")
    lab.fly_until(2.0)
    expect(legend).to_contain_text("satellites")
    expect(legend).not_to_contain_text("faulted")
    lab.page.get_by_label("Names in the scene").select_option("none")
    expect(names).to_have_count(0)


def test_the_scene_follows_the_theme(lab: Lab) -> None:
    frame = lab.page.locator("ft-scene iframe")
    expect(frame).to_have_attribute("src", f"/experiments/{lab.id}/scene/?darkMode")
    lab.page.locator("ft-topbar").get_by_role("button", name="Theme").click()
    expect(frame).to_have_attribute("src", f"/experiments/{lab.id}/scene/")


@pytest.mark.long
def test_a_scene_that_cannot_be_had_is_explained(lab: Lab) -> None:
    lab.refusals_expected = True
    lab.page.route("**/scene/**", lambda route: route.fulfill(status=503, content_type="application/json", body="{}"))
    lab.page.reload()
    expect(lab.page.locator("ft-scene .status")).to_contain_text("Scene unavailable")
