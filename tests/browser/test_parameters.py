"""What is fixed at the start: a form of it, the figures that follow while typing, and a new experiment."""

from __future__ import annotations

import pytest
from playwright.sync_api import Locator, expect

from .lab import Lab


@pytest.fixture
def gyros(lab: Lab) -> Lab:
    """The redundant IMU with its parameters open."""
    lab.without_scene()
    lab.page.get_by_label("Scenario").select_option("kim-2005")
    expect(lab.page.locator("ft-charts")).to_contain_text("Fault isolation FI")
    lab.page.get_by_role("button", name="Parameters …").click()
    expect(dialog(lab)).to_be_visible()
    return lab


def dialog(lab: Lab) -> Locator:
    return lab.page.get_by_role("dialog", name="Parameters")


def figure(lab: Lab, name: str) -> Locator:
    return dialog(lab).locator(".figures li", has_text=name)


def test_indices_follow_while_angles_are_typed(gyros: Lab) -> None:
    expect(figure(gyros, "J_FDI").locator("b")).to_have_text("4")
    mounting = dialog(gyros).get_by_label("Mounting, number 2")
    mounting.fill("30")
    expect(figure(gyros, "J_FDI").locator("b")).to_have_text("2.667")
    expect(figure(gyros, "J_FDI")).to_contain_text("was 4")
    asked = {"parameters": {"gyros": {"mounting": [45, 30, 45]}}}
    system = gyros.experiment()["system"]
    answer = {one["id"]: one for one in gyros.rest("POST", f"/systems/{system}/indicators", asked)}
    assert answer["fdi"]["value"] == pytest.approx(2.667, abs=5e-4)
    strip = figure(gyros, "Ambiguous faults of gyro 2").locator(".strip i")
    expect(strip).to_have_count(len(answer["ambiguous.2"]["map"]["bands"]))
    dialog(gyros).get_by_role("button", name="Set Mounting back to 45, 45, 45").click()
    expect(figure(gyros, "J_FDI").locator("b")).to_have_text("4")


def test_what_is_wrong_stands_at_its_field(gyros: Lab) -> None:
    gyros.refusals_expected = True
    before = gyros.id
    field = dialog(gyros).locator("[data-path='gyros.noise']")
    field.locator("input").fill("-3")
    expect(field.locator(".error")).to_contain_text("out of bounds")
    expect(field.locator("input")).to_have_attribute("aria-invalid", "true")
    dialog(gyros).get_by_role("button", name="Start a new experiment").click()
    expect(field.locator("input")).to_be_focused()
    field.locator("input").fill("0.01")
    expect(field.locator(".error")).to_be_hidden()
    legs = dialog(gyros).locator("[data-path='flight.legs']")
    legs.get_by_label("Legs, row 1: climb rate").fill("200")
    legs.get_by_label("Legs, row 1: bank").fill("70")
    dialog(gyros).get_by_label("Speed", exact=True).first.fill("350")
    dialog(gyros).get_by_label("Height", exact=True).first.fill("10000")
    expect(legs.locator(".error")).to_contain_text("cannot fly")
    expect(dialog(gyros)).to_be_visible()
    assert gyros.id == before


def test_a_new_experiment_has_them_and_the_old_one_stays(gyros: Lab) -> None:
    old = gyros.id
    dialog(gyros).get_by_label("Mounting, number 1").fill("30")
    dialog(gyros).get_by_label("Seed", exact=True).fill("77")
    dialog(gyros).get_by_role("button", name="Start a new experiment").click()
    expect(dialog(gyros)).to_be_hidden()
    expect(gyros.page.locator("ft-topbar .branches")).to_contain_text("Seed 77; Mounting 30, 45, 45")
    assert gyros.id != old
    document = gyros.rest("GET", f"/experiments/{gyros.id}/scenario")
    assert document["parameters"] == {"gyros": {"mounting": [30, 45, 45]}}
    assert document["seed"] == 77
    assert len(document["faults"]) == 2
    kept = gyros.rest("GET", f"/experiments/{old}/scenario")
    assert kept["parameters"] == {}


@pytest.mark.long
def test_every_system_has_its_form(lab: Lab) -> None:
    lab.without_scene()
    scenarios = lab.rest("GET", "/scenarios")
    for system in sorted({scenario["system"] for scenario in scenarios}):
        ready = next(s for s in scenarios if s["system"] == system)
        lab.page.get_by_label("Scenario", exact=True).select_option(ready["id"])
        title = lab.rest("GET", f"/systems/{system}")["title"]
        expect(lab.page.locator("ft-diagram h2")).to_have_text(title)
        lab.page.get_by_role("button", name="Parameters …").click()
        expect(dialog(lab)).to_be_visible()
        assert dialog(lab).locator(".field").count() > 5
        dialog(lab).get_by_label("Find a parameter").fill("latitude")
        dialog(lab).get_by_label("Find a parameter").fill("")
        told = lab.page.evaluate(
            """() => [...document.querySelectorAll('ft-parameters .field')].filter((f) => !f.querySelector('label'))"""
        )
        assert told == []
        dialog(lab).get_by_role("button", name="Close").click()


def test_the_scene_offers_its_pictures(gyros: Lab) -> None:
    dialog(gyros).get_by_role("button", name="Close").click()
    gyros.page.locator("ft-scene").get_by_role("button", name="show", exact=True).click()
    pictures = gyros.page.locator("ft-scene .pictures button")
    expect(pictures).to_have_count(3)
    with gyros.page.expect_request("**/cursor") as asked:
        pictures.filter(has_text="Flight paths").click()
    assert asked.value.post_data_json["picture"] == "Flight paths"
    legend = gyros.page.locator("ft-scene .legend")
    expect(legend).not_to_contain_text("gyro 1")
    gyros.fly_until(1.0)
    expect(legend).to_contain_text("healthy twin")
    expect(legend).not_to_contain_text("fault plane")
