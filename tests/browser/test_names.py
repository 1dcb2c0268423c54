"""Names in the 3-D scene: none overlaps another, the abnormal come first, the rest when asked for."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import pytest
from playwright.sync_api import Page

ARRANGE = """async ([items, view, choice, asked, camera, size]) => {
  const { arranged, nameable } = await import('/static/labels.js');
  const named = nameable(items, view, choice, { families: new Set(asked.families), item: asked.item });
  return arranged(named, camera, size, choice, (text) => 6.5 * text.length);
}"""
PROJECT = """async ([camera, size, point]) => (await import('/static/labels.js')).projected(camera, size, point)"""
LINE = 14.0
SMALL, LARGE = {"width": 350, "height": 140}, {"width": 1280, "height": 500}
NOBODY: dict[str, Any] = {"families": [], "item": None}


def camera(azimuth: float, elevation: float = 0.5, distance: float = 6.0) -> dict[str, Any]:
    """One that looks at the origin: right, down and ahead as the columns of its rotation, as viser tells of it."""
    away = (math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation))
    ahead = tuple(-part for part in away)
    right = (ahead[1] / math.cos(elevation), -ahead[0] / math.cos(elevation), 0.0)
    down = (
        ahead[1] * right[2] - ahead[2] * right[1],
        ahead[2] * right[0] - ahead[0] * right[2],
        ahead[0] * right[1] - ahead[1] * right[0],
    )
    w = 0.5 * math.sqrt(max(1e-12, 1.0 + right[0] + down[1] + ahead[2]))
    turn = (w, (down[2] - ahead[1]) / (4 * w), (ahead[0] - right[2]) / (4 * w), (right[1] - down[0]) / (4 * w))
    return {"wxyz": turn, "position": [distance * part for part in away], "fov": math.radians(50.0)}


def sky(faulted: str = "", isolated: str = "") -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """24 satellites in a heap, six axes and three spins of instruments."""
    items, seen = [], {}

    def add(name: str, kind: str, frame: str, family: str, vector: tuple[float, float, float]) -> None:
        items.append({"id": name, "label": name, "kind": kind, "frame": frame, "family": family, "picture": ""})
        health = "faulted" if name == faulted else "isolated" if name == isolated else "ok"
        seen[name] = {"vector": vector, "health": health, "visible": True}

    for i in range(24):
        turn, rise = 0.26 * i, 0.3 + 0.05 * (i % 7)
        level = 1.6 * math.cos(rise)
        add(
            f"S{i}",
            "line-of-sight",
            "level",
            "satellites",
            (level * math.sin(turn), level * math.cos(turn), 1.6 * rise),
        )
    for i in range(3):
        turn = math.radians(120.0 * i)
        for axis, lean in (("x", 0.3), ("y", -0.3)):
            add(f"{i}{axis}", "axis", "body", f"instrument {i}", (math.cos(turn + lean), math.sin(turn + lean), 0.4))
        add(f"spin {i}", "spin", "body", f"instrument {i}", (0.5 * math.cos(turn), 0.5 * math.sin(turn), -0.4))
    return items, {"time": 1.0, "blocks": {}, "items": seen}


@pytest.mark.parametrize("choice", ["important", "all"])
@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_given_a_crowd_when_it_is_seen_from_any_side_then_no_two_names_overlap(
    plain: Page, size: dict[str, int], choice: str
) -> None:
    items, view = sky(faulted="S3", isolated="S4")
    for azimuth in (-2.4, -0.8, 0.4, 1.9):
        told = plain.evaluate(ARRANGE, [items, view, choice, NOBODY, camera(azimuth), size])
        for a, b in combinations(told["placed"], 2):
            apart = abs(a["x"] - b["x"]) >= 0.5 * (a["width"] + b["width"]) or abs(a["y"] - b["y"]) >= LINE
            assert apart, (azimuth, a["text"], b["text"])
        names = {p["text"] for p in told["placed"]}
        assert {"S3 fault", "(S4)"} <= names
        assert len(names) >= (5 if size is SMALL else 24)
        assert len(names) + told["left"] <= len(items) + 2


def test_what_is_pointed_at_is_named_first_whatever_is_chosen(plain: Page) -> None:
    items, view = sky()
    item, family = {"families": [], "item": "S7"}, {"families": ["instrument 1"], "item": None}
    for asked, names in ((item, {"S7"}), (family, {"1x", "1y", "spin 1"})):
        told = plain.evaluate(ARRANGE, [items, view, "none", asked, camera(0.4), LARGE])
        assert {p["text"] for p in told["placed"]} == names
    assert plain.evaluate(ARRANGE, [items, view, "none", NOBODY, camera(0.4), LARGE])["placed"] == []


def test_a_point_is_seen_where_the_camera_has_it(plain: Page) -> None:
    ahead = camera(0.0, elevation=0.0, distance=4.0)
    scale = 250.0 / math.tan(math.radians(25.0)) / 4.0
    assert plain.evaluate(PROJECT, [ahead, LARGE, [0, 0, 0]]) == pytest.approx([640.0, 250.0])
    assert plain.evaluate(PROJECT, [ahead, LARGE, [0, 0, 1]]) == pytest.approx([640.0, 250.0 - scale])
    assert plain.evaluate(PROJECT, [ahead, LARGE, [0, 1, 0]]) == pytest.approx([640.0 + scale, 250.0])
    assert plain.evaluate(PROJECT, [ahead, LARGE, [5, 0, 0]]) is None
