"""A receiver's log of one's own: opened from the scenario picker, refused at the field, flown and broken."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, expect

from tests.synthetic_log import Files, files

from .lab import Lab

EPOCHS = 30
PICK = "Open a receiver log …"


@pytest.fixture(scope="module")
def made() -> Files:
    return files(EPOCHS)


@pytest.fixture(scope="module")
def folder(made: Files, tmp_path_factory: pytest.TempPathFactory) -> Path:
    kept = tmp_path_factory.mktemp("log")
    (kept / "roof.26o").write_bytes(made.observation)
    (kept / "roof.26n").write_bytes(made.navigation)
    (kept / "roof.26o.gz").write_bytes(gzip.compress(made.observation)[:-30])
    (kept / "noisy.26o.gz").write_bytes(gzip.compress(files(EPOCHS, noise=8.0).observation))
    (kept / "march.26n").write_bytes(files(EPOCHS, days=4).navigation)
    with (kept / "huge.26n").open("wb") as file:
        file.truncate(20_000_001)
    return kept


def opened(lab: Lab) -> Locator:
    lab.page.get_by_label("Scenario", exact=True).select_option(PICK)
    dialog = lab.page.get_by_role("dialog", name="Open a receiver log")
    expect(dialog).to_be_visible()
    return dialog


def submit(dialog: Locator) -> None:
    dialog.get_by_role("button", name="Open", exact=True).click()


def test_a_log_is_opened_run_and_broken(lab: Lab, folder: Path, made: Files) -> None:
    before = lab.id
    dialog = opened(lab)
    expect(dialog).to_contain_text("at most 64 MB and 8640 epochs")
    expect(dialog).to_contain_text("at most 20 MB")
    dialog.get_by_label("Observation file").set_input_files(folder / "roof.26o")
    dialog.get_by_label("Navigation file").set_input_files(folder / "roof.26n")
    dialog.get_by_label("Antenna position").fill(made.position)
    submit(dialog)
    expect(dialog).to_be_hidden()
    picker = lab.page.get_by_label("Scenario", exact=True)
    expect(picker.locator("option:checked")).to_have_text("Receiver log of 2026-03-04 10:00:00")
    assert lab.id != before
    clock = lab.experiment()["clock"]
    assert (clock["time"], clock["period"], clock["duration"]) == (0.0, 30.0, 900.0)
    expect(lab.page.locator("ft-welcome")).to_contain_text("Receiver log")

    lab.page.get_by_role("button", name="Forward one epoch").click()
    expect(lab.page.locator("ft-topbar .time")).to_have_text("0:30.0")
    lab.fly_until(300.0)
    rows = "import('/static/session.js').then(m => [...m.recording.time])"
    lab.page.wait_for_function(f"() => {rows}.then((time) => time.length === 10)")
    assert lab.page.evaluate(rows) == [30.0 * k for k in range(1, 11)]
    curve = lab.page.locator("ft-charts .chart").first.locator(".scatterlayer .trace path.js-line").last
    lab.page.wait_for_function("(path) => path.getAttribute('d').length > 20", arg=curve.element_handle())

    lab.page.get_by_role("button", name="Back one epoch").click()
    expect(lab.page.locator("ft-topbar .time")).to_have_text("4:30.0")
    lab.rest("POST", f"/experiments/{lab.id}/faults",
             {"channel": "gps.pseudorange.G10", "kind": "bias", "magnitude": 100})  # fmt: skip
    lab.fly_until(600.0)
    expect(lab.marks("injected").first).to_be_visible()
    expect(lab.page.locator("ft-log")).to_contain_text("G10")
    assert lab.experiment()["faults"][0]["state"] == "active"


@pytest.mark.long
def test_it_runs_by_the_clock_at_a_speed_that_fits(lab: Lab, folder: Path) -> None:
    dialog = opened(lab)
    dialog.get_by_label("Observation file").set_input_files(folder / "roof.26o")
    dialog.get_by_label("Navigation file").set_input_files(folder / "roof.26n")
    submit(dialog)
    expect(dialog).to_be_hidden()
    assert lab.experiment()["clock"]["speed"] == 100
    lab.run()
    expect(lab.page.locator("ft-topbar .play")).to_have_text("Run again", timeout=120_000)
    assert lab.now == 900.0


def test_noise_that_contradicts_the_assumption_is_a_warning_and_its_floor_can_be_given(lab: Lab, folder: Path) -> None:
    dialog = opened(lab)
    dialog.get_by_label("Observation file").set_input_files(folder / "noisy.26o.gz")
    dialog.get_by_label("Navigation file").set_input_files(folder / "roof.26n")
    submit(dialog)
    warning = lab.page.locator("ft-welcome .remark").filter(has_text="The residuals contradict the assumed noise")
    expect(warning).to_contain_text("m would fit.")
    expect(lab.page.locator("ft-log")).to_contain_text("The residuals contradict the assumed noise")
    events = lab.rest("GET", f"/experiments/{lab.id}/events")
    fits = next(event["detail"]["fitting_floor"] for event in events if event["kind"] == "log.noise")

    dialog = opened(lab)
    dialog.get_by_label("Observation file").set_input_files(folder / "noisy.26o.gz")
    dialog.get_by_label("Navigation file").set_input_files(folder / "roof.26n")
    dialog.get_by_label("Noise floor").fill(str(fits))
    submit(dialog)
    expect(dialog).to_be_hidden()
    expect(lab.page.locator("ft-welcome")).to_contain_text("Receiver log")
    expect(warning).to_have_count(0)
    assert lab.rest("GET", f"/experiments/{lab.id}/scenario")["parameters"]["log"]["floor"] == fits


def test_what_is_wrong_is_said_at_the_field(lab: Lab, folder: Path) -> None:
    lab.refusals_expected = True
    before = lab.id
    dialog = opened(lab)
    observation, navigation = dialog.get_by_label("Observation file"), dialog.get_by_label("Navigation file")
    antenna = dialog.get_by_label("Antenna position")

    antenna.fill("north pole")
    submit(dialog)
    expect(observation).to_have_accessible_description(
        "Choose a file. With the code on L1; at most 64 MB and 8640 epochs; plain, .gz, .Z or .crx."
    )
    expect(observation).to_be_focused()
    expect(dialog.locator(".field .error:visible")).to_have_count(3)
    expect(antenna).to_have_attribute("aria-invalid", "true")

    observation.set_input_files(folder / "roof.26o")
    navigation.set_input_files(folder / "huge.26n")
    antenna.fill("")
    submit(dialog)
    expect(dialog.locator(".field .error:visible")).to_have_text(["This file has 20.01 MB; at most 20 MB are taken."])

    observation.set_input_files(folder / "roof.26o.gz")
    navigation.set_input_files(folder / "roof.26n")
    submit(dialog)
    expect(dialog.locator(".field .error:visible")).to_have_text(
        ["The observation file is corrupt: its gzip packing is damaged or cut off."]
    )
    expect(observation).to_be_focused()

    observation.set_input_files(folder / "roof.26o")
    navigation.set_input_files(folder / "march.26n")
    submit(dialog)
    expect(dialog.get_by_role("alert")).to_have_text(re.compile("^The two files do not belong together: "))
    expect(dialog.locator("[aria-invalid=true]")).to_have_count(2)

    floor = dialog.get_by_label("Noise floor")
    floor.fill("0")
    navigation.set_input_files(folder / "roof.26n")
    submit(dialog)
    expect(dialog.locator(".field .error:visible")).to_have_text(["A number of metres is needed, from 0.01 to 100."])
    expect(floor).to_be_focused()
    floor.fill("")

    antenna.fill("1, 2, 3")
    navigation.set_input_files(folder / "roof.26n")
    submit(dialog)
    expect(antenna).to_have_attribute("aria-invalid", "true")
    expect(dialog.locator(".field .error:visible")).to_have_count(1)
    assert lab.id == before
    assert len(lab.rest("GET", "/experiments")) == 1


def test_without_a_mouse_and_in_either_theme(lab: Lab, folder: Path) -> None:
    page = lab.page
    lab.without_scene()
    page.locator("ft-charts .scroller").focus()
    page.keyboard.press("o")
    dialog = page.get_by_role("dialog", name="Open a receiver log")
    expect(dialog.get_by_label("Observation file")).to_be_focused()
    seen = []
    for theme in ("dark", "light"):
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", theme)
        seen.append(dialog.evaluate("(d) => getComputedStyle(d).backgroundColor"))
    assert seen[0] != seen[1]
    order = []
    for _ in range(5):
        order.append(page.evaluate("document.activeElement.name || document.activeElement.textContent"))
        page.keyboard.press("Tab")
    assert order == ["observation", "navigation", "antenna", "noise_floor", "Open"]
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    scenario = lab.rest("GET", f"/experiments/{lab.id}")["scenario"]["id"]
    expect(page.get_by_label("Scenario", exact=True)).to_have_value(scenario)


def test_an_upload_can_be_copied_as_curl(lab: Lab, folder: Path, made: Files) -> None:
    lab.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    dialog = opened(lab)
    dialog.get_by_label("Observation file").set_input_files(folder / "roof.26o")
    dialog.get_by_label("Navigation file").set_input_files(folder / "roof.26n")
    dialog.get_by_role("button", name="Copy this upload as curl").click()
    expect(lab.page.locator(".toast")).to_contain_text("copied")
    told = lab.page.evaluate("navigator.clipboard.readText()")
    assert told == (
        f"curl -X POST '{lab.base}/api/v1/logs' -F 'observation=@roof.26o' -F 'navigation=@roof.26n'"
    )  # fmt: skip
