"""Charts of one moment: the sky, residual bars, the Stanford diagram; and a satellite chosen where it is seen."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Locator, expect

from .lab import Lab

IN_VIEW = 8
"""Satellites over Seoul at the scenario's start: systems.md B."""


@pytest.fixture
def receiver(lab: Lab) -> Lab:
    """The receiver of chey-2004 after its drift was found: D3 is out from 60 to 82 s."""
    lab.without_scene()
    lab.page.get_by_label("Scenario").select_option("chey-2004")
    expect(lab.page.locator("ft-moment")).to_have_count(3)
    lab.fly_until(70.0)
    latest = lab.rest("POST", f"/experiments/{lab.id}/advance", {"until": 70.0})["latest"]
    expect(moment(lab, "Residuals").locator(".words")).to_contain_text(f"D3 {latest['residual.snapshot.D3']:.3g}")
    expect(moment(lab, "Sky").locator(".words")).to_contain_text("1 out")
    return lab


def moment(lab: Lab, title: str) -> Locator:
    return lab.page.locator("ft-moment").filter(has=lab.page.locator("h3", has_text=title))


def numbers(chart: Locator, column: int) -> list[str]:
    """A column of the table behind a chart."""
    chart.get_by_role("button", name="Table of").click()
    dialog = chart.page.locator("ft-table dialog")
    expect(dialog).to_be_visible()
    cells = dialog.locator(f"tbody tr > :nth-child({column})").all_inner_texts()
    dialog.get_by_role("button", name="Close").click()
    return cells


def test_the_sky_shows_who_is_in_view_and_who_is_out(receiver: Lab) -> None:
    sky = moment(receiver, "Sky")
    expect(sky.locator(".target")).to_have_count(IN_VIEW)
    expect(sky.locator(".words")).to_have_text(f"{IN_VIEW} in view, 1 out")
    expect(sky.locator(".target[title*=isolated]")).to_have_attribute("title", re.compile("^D3: elevation"))
    latest = receiver.rest("POST", f"/experiments/{receiver.id}/advance", {"until": 70.0})["latest"]
    names = numbers(sky, 1)
    seen = sorted(n for n, v in latest.items() if n.startswith("elevation.") and v is not None)
    assert sorted(f"elevation.{name}" for name in names) == seen
    for name, elevation in zip(names, numbers(sky, 2), strict=True):
        assert float(elevation) == pytest.approx(latest[f"elevation.{name}"] * 57.29578, abs=0.06)


@pytest.mark.long
def test_charts_of_a_moment_follow_the_cursor(receiver: Lab) -> None:
    sky, stanford = moment(receiver, "Sky"), moment(receiver, "Stanford")
    expect(stanford.locator(".plot")).to_contain_text("70")
    receiver.look_at_start()
    receiver.page.keyboard.press("PageUp")
    receiver.page.keyboard.press("PageUp")
    expect(receiver.page.locator("ft-timeline .past")).to_contain_text("0:10.0")
    expect(sky.locator(".words")).to_have_text(f"{IN_VIEW} in view")
    expect(stanford.locator(".plot")).to_contain_text("10")
    expect(sky.locator(".target[title*=isolated]")).to_have_count(0)
    receiver.page.keyboard.press("End")
    expect(sky.locator(".words")).to_contain_text("1 out")


def test_the_stanford_diagram_counts_every_epoch_once(receiver: Lab) -> None:
    classes = receiver.rest("GET", f"/experiments/{receiver.id}/series?signals=combined.stanford")["signals"]
    counts = [classes["combined.stanford"].count(float(region)) for region in range(4)]
    stanford = moment(receiver, "Stanford")
    stanford.get_by_role("button", name="Table of").click()
    caption = receiver.page.locator("ft-table caption")
    expect(caption).to_have_text(
        f"70 epochs: nominal {counts[0]}, MI {counts[1]}, HMI {counts[2]}, unavailable {counts[3]}"
    )
    assert sum(counts) == 70


