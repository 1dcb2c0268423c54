"""A scene of several pictures: one is drawn at a time, and a path is known from its start."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import viser
from fastapi.testclient import TestClient
from rest_lab import Flight

from ftcore.description import ItemView, SceneItem, View
from server.scene import Scene

ITEMS = (
    SceneItem(id="axis", label="axis", kind="axis", family="axes", picture="Axes"),
    SceneItem(id="ball", label="ball", kind="ball", frame="own", family="ball", picture="Space"),
    SceneItem(id="plane", label="plane", kind="plane", frame="own", family="plane", picture="Space"),
    SceneItem(id="path", label="path", kind="path", frame="level", family="path", picture="Ways"),
)
SEEN = View(
    time=3.0,
    blocks={},
    items={
        "axis": ItemView(vector=(1.0, 0.0, 0.0)),
        "ball": ItemView(vector=(0.0, 0.0, 2.0)),
        "plane": ItemView(vector=(0.0, 1.0, 0.0)),
        "path": ItemView(vector=(0.0, 0.3, 0.0)),
    },
)


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def visible(scene: Scene) -> dict[str, bool]:
    parts: Any = scene._drawn
    return {
        "axis": parts["axis"]._arrow.visible,
        "ball": parts["ball"]._ball.visible,
        "plane": parts["plane"]._patch.visible,
        "path": parts["path"]._line.visible,
    }


def test_only_the_chosen_picture_is_drawn(server: viser.ViserServer) -> None:
    scene = Scene(server, ITEMS)
    trail = {"path": np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]])}
    for picture, shown in (("Axes", {"axis"}), ("Space", {"ball", "plane"}), ("Ways", {"path"}), ("Axes", {"axis"})):
        scene.show(SEEN, picture, trail if picture == "Ways" else None)
        assert {name for name, seen in visible(scene).items() if seen} == shown
        assert all(part.visible == (picture == "Ways") for part in scene._ground)


def test_a_path_is_drawn_from_its_start_however_late_one_looks(server: viser.ViserServer) -> None:
    scene = Scene(server, ITEMS)
    trail = np.stack([np.zeros(50), np.linspace(0.0, 2.0, 50), np.zeros(50)], axis=-1)
    scene.show(SEEN, "Ways", {"path": trail})
    line: Any = scene._drawn["path"]
    np.testing.assert_allclose(line._line.points[0, 0], trail[0])
    np.testing.assert_allclose(line._line.points[-1, 1], trail[-1])
    assert line._line.points.shape == (49, 2, 3)


def test_the_camera_stands_where_a_way_is_seen_and_stays_there_for_a_while(server: viser.ViserServer) -> None:
    scene = Scene(server, ITEMS)
    ways = [np.linspace([0.0, 0.0, 0.0], [0.0, end, 0.1], 9) for end in (2.0, 2.1, 6.0)]
    stood = []
    for way in ways:
        scene.show(SEEN, "Ways", {"path": way})
        stood.append(np.array(server.initial_camera.position))
        looks_at = np.array(server.initial_camera.look_at)
        assert 0.0 < looks_at[1] < way[-1, 1]
    np.testing.assert_array_equal(stood[0], stood[1])
    assert np.linalg.norm(stood[2]) > 1.5 * np.linalg.norm(stood[1])


def test_a_picture_that_is_not_there_is_refused(client: TestClient, flight: Flight) -> None:
    answer = client.put(f"{flight.path}/cursor", json={"time": None, "picture": "no such"})
    assert answer.status_code == 409
    assert "no picture 'no such'" in answer.json()["detail"]
    assert client.put(f"{flight.path}/cursor", json={"time": None, "picture": ""}).status_code == 200
