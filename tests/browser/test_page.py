"""The page as a person meets it: it opens ready, it says what to try, it works without a mouse and in either theme."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Route, expect

from .lab import Lab

ROOT = Path(__file__).resolve().parents[2]


def test_first_visit_lands_on_a_scenario_ready_to_run(lab: Lab) -> None:
    welcome = lab.page.locator("ft-welcome")
    expect(welcome).to_be_visible()
    expect(welcome.locator(".hint")).not_to_be_empty()
    assert lab.experiment()["scenario"]["id"] == "zhang-1992-visible"
    assert lab.now == 0.0
    welcome.get_by_role("button", name="Run").click()
    expect(welcome).to_be_hidden()
    lab.page.wait_for_function("() => Number(document.querySelector('ft-timeline .head').ariaValueNow) > 5")
    curve = lab.page.locator("ft-charts .chart").first.locator(".scatterlayer .trace path.js-line").last
    assert len(curve.get_attribute("d") or "") > 20
    lab.pause()


def test_the_hint_can_be_dismissed(lab: Lab) -> None:
    lab.page.locator("ft-welcome").get_by_role("button", name="Dismiss").click()
    expect(lab.page.locator("ft-welcome")).to_be_hidden()


def test_a_reload_keeps_the_experiment(lab: Lab) -> None:
    before = lab.id
    lab.fly_until(20.0)
    lab.page.reload()
    expect(lab.page.locator("ft-topbar .time")).to_have_text("0:20.0")
    assert lab.id == before


def test_a_deleted_experiment_is_explained(lab: Lab) -> None:
    lab.refusals_expected = True
    lab.rest("DELETE", f"/experiments/{lab.id}")
    expect(lab.page.locator("ft-notices")).to_contain_text("no longer on the server")
    lab.page.get_by_role("button", name="Fly its scenario again").click()
    expect(lab.page.locator("ft-notices")).to_be_empty()
    assert lab.experiment()["clock"]["time"] == 0.0


def test_a_lost_connection_resumes_by_itself(context: BrowserContext, base: str) -> None:
    links = []
    page = context.new_page()
    page.route_web_socket(re.compile("/stream"), lambda link: (links.append(link), link.connect_to_server()))
    lab = Lab(page, base)
    lab.open()
    lab.fly_until(10.0)
    links[-1].close(code=1012)
    expect(page.locator("ft-notices")).to_contain_text("Connection lost")
    lab.rest("POST", f"/experiments/{lab.id}/advance", {"until": 30.0})
    expect(page.locator("ft-notices")).to_be_empty()
    expect(page.locator("ft-topbar .time")).to_have_text("0:30.0")
    rows = page.evaluate("import('/static/session.js').then(m => [...m.recording.time])")
    assert rows == sorted(rows)
    assert len(rows) == 30


def test_everything_has_a_key(lab: Lab) -> None:
    page = lab.page
    lab.without_scene()
    page.locator("ft-charts .scroller").focus()
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys")).to_be_visible()
    page.keyboard.press("Escape")
    page.keyboard.press("Space")
    expect(page.locator("ft-topbar .play")).to_have_text("Pause")
    page.keyboard.press("Space")
    expect(page.locator("ft-topbar .play")).to_have_text("Run")
    before = lab.now
    page.keyboard.press("]")
    expect(page.locator("ft-timeline .head")).to_have_attribute("aria-valuenow", f"{before + 1.0:.3f}")
    page.keyboard.press("ArrowLeft")
    expect(page.locator("ft-timeline .past")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("ft-timeline .past")).to_be_hidden()
    shown = page.locator("ft-charts .chart").count()
    page.keyboard.press("1")
    expect(page.locator("ft-charts .chart")).not_to_have_count(shown)
    page.keyboard.press("1")
    expect(page.locator("ft-charts .chart")).to_have_count(shown)
    page.keyboard.press("t")
    expect(page.locator("html")).to_have_attribute("data-theme", "light")
    page.keyboard.press("f")
    expect(page.locator("ft-bench select[name=channel]")).to_be_focused()


def test_every_control_has_a_name(lab: Lab) -> None:
    lab.fly_until(60.0)
    nameless = lab.page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, [role=button], [role=slider], iframe, dialog')]
        .filter(e => !(e.getAttribute('aria-label') || e.labels?.length || e.textContent.trim() || e.title))
        .map(e => e.outerHTML.slice(0, 120))"""
    )
    assert nameless == []