@pytest.mark.long
def test_residual_bars_are_the_residuals_of_the_epoch(receiver: Lab) -> None:
    latest = receiver.rest("POST", f"/experiments/{receiver.id}/advance", {"until": 70.0})["latest"]
    bars = moment(receiver, "Residuals")
    expect(bars.locator(".target")).to_have_count(IN_VIEW)
    names, values = numbers(bars, 1), numbers(bars, 2)
    assert names[-1] == "threshold"
    assert float(values[-1]) == pytest.approx(3.29, abs=0.01)  # sqrt(chi2.isf(1e-3, 1))
    for name, value in zip(names[:-1], values[:-1], strict=True):
        assert float(value.replace("−", "-")) == pytest.approx(latest[f"residual.snapshot.{name}"], rel=1e-3)


@pytest.mark.parametrize("title", ["Sky", pytest.param("Residuals", marks=pytest.mark.long)])
def test_a_click_on_a_satellite_chooses_its_channel(receiver: Lab, title: str) -> None:
    moment(receiver, title).locator(".target[title^=C3]").click()
    channel = receiver.page.locator("ft-bench select[name=channel]")
    expect(channel).to_have_value("gps.pseudorange.C3")
    expect(channel).to_be_focused()


def test_a_satellite_is_chosen_with_the_keys(receiver: Lab) -> None:
    targets = moment(receiver, "Sky").locator(".target")
    expect(moment(receiver, "Sky").locator(".target[tabindex='0']")).to_have_count(1)
    targets.first.focus()
    receiver.page.keyboard.press("ArrowRight")
    expect(targets.nth(1)).to_be_focused()
    name = (targets.nth(1).get_attribute("title") or "").split(":")[0]
    receiver.page.keyboard.press("Enter")
    expect(receiver.page.locator("ft-bench select[name=channel]")).to_have_value(f"gps.pseudorange.{name}")


def test_the_diagrams_block_lists_the_satellites_in_view(receiver: Lab) -> None:
    receiver.page.locator("ft-diagram .block.sensor").first.click()
    chips = receiver.page.locator("ft-popover .chips button")
    expect(chips.filter(has_text="D3")).to_have_attribute("title", re.compile("isolated"))
    assert chips.count() >= IN_VIEW
    chips.filter(has_text="F4").click()
    expect(receiver.page.locator("ft-bench select[name=channel]")).to_have_value("gps.pseudorange.F4")


def test_the_fault_form_offers_what_is_there_first(receiver: Lab) -> None:
    groups = receiver.page.locator("ft-bench select[name=channel] optgroup")
    expect(groups.last).to_have_attribute("label", re.compile("^Not in view now"))
    first = groups.first.locator("option").all_inner_texts()
    assert sum(label.startswith("Pseudorange ") for label in first) == IN_VIEW
    assert receiver.page.locator("ft-bench select[name=channel]").input_value() in {
        f"gps.pseudorange.{label.removeprefix('Pseudorange ')}" for label in first
    }


def test_legends_and_tables_leave_out_what_has_no_value(receiver: Lab) -> None:
    receiver.page.evaluate("import('/static/session.js').then((m) => m.show(['residuals', 'status']))")
    chart = receiver.page.locator("ft-chart").filter(has_text="Residuals of the satellites")
    expect(chart.locator(".legend .line")).to_have_count(IN_VIEW)
    chart.get_by_role("button", name="Table of").click()
    expect(receiver.page.locator("ft-table thead th")).to_have_count(1 + IN_VIEW)
    receiver.page.locator("ft-table").get_by_role("button", name="Close").click()
    status = receiver.page.locator("ft-chart").filter(has_text="Status of each solution")
    expect(status.locator(".legend")).to_contain_text("satellites out")
    expect(status.locator(".plot")).to_contain_text("cannot isolate")
