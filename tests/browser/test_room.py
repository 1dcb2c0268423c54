"""A server keeps few experiments: a page takes over what is untouched, leaves none behind, and says when it is full."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from .lab import Lab

OTHER = "raim-too-few"
CAP = 32


def _all(lab: Lab) -> dict[str, Any]:
    return {one["id"]: one for one in lab.rest("GET", "/experiments")}


def _leave(lab: Lab) -> None:
    """Go away, and wait until the server knows it."""
    before = lab.id
    lab.page.goto("about:blank")
    for _ in range(100):
        if _all(lab)[before]["watchers"] == 0:
            return
        lab.page.wait_for_timeout(50)
    raise AssertionError("the stream is still open")


def test_what_nobody_has_touched_is_taken_over(lab: Lab) -> None:
    first = lab.id
    _leave(lab)
    lab.open()
    assert lab.id == first
    lab.fly_until(5.0)
    _leave(lab)
    lab.open()
    assert lab.id != first
    assert lab.now == 0.0


def test_two_pages_do_not_share_unasked_but_may_when_asked(lab: Lab, context: BrowserContext, base: str) -> None:
    second = Lab(context.new_page(), base)
    second.open()
    assert second.id != lab.id
    second.open(f"/?experiment={lab.id}")
    assert second.id == lab.id
    lab.fly_until(5.0)
    expect(second.page.locator("ft-topbar .time")).to_have_text("0:05.0")
    second.page.close()


def test_an_experiment_left_untouched_is_deleted_and_one_that_flew_is_kept(lab: Lab) -> None:
    untouched = lab.id
    picker = lab.page.get_by_label("Scenario")
    picker.select_option(OTHER)
    expect(lab.page).not_to_have_url(re.compile(untouched))
    flown = lab.id
    lab.page.wait_for_function(
        "(id) => fetch('/api/v1/experiments').then(a => a.json()).then(all => all.every(one => one.id !== id))",
        arg=untouched,
    )
    lab.fly_until(5.0)
    picker.select_option("zhang-1992-visible")
    expect(lab.page).not_to_have_url(re.compile(flown))
    lab.page.wait_for_timeout(2500)
    assert set(_all(lab)) == {flown, lab.id}


ANSWERED = """async () => {
  const { answered, read } = await import('/static/api.js');
  const { fetch } = window;
  const waiting = [];
  window.fetch = () => new Promise((answer) => waiting.push(() => answer(new Response('{}'))));
  const said = [];
  void read.score('one');
  void read.experiment('ones');
  const done = answered('one').then(() => said.push('answered'));
  await new Promise((later) => setTimeout(later));
  void read.events('one');
  waiting[0]();
  await new Promise((later) => setTimeout(later));
  said.push('one more');
  waiting[2]();
  await done;
  window.fetch = fetch;
  return said;
}"""


def test_what_was_asked_of_an_experiment_is_answered_before_it_is_deleted(plain: Page) -> None:
    assert plain.evaluate(ANSWERED) == ["one more", "answered"]


@pytest.mark.long
def test_a_full_server_is_a_list_to_choose_from(lab: Lab) -> None:
    lab.refusals_expected = True
    lab.fly_until(5.0)
    lab.page.goto("about:blank")
    while len(_all(lab)) < CAP:
        made = lab.rest("POST", "/experiments", {"scenario": OTHER})["id"]
        lab.rest("POST", f"/experiments/{made}/advance", {"epochs": 1})
    lab.page.set_viewport_size({"width": 1024, "height": 720})
    lab.page.goto(lab.base)
    panel = lab.page.get_by_role("region", name="No room on the server")
    expect(panel.locator("tbody tr")).to_have_count(CAP)
    expect(panel).to_contain_text("delete one")
    assert panel.evaluate("e => e.scrollWidth <= e.clientWidth && e.getBoundingClientRect().height > 200")
    panel.get_by_role("button", name=re.compile("^Delete")).first.click()
    lab.page.get_by_role("dialog", name="Are you sure?").get_by_role("button", name="Delete it").click()
    expect(panel).to_be_hidden()
    expect(lab.page.locator("ft-topbar .play")).to_be_enabled()
    assert lab.experiment()["scenario"]["id"] == "zhang-1992-visible"
