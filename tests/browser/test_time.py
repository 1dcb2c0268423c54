"""Looking back, going back, branching off, sharing; and the charts that all of it shows in."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, expect

from .lab import Lab

LAST_TIME = "import('/static/session.js').then(m => m.recording.last)"


def test_rewinding_forgets_what_came_later(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(10.0)
    lab.inject()
    expect(lab.marks("injected")).to_have_count(1)
    lab.fly_until(20.0)
    _look_back_to(lab, 5.0)
    lab.page.get_by_role("button", name="Rewind to here").click()
    expect(lab.page.locator("ft-topbar .time")).to_have_text("0:05.0")
    expect(lab.marks("injected")).to_have_count(0)
    expect(lab.page.locator("ft-timeline .past")).to_be_hidden()
    assert lab.page.evaluate(LAST_TIME) == 5.0
    assert lab.now == 5.0


def _look_back_to(lab: Lab, time: float) -> None:
    lab.look_at_start()
    for _ in range(round(time)):
        lab.page.keyboard.press("ArrowRight")
    expect(lab.page.locator("ft-timeline .head")).to_have_attribute("aria-valuenow", f"{time:.3f}")
    expect(lab.page.locator("ft-timeline .past")).to_be_visible()


def test_the_diagram_shows_the_moment_looked_at(lab: Lab) -> None:
    lab.fly_until(60.0)
    expect(lab.page.locator("ft-diagram .block.faulted").first).to_be_attached()
    _look_back_to(lab, 10.0)
    expect(lab.page.locator("ft-diagram .block.faulted")).to_have_count(0)
    lab.page.keyboard.press("End")
    expect(lab.page.locator("ft-diagram .block.faulted").first).to_be_attached()


def test_a_branch_goes_its_own_way(lab: Lab) -> None:
    lab.without_scene()
    trunk = lab.id
    lab.fly_until(20.0)
    _look_back_to(lab, 10.0)
    lab.page.locator("ft-timeline").get_by_role("button", name="Branch from here").click()
    expect(lab.page.locator("ft-topbar .time")).to_have_text("0:10.0")
    branch = lab.id
    assert branch != trunk
    assert lab.experiment()["parent"] == trunk
    lab.inject()
    expect(lab.marks("injected")).to_have_count(1)
    picker = lab.page.get_by_label("Branch", exact=True)
    expect(picker.locator("option")).to_have_count(3)
    picker.select_option(trunk)
    expect(lab.page.locator("ft-topbar .time")).to_have_text("0:20.0")
    expect(lab.marks("injected")).to_have_count(0)


def test_a_shared_link_restores_the_run_and_the_cursor(lab: Lab, context: BrowserContext) -> None:
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    lab.without_scene()
    lab.fly_until(10.0)
    lab.inject()
    lab.fly_until(25.0)
    _look_back_to(lab, 12.0)
    lab.page.get_by_role("button", name="Share", exact=True).click()
    expect(lab.page.locator(".toast").last).to_contain_text("Link copied")
    address = lab.page.evaluate("navigator.clipboard.readText()")
    values = lab.page.evaluate(
        "import('/static/session.js').then(m => m.recording.names.map(n => m.recording.at(n, 25)))"
    )
    other = Lab(context.new_page(), lab.base)
    other.open(address)
    expect(other.page.locator("ft-timeline .head")).to_have_attribute("aria-valuenow", "12.000")
    expect(other.page.locator("ft-topbar .time")).to_have_text("0:25.0")
    expect(other.marks("injected")).to_have_count(1)
    assert other.id != lab.id
    other.page.wait_for_function("() => import('/static/session.js').then(m => m.recording.length >= 25)")
    again = other.page.evaluate(
        "import('/static/session.js').then(m => m.recording.names.map(n => m.recording.at(n, 25)))"
    )
    assert again == values


def test_the_run_without_the_fault_is_drawn_behind(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(60.0)
    lines = lab.page.locator("ft-charts .chart").first.locator(".scatterlayer .trace")
    before = lines.count()
    lab.page.get_by_role("button", name="Run without the fault").click()
    expect(lines).not_to_have_count(before)
    lab.page.get_by_role("button", name="Run without the fault").click()
    expect(lines).to_have_count(before)


def test_charts_share_crosshair_and_zoom(lab: Lab) -> None:
    lab.without_scene()
    lab.page.locator("ft-welcome").get_by_role("button", name="Dismiss").click()
    lab.fly_until(60.0)
    plot = lab.page.locator("ft-charts .plot").first.bounding_box()
    assert plot is not None
    middle = plot["y"] + plot["height"] / 2
    lab.page.mouse.move(plot["x"] + 200, middle)
    expect(lab.page.locator(".hover-line")).to_be_visible()
    values = lab.page.locator("ft-charts .chart .value").all_inner_texts()
    lab.page.mouse.move(plot["x"] + 300, middle)
    assert lab.page.locator("ft-charts .chart .value").all_inner_texts() != values
    lab.page.mouse.down()
    lab.page.mouse.move(plot["x"] + 420, middle, steps=4)
    lab.page.mouse.up()
    expect(lab.page.get_by_role("button", name="Reset zoom")).to_be_visible()
    first = lab.page.locator("ft-charts .ruler .ticks span").first.inner_text()
    assert first != "0:00"
    lab.page.keyboard.press("0")
    expect(lab.page.get_by_role("button", name="Reset zoom")).to_be_hidden()


def test_numbers_behind_a_chart_are_a_table_and_a_file(lab: Lab, tmp_path: Path) -> None:
    lab.fly_until(30.0)
    lab.page.locator("ft-charts .chart").first.get_by_role("button", name="Table of").click()
    table = lab.page.get_by_role("dialog", name="Table")
    expect(table.locator("tbody tr")).to_have_count(30)
    with lab.page.expect_download() as download:
        table.get_by_role("button", name="CSV").click()
    download.value.save_as(tmp_path / "chart.csv")
    rows = list(csv.reader((tmp_path / "chart.csv").open()))
    assert len(rows) == 31
    assert rows[0][0] == "time"


def test_the_log_is_filtered_and_leads_to_the_moment(lab: Lab) -> None:
    lab.fly_until(60.0)
    log = lab.page.locator("ft-log")
    everything = log.locator(".event").count()
    log.get_by_role("button", name="Alarms", exact=True).click()
    assert 0 < log.locator(".event").count() < everything
    log.get_by_role("searchbox").fill("isolated")
    event = log.locator(".event").last
    expect(event.locator(".why")).to_contain_text(">")
    event.click()
    expect(lab.page.locator("ft-timeline .past")).to_be_visible()


@pytest.mark.long
def test_a_run_can_be_taken_away(lab: Lab, tmp_path: Path) -> None:
    lab.fly_until(20.0)
    for item, ending, opening in (
        ("Data, CSV", "csv", b'"time"'),
        ("Data, Parquet", "parquet", b"PAR1"),
        ("Scenario with commands, JSON", "json", b"{"),
    ):
        lab.page.get_by_role("button", name="Export", exact=True).click()
        with lab.page.expect_download() as download:
            lab.page.get_by_role("button", name=item).click()
        assert download.value.suggested_filename == f"ftlab-{lab.id}.{ending}"
        download.value.save_as(tmp_path / ending)
        assert (tmp_path / ending).read_bytes().startswith(opening)
    lab.page.get_by_role("button", name="Export", exact=True).click()
    with lab.page.context.expect_page() as report:
        lab.page.get_by_role("button", name="Report").click()
    expect(report.value.locator("body")).to_contain_text("Score", timeout=120_000)
    report.value.close()


def test_a_flight_that_is_over_is_not_flown_anew_by_a_key(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(100.0)
    lab.page.locator("ft-charts .scroller").focus()
    lab.page.keyboard.press("Space")
    expect(lab.page.locator(".toast")).to_contain_text("The flight is over")
    assert lab.now == 100.0
    lab.page.get_by_role("button", name="or run it again").click()
    expect(lab.page.locator("ft-topbar .play")).to_have_text("Pause")
    assert lab.now < 100.0
