"""What a person does twice, leaves empty, types as a time, closes, shares or deletes."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from .lab import Lab

FORM = "ft-bench form"


def complaint(lab: Lab, name: str) -> Any:
    field = lab.page.locator(f"{FORM} [name={name}]")
    return lab.page.locator(f"#{field.get_attribute('aria-describedby')}")


def test_a_fault_is_injected_once_and_what_is_missing_is_said_at_its_field(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(10.0)
    before = len(lab.experiment()["faults"])
    inject = lab.page.locator(FORM).get_by_role("button", name="Inject", exact=True)

    inject.dblclick()
    expect(lab.page.locator(".toast").last).to_contain_text("injected")
    assert len(lab.experiment()["faults"]) == before + 1

    for magnitude, start, name, words in (
        ("", "", "magnitude", "A magnitude is needed: how large the fault is, in °/h."),
        ("much", "", "magnitude", "A number is needed, not “much”."),
        ("5", "soon", "start", "A time is needed: seconds (150) or minutes and seconds (2:30), not “soon”."),
        ("5", "1:75", "start", "not “1:75”"),
    ):
        lab.page.locator(f"{FORM} [name=magnitude]").fill(magnitude)
        lab.page.locator(f"{FORM} [name=start]").fill(start)
        inject.click()
        expect(complaint(lab, name)).to_contain_text(words)
    assert len(lab.experiment()["faults"]) == before + 1


def test_a_time_is_typed_as_it_is_shown_and_a_rule_on_two_fields_is_told_at_one(lab: Lab) -> None:
    lab.refusals_expected = True
    lab.without_scene()
    form = lab.page.locator(FORM)
    start, end = form.locator("[name=start]"), form.locator("[name=end]")
    start.fill("1:20")
    end.fill("70")
    form.get_by_role("button", name="Inject", exact=True).click()
    expect(complaint(lab, "end")).to_contain_text("End is 70")
    end.fill("0:01:30.5")
    form.get_by_role("button", name="Inject", exact=True).click()
    expect(lab.page.locator(".toast").last).to_contain_text("armed for 1:20.0")
    made = lab.experiment()["faults"][-1]
    assert (made["start"], made["end"]) == (80.0, 90.5)

    lab.page.get_by_role("button", name="Parameters …").click()
    dialog = lab.page.get_by_role("dialog", name="Parameters")
    expect(dialog.get_by_label("Seed", exact=True)).to_be_focused()
    assert dialog.locator(".sheet").evaluate("e => e.scrollTop") == 0
    dialog.get_by_label("Duration", exact=True).fill("2:05")
    dialog.get_by_role("button", name="Start a new experiment").click()
    expect(dialog).to_be_hidden()
    assert lab.experiment()["clock"]["duration"] == 125.0


def test_escape_closes_the_uppermost_and_a_branch_made_by_a_double_click_is_one(lab: Lab) -> None:
    page = lab.page
    lab.fly_until(30.0)
    for button, menu in (("Charts", ".chooser"), ("Export", ".menu:not(.chooser)")):
        page.get_by_role("button", name=re.compile(f"^{button}")).click()
        expect(page.locator(menu)).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.locator(menu)).to_be_hidden()
    page.locator("ft-charts .scroller").focus()
    page.keyboard.press("v")
    expect(page.locator("ft-scene")).to_have_class(re.compile("large"))
    box = page.locator("ft-scene").bounding_box()
    assert box is not None
    assert box["width"] == 1440
    assert box["height"] > 600
    page.keyboard.press("Escape")
    expect(page.locator("ft-scene")).not_to_have_class(re.compile("large"))

    page.locator("ft-scene").get_by_role("button", name="hide", exact=True).click()
    shown = page.locator("ft-charts .chart .value").all_inner_texts()
    before = len(lab.rest("GET", "/experiments"))
    lab.look_at_start()
    page.locator("ft-topbar .branch").dblclick()
    expect(page.locator("ft-topbar .time")).to_have_text("0:00.0")
    assert len(lab.rest("GET", "/experiments")) == before + 1
    # Charts out of sight tell nothing of the run that was left.
    page.wait_for_function("() => import('/static/session.js').then((m) => m.recording.length === 0)")
    assert page.locator("ft-charts .chart .value").all_inner_texts() != shown
    page.wait_for_function(
        "() => [...document.querySelectorAll('ft-charts .chart .value')].every((e) => !/[1-9]/.test(e.textContent))"
    )


def test_going_back_leaves_the_page_and_not_the_scene(context: BrowserContext, base: str) -> None:
    page = context.new_page()
    page.goto(f"{base}/docs")
    lab = Lab(page, base)
    lab.open()
    frame = page.locator("ft-scene iframe")
    expect(frame).to_have_attribute("src", re.compile("darkMode"))
    before = page.evaluate("history.length")
    page.locator("ft-topbar").get_by_role("button", name="Theme").click()
    expect(frame).to_have_attribute("src", re.compile("scene/$"))
    assert page.evaluate("history.length") == before
    page.go_back()
    expect(page).to_have_url(re.compile("/docs$"))


def test_a_shared_link_has_the_charts_and_the_window(lab: Lab, context: BrowserContext) -> None:
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    lab.without_scene()
    lab.fly_until(20.0)
    lab.page.get_by_role("button", name=re.compile("^Charts")).click()
    lab.page.locator(".chooser input").nth(6).check()
    lab.page.locator(".chooser input").nth(0).uncheck()
    lab.page.keyboard.press("Escape")
    lab.page.get_by_label("Time window of the charts").select_option("10")
    lab.page.locator("ft-topbar").get_by_role("button", name="Theme").click()
    charts = lab.page.locator("ft-charts .chart h3").all_inner_texts()
    lab.page.get_by_role("button", name="Share", exact=True).click()
    expect(lab.page.locator(".toast").last).to_contain_text("these charts")
    address = lab.page.evaluate("navigator.clipboard.readText()")
    fresh = context.browser.new_context(color_scheme="dark")  # type: ignore[union-attr]
    other = Lab(fresh.new_page(), lab.base)
    other.open(address)
    expect(other.page.locator("ft-charts .chart")).to_have_count(len(charts))
    assert other.page.locator("ft-charts .chart h3").all_inner_texts() == charts
    assert other.page.evaluate("import('/static/store.js').then((m) => m.store.get().follow)") == 10
    assert other.page.evaluate("document.documentElement.dataset.theme") == "light"
    assert other.page.evaluate("localStorage.getItem('theme')") is None
    fresh.close()


UNPACK = """async (run) => {
  const { link, unpack } = await import('/static/share.js');
  return unpack(new URL(await link(run)).hash);
}"""
RUN = {
    "scenario": {"id": "x"}, "time": 5.0, "cursor": 2.0, "charts": ["a"], "zoom": [1.0, 3.0], "follow": None,
    "title": "Branch A at 2.0 s", "theme": "light", "picture": "Parity space", "large": True,
}  # fmt: skip
PLAIN = {"cursor": None, "charts": None, "zoom": None, "follow": None, "title": None, "theme": None, "picture": None}


def test_a_link_holds_how_the_page_looks_and_takes_nothing_else(plain: Page) -> None:
    assert plain.evaluate(UNPACK, RUN) == RUN
    old = {"scenario": {"id": "x"}, "time": 5.0}
    assert plain.evaluate(UNPACK, old) == old | PLAIN | {"large": False}
    odd = {"title": "x" * 121, "theme": "pink", "picture": 7, "large": "yes", "charts": {}, "zoom": [1], "cursor": "2"}
    assert plain.evaluate(UNPACK, old | odd) == old | PLAIN | {"large": False}


PACK = """async (run) => (await import('/static/share.js')).link(run)"""


def test_a_link_that_leads_nowhere_is_explained_until_read_and_the_page_lives(lab: Lab) -> None:
    lab.refusals_expected = True
    page = lab.page
    run = {"scenario": {"system": "no-such-system"}, "time": 5.0, "cursor": None}
    refused = page.evaluate(PACK, run)
    for address, words in (
        (f"{lab.base}/#run=AAAA", "This link is damaged"),
        (refused, "The run in this link cannot be flown on this server"),
        (f"{lab.base}/?experiment=00000000", "no longer on the server"),
    ):
        page.goto("about:blank")
        lab.open(address)
        notice = page.locator(".toast", has_text=words)
        expect(notice).to_be_visible()
        expect(notice).to_contain_text("Here is a fresh experiment.")
        expect(notice).not_to_have_class(re.compile("passing"))
        assert lab.experiment()["clock"]["state"] == "paused"
        assert page.evaluate("location.hash") == ""
        notice.get_by_role("button", name="Dismiss").click()
        expect(notice).to_have_count(0)


UNWATCHED = "(id) => fetch(`/api/v1/experiments/${id}`).then(a => a.json()).then(e => e.watchers === 0)"


def test_only_what_this_browser_made_is_deleted_and_only_when_agreed(lab: Lab) -> None:
    lab.without_scene()
    elsewhere = lab.rest("POST", "/experiments", {"scenario": "zhang-1992"})["id"]
    lab.fly_until(5.0)
    made = lab.id
    lab.page.get_by_role("button", name="Branch from here").click()
    expect(lab.page).not_to_have_url(re.compile(made))
    opened = lab.id
    lab.page.get_by_label("Branch", exact=True).select_option("all")
    dialog = lab.page.get_by_role("dialog", name="Experiments")
    lab.page.wait_for_function(
        "(id) => fetch(`/api/v1/experiments/${id}`).then(a => a.json()).then(e => e.watchers === 0)", arg=made
    )
    question = lab.page.get_by_role("dialog", name="Are you sure?")

    dialog.get_by_role("button", name="Delete mine but the open one").click()
    expect(question).to_contain_text("Delete 1 experiment that this browser made?")
    expect(question).to_contain_text("1 experiment made elsewhere stays")
    question.get_by_role("button", name="Keep").click()
    expect(question).to_be_hidden()
    assert {one["id"] for one in lab.rest("GET", "/experiments")} == {elsewhere, made, opened}

    dialog.get_by_role("button", name="Delete mine but the open one").click()
    question.get_by_role("button", name="Delete 1").click()
    expect(dialog.locator("tbody tr")).to_have_count(2)
    assert {one["id"] for one in lab.rest("GET", "/experiments")} == {elsewhere, opened}

    dialog.get_by_role("button", name="Delete mine but the open one").click()
    expect(dialog.get_by_role("status")).to_contain_text("There is nothing here that this browser made")
    dialog.get_by_role("row", name=re.compile("elsewhere")).get_by_role("button", name=re.compile("^Delete")).click()
    expect(question).to_contain_text("not made by this browser")
    lab.page.keyboard.press("Escape")
    assert elsewhere in {one["id"] for one in lab.rest("GET", "/experiments")}


FLOWN = """async ([asked, notes]) => {
  const { Pace, told } = await import('/static/pace.js');
  const pace = new Pace();
  for (const [wall, flight] of notes) pace.note(wall, flight);
  return told(asked, pace.rate);
}"""


@pytest.mark.parametrize(
    ("asked", "flown", "says"),
    [
        (10, 10.0, ""),
        (10, 2.1, "flying 2.1x of 10x"),
        (100, 70.0, "flying 70x of 100x"),
        ("max", 35.0, "flying 35x"),
    ],
)
def test_a_speed_that_is_not_held_is_said(plain: Page, asked: Any, flown: float, says: str) -> None:
    notes = [[0.1 * i, 0.1 * i * flown] for i in range(60)]
    assert plain.evaluate(FLOWN, [asked, notes]) == says
    assert plain.evaluate(FLOWN, [asked, notes[:5]]) == ""
    # After a rewind only what was flown since counts.
    assert plain.evaluate(FLOWN, [asked, [*notes, [6.0, 0.0], [6.1, 0.2]]]) == ""


TIMES = """async (texts) => {
  const { timeIn } = await import('/static/schema.js');
  return texts.map((text) => timeIn(text) ?? null);
}"""


def test_times_are_read_as_they_are_shown(plain: Page) -> None:
    texts = ["150", "2:30", " 1:02:03.5 ", "0:00.02", "2,5", "90:00", "2:60", "1:75:00", "-1:00", "a", "", "1:2:3:4"]
    assert plain.evaluate(TIMES, texts) == [150, 150, 3723.5, 0.02, 2.5, 5400, None, None, None, None, None, None]


KEPT = """async (text) => (await import('/static/format.js')).kept(text)"""


def test_no_line_ends_between_a_number_and_its_unit(plain: Page) -> None:
    text = "after 27 s; 9.5 m of 1215 tests: 0 % (95 %: 0 to 0.3 %), 2 m/s, 5 mg, 3 satellites, 4 of 6"
    for unit in ("s;", "m ", "%", "m/s", "mg"):
        text = text.replace(f" {unit}", f"~{unit}") if unit != "s;" else text.replace("27 s;", "27~s;")
    assert plain.evaluate(KEPT, text.replace("~", " ")).replace("\u00a0", "~") == text


READOUTS = """async (values) => {
  const { places, readout } = await import('/static/format.js');
  const decimals = places(Math.max(...values.map(Math.abs)));
  return values.map((v) => readout(v, decimals));
}"""


def test_values_of_one_legend_have_the_same_decimals(plain: Page) -> None:
    assert plain.evaluate(READOUTS, [-2.3, -8.98, 0.0]) == ["−2.30", "−8.98", "0.00"]
    assert plain.evaluate(READOUTS, [-0.0253, 0.0065, -0.00001]) == ["−0.0253", "0.0065", "0.0000"]
    assert plain.evaluate(READOUTS, [83.7, 4.86, 15.0]) == ["83.7", "4.9", "15.0"]
