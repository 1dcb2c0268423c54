"""Breaking things and putting them right: every action shows in charts, diagram and log, and as a curl command."""

from __future__ import annotations

import subprocess

from playwright.sync_api import expect

from .lab import Lab


def test_an_injected_fault_is_marked_in_the_charts(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(10.0)
    lab.inject()
    mark = lab.marks("injected")
    expect(mark).to_have_count(1)
    expect(lab.page.locator("ft-faults .fault", has_text="since 0:10.0")).to_have_count(1)
    expect(lab.page.locator("ft-log .event.faults", has_text="Injected").first).to_be_visible()
    at, plot = mark.bounding_box(), lab.page.locator("ft-charts .plot").first.bounding_box()
    assert at is not None
    assert plot is not None
    assert at["y"] < plot["y"]
    assert at["y"] + at["height"] > plot["y"] + plot["height"]
    inner = plot["width"] - 54 - 14
    assert abs(at["x"] - (plot["x"] + 54 + inner * 10.0 / 100.0)) < 3.0


def test_a_refused_fault_is_explained_at_its_field(lab: Lab) -> None:
    lab.refusals_expected = True
    lab.without_scene()
    before = len(lab.experiment()["faults"])
    lab.inject(magnitude="0")
    field = lab.page.locator("ft-bench input[name=magnitude]")
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(lab.page.locator(f"#{field.get_attribute('aria-describedby')}")).to_contain_text(
        "magnitude 0 changes nothing"
    )
    lab.inject(magnitude="a lot")
    expect(lab.page.locator(f"#{field.get_attribute('aria-describedby')}")).to_contain_text("number")
    assert len(lab.experiment()["faults"]) == before
    lab.page.locator("ft-bench select[name=kind]").select_option("stuck")
    expect(field).to_be_hidden()


def test_clearing_ends_the_fault_everywhere(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(10.0)
    lab.inject()
    card = lab.page.locator("ft-faults .fault", has_text="since 0:10.0")
    expect(card).to_have_count(1)
    lab.fly_until(15.0)
    card.locator(".clear").click()
    expect(card).to_have_count(0)
    expect(lab.marks("cleared")).to_have_count(1)
    expect(lab.page.locator("ft-log .event", has_text="Cleared").first).to_be_visible()
    lab.page.locator("ft-faults").get_by_role("button", name="Clear all", exact=True).click()
    expect(lab.page.locator("ft-faults .fault")).to_have_count(0)
    expect(lab.page.locator("ft-faults .none")).to_be_visible()


def test_channels_are_found_by_name(lab: Lab) -> None:
    channel = lab.page.locator("ft-bench select[name=channel]")
    everything = channel.locator("option").count()
    wanted = channel.locator("option").last.inner_text()
    lab.page.get_by_label("Find a channel").fill(wanted)
    assert 0 < channel.locator("option").count() < everything
    lab.page.get_by_label("Find a channel").fill("no such thing")
    expect(channel).to_contain_text("no channel matches")


def test_channels_that_are_not_fitted_are_not_offered(lab: Lab) -> None:
    experiment = lab.rest("POST", "/experiments", {"scenario": "yang-2016-scenario-1"})
    missing = set(experiment["unavailable"])
    described = {c["name"] for c in lab.rest("GET", "/systems/sins-gps-bd2-cns")["channels"]}
    lab.open(f"/?experiment={experiment['id']}")
    channel = lab.page.locator("ft-bench select[name=channel]")
    expect(channel.locator("option[value='imu.gyro.x']")).to_have_count(1)
    offered = set(channel.locator("option").evaluate_all("all => all.map((one) => one.value)"))
    assert missing
    assert offered == described - missing


def test_the_curl_command_does_what_the_button_does(lab: Lab, context: object) -> None:
    context.grant_permissions(["clipboard-read", "clipboard-write"])  # type: ignore[attr-defined]
    lab.without_scene()
    before = len(lab.experiment()["faults"])
    lab.page.get_by_role("button", name="Copy this injection as curl").click()
    expect(lab.page.locator(".toast")).to_contain_text("copied")
    command = lab.page.evaluate("navigator.clipboard.readText()")
    assert command.startswith("curl -X POST 'http://127.0.0.1")
    subprocess.run(["bash", "-c", command], check=True, capture_output=True, timeout=120)
    assert len(lab.experiment()["faults"]) == before + 1


def test_a_subsystem_is_switched_off_and_its_wires_open(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(20.0)
    name, label = next((n, s) for n, s in _wired(lab))
    switch = lab.page.locator("ft-subsystems li", has_text=label).get_by_role("switch")
    switch.uncheck()
    expect(lab.page.locator("ft-subsystems li", has_text=label)).to_contain_text("off")
    lab.fly_until(22.0)
    expect(lab.page.locator("ft-diagram .wire.open").first).to_be_attached()
    expect(lab.page.locator("ft-diagram .block.off").first).to_be_attached()
    assert lab.experiment()["subsystems"][name]["enabled"] is False
    switch.check()
    expect(lab.page.locator("ft-subsystems li", has_text=label)).to_contain_text("from the next epoch")
    lab.fly_until(23.0)
    expect(lab.page.locator("ft-subsystems li", has_text=label)).not_to_contain_text("off")


def _wired(lab: Lab) -> list[tuple[str, str]]:
    system = lab.rest("GET", f"/systems/{lab.experiment()['system']}")
    carried = {wire["carries"] for wire in system["wires"]}
    return [(s["name"], s["label"]) for s in system["subsystems"] if s["name"] in carried]


def test_a_block_offers_what_can_be_done_to_it(lab: Lab) -> None:
    lab.without_scene()
    block = lab.page.locator("ft-diagram .block.sensor").first
    block.focus()
    lab.page.keyboard.press("Enter")
    popover = lab.page.locator("ft-popover")
    expect(popover).to_be_visible()
    popover.get_by_role("button", name="Inject a fault here").click()
    expect(popover).to_be_hidden()
    expect(lab.page.locator("ft-bench select[name=channel]")).to_be_focused()


def test_a_setting_is_applied_at_once_and_refused_at_its_field(lab: Lab) -> None:
    lab.refusals_expected = True
    system = lab.rest("GET", f"/systems/{lab.experiment()['system']}")
    name = next(n for n, s in system["settings_schema"]["properties"].items() if s.get("type") == "integer")
    field = lab.page.locator(f"ft-settings [data-setting={name}] input")
    field.fill("-7")
    field.press("Enter")
    expect(field).to_have_attribute("aria-invalid", "true")
    value = lab.experiment()["settings"][name]
    field.fill(str(value + 1))
    field.press("Enter")
    expect(lab.page.locator("ft-log .event.command", has_text="Settings")).to_have_count(1)
    expect(field).to_have_attribute("aria-invalid", "false")
    assert lab.experiment()["settings"][name] == value + 1