def test_fault_events_are_said_aloud(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(55.0)
    expect(lab.page.locator("#announcer")).to_contain_text("isolated")
    assert lab.page.locator("#announcer").get_attribute("aria-live") == "polite"


@pytest.mark.parametrize("size", [(1024, 720), pytest.param((1280, 720), marks=pytest.mark.long)])
def test_small_screens_do_not_scroll_sideways(lab: Lab, size: tuple[int, int]) -> None:
    lab.page.set_viewport_size({"width": size[0], "height": size[1]})
    lab.fly_until(60.0)
    lab.look_at_start()
    wide = lab.page.evaluate(
        """() => ['body', 'ft-topbar', '.left', '.middle', '.right', '.bottom > *', 'ft-charts .scroller']
        .flatMap((name) => [...document.querySelectorAll(name)].map((e) => [name, e.scrollWidth, e.clientWidth]))
        .filter(([, content, room]) => content > room + 1)"""
    )
    assert wide == []
    cut = lab.page.evaluate(
        """() => [...document.querySelectorAll('ft-topbar button, ft-topbar select')]
        .filter(e => e.checkVisibility()).map(e => [e.textContent, e.getBoundingClientRect()])
        .filter(([, box]) => box.right > innerWidth + 1 || box.width < 12).map(([text]) => text)"""
    )
    assert cut == []
    expect(lab.page.locator("ft-bench").get_by_role("button", name="Inject", exact=True)).to_be_visible()


CONTRAST = """() => {
  const rgb = (text) => (text.match(/[\\d.]+/g) ?? []).map(Number);
  const linear = (v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = (rgb) => rgb.slice(0, 3).map((v) => linear(v / 255))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = (e) => { for (let n = e; n; n = n.parentElement) { const c = rgb(getComputedStyle(n).backgroundColor);
    if (c.length === 3 || c[3] === 1) return c; } return [255, 255, 255]; };
  const bad = [];
  const texts = 'h2, h3, label, button:not(:disabled), dt, dd, p, .dim, .unit, .what, .why, .time, .name, .value';
  for (const e of document.querySelectorAll(texts)) {
    if (!e.textContent.trim() || !e.getClientRects().length || e.closest('[aria-pressed=false]')) continue;
    const [a, b] = [light(rgb(getComputedStyle(e).color)), light(ground(e))].sort((x, y) => y - x);
    const contrast = (a + 0.05) / (b + 0.05);
    if (contrast < 4.5) bad.push([e.localName, e.className, e.textContent.trim().slice(0, 20), contrast]);
  }
  return bad;
}"""


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_themes_follow_the_system_and_text_has_contrast(lab: Lab, theme: str) -> None:
    lab.page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
    expect(lab.page.locator("html")).to_have_attribute("data-theme", theme)
    lab.fly_until(60.0)
    expect(lab.page.locator("ft-faults .fault").first).to_be_visible()
    assert lab.page.evaluate(CONTRAST) == []


def test_the_page_knows_no_system_by_name() -> None:
    from ftcore import catalogue

    source = "\n".join(
        p.read_text("utf-8") for p in (ROOT / "frontend").rglob("*") if p.suffix in (".js", ".html", ".css")
    )
    for system in catalogue.systems():
        assert system.id not in source
        for name in (*(s.name for s in system.subsystems), *(c.sensor for c in system.channels)):
            assert not re.search(rf"""['"`]{re.escape(name)}['"`.]""", source), f"the page knows {name!r}"


def test_no_file_of_the_page_says_too_much() -> None:
    long = {
        p.name: n
        for p in (ROOT / "frontend").rglob("*.*s")
        if (n := len(Path(p).read_text("utf-8").splitlines())) > 400
    }
    assert long == {}


def test_a_system_never_seen_before_needs_no_change(lab: Lab) -> None:
    """The same flight under a description with every word changed, and with a block, a chart and a setting more."""

    def strange(route: Route) -> None:
        system = json.loads(lab_description)
        for part in ("channels", "subsystems", "signals", "charts", "blocks"):
            for item in system[part]:
                key = "title" if part == "charts" else "label"
                item[key] = f"Zz {item[key]}"
        system["blocks"].append({**system["blocks"][0], "id": "new", "x": 2, "y": 60, "label": "Zz new block"})
        system["charts"].append({**system["charts"][0], "id": "new", "title": "Zz new chart", "shown": True})
        system["settings_schema"]["properties"]["new"] = {"enum": ["one", "two"], "title": "Zz new setting"}
        system["scene"] = []
        route.fulfill(json=system)

    lab_description = json.dumps(lab.rest("GET", f"/systems/{lab.experiment()['system']}"))
    lab.page.route("**/api/v1/systems/*", strange)
    lab.page.reload()
    lab.fly_until(20.0)
    expect(lab.page.locator("ft-diagram .block", has_text="Zz")).to_have_count(
        len(json.loads(lab_description)["blocks"]) + 1
    )
    expect(lab.page.locator("ft-charts .chart", has_text="Zz new chart")).to_be_visible()
    expect(lab.page.get_by_label("Zz new setting", exact=True)).to_be_visible()
    expect(lab.page.locator("ft-bench select[name=channel]")).to_contain_text("Zz")
    expect(lab.page.locator("ft-scene")).to_be_hidden()


def test_a_full_server_is_explained_and_room_can_be_made(lab: Lab) -> None:
    lab.refusals_expected = True
    lab.fly_until(10.0)
    flown = lab.experiment()["scenario"]["id"]
    full = {"status": 429, "title": "Too Many Requests", "detail": "there are 32 experiments already", "errors": []}
    lab.page.route(
        "**/api/v1/experiments",
        lambda route: route.fulfill(status=429, json=full) if route.request.method == "POST" else route.continue_(),
    )
    other = lab.page.locator("ft-topbar .scenario option[title]").last.get_attribute("value")
    lab.page.get_by_label("Scenario").select_option(other)
    expect(lab.page.locator(".toast.error")).to_contain_text("32 experiments already")
    expect(lab.page.get_by_label("Scenario")).to_have_value(flown)
    lab.page.get_by_role("button", name="Choose experiments to delete").click()
    expect(lab.page.get_by_role("dialog", name="Experiments").locator("tbody tr")).not_to_have_count(0)


def test_a_failed_experiment_says_why(lab: Lab) -> None:
    lab.page.evaluate(
        """() => import('/static/store.js').then(({ store }) => {
          const { experiment } = store.get();
          const clock = { ...experiment.clock, state: 'failed', reason: 'the matrix is singular' };
          store.set({ experiment: { ...experiment, clock } });
        })"""
    )
    expect(lab.page.locator("ft-notices")).to_contain_text("the matrix is singular")
    expect(lab.page.locator("ft-topbar .play")).to_be_disabled()
