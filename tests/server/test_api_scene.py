"""The 3-D scene: on the page's origin, drawn for every kind of item, and deaf to all but the camera."""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
import toy_system as toy
import viser
import zstandard
from fastapi.testclient import TestClient
from rest_lab import Flight, client_of, wait_until
from starlette.websockets import WebSocketDisconnect
from viser import _messages as viser_messages
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect

from ftcore.description import ItemView
from server import shapes
from server.scene import HEALTH, Scene
from server.scene_proxy import MESSAGES_AT_ONCE, passed
from server.settings import Settings

PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [1.0, 1.0, 1.0], "fov": 1.0, "near": 0.01,
    "far": 100.0, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0], "image_height": 100, "image_width": 100,
}  # fmt: skip


def decoded(frame: bytes) -> list[dict[str, Any]]:
    """Messages in one of viser's frames."""
    length = int.from_bytes(frame[8:16], "little")
    payload = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + length])
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(payload)["messages"]
    return messages


def backlog(socket: Any) -> list[dict[str, Any]]:
    """Everything a new client is sent."""
    heard: list[dict[str, Any]] = []
    while not any(message["type"] == "ReplayDoneMessage" for message in heard):
        heard += decoded(socket.receive_bytes())
    return heard


def address(flight: Flight) -> str:
    return f"ws://127.0.0.1:8000/experiments/{flight.id}/scene"


def scene_of(client: TestClient, flight: Flight) -> Any:
    return client.app.state.scenes._open[flight.id].result()  # type: ignore[attr-defined]


def test_the_client_is_one_page_with_its_panels_hidden(flight: Flight) -> None:
    answer = flight.client.get(f"/experiments/{flight.id}/scene/?darkMode")
    assert answer.status_code == 200
    assert "[data-floating-window]" in answer.text
    policy = answer.headers["content-security-policy"]
    assert "worker-src blob:" in policy
    assert "frame-ancestors 'self'" in policy
    again = flight.client.get(f"/experiments/{flight.id}/scene/", headers={"if-none-match": answer.headers["etag"]})
    assert again.status_code == 304
    moved = flight.client.get(f"/experiments/{flight.id}/scene?darkMode", follow_redirects=False)
    assert moved.headers["location"] == f"/experiments/{flight.id}/scene/?darkMode"
    assert flight.client.get("/experiments/none/scene/").status_code == 404


@pytest.mark.parametrize("end", ["", "/"])
def test_the_socket_comes_up_with_visers_subprotocol_and_the_whole_scene(flight: Flight, end: str) -> None:
    with flight.client.websocket_connect(address(flight) + end, subprotocols=[PROTOCOL]) as socket:
        assert socket.accepted_subprotocol == PROTOCOL
        heard = backlog(socket)
    kinds = {message["type"] for message in heard}
    assert {"ArrowMessage", "MeshMessage", "LineSegmentsMessage", "IcosphereMessage"} <= kinds
    theme = next(message for message in heard if message["type"] == "ThemeConfigurationMessage")
    assert theme["dark_mode"] is False  # ?darkMode darkens it, in the client
    assert theme["show_share_button"] is False


def test_an_epoch_flown_is_seen(flight: Flight) -> None:
    with flight.client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 9.0})
        flight.advance(epochs=1)
        coloured: list[Any] = []
        while not coloured:
            coloured = [m for m in decoded(socket.receive_bytes()) if "colors" in m.get("updates", {})]
    assert {message["name"] for message in coloured} == {"/body/item0"}, "the axis of the channel that is broken"


def test_the_cursor_moves_the_scene_to_a_past_moment(flight: Flight) -> None:
    flight.advance(until=10.0)
    with flight.client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        flight.do("PUT", "/cursor", {"time": 2.0})
        turned: list[Any] = []
        while not turned:
            turned = [
                m
                for m in decoded(socket.receive_bytes())
                if m["type"] == "SetOrientationMessage" and m["name"] == "/body"
            ]
    assert turned[-1]["wxyz"][3] == pytest.approx(0.0998, abs=1e-3)  # half of 0.2 rad


@pytest.mark.parametrize(
    "message",
    [
        {"type": "ShareUrlRequest"},
        {"type": "ShareUrlDisconnect"},
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {}},
        {"type": "FileTransferStartUpload"},
        {"type": "RunJavascriptMessage", "source": "1"},
        {"type": "CommandTriggerMessage", "uuid": "x"},
        {"type": ["ViewerCameraMessage"]},
        {"kind": "ViewerCameraMessage"},
        [{"type": "ViewerCameraMessage"}],
    ],
)
def test_what_is_not_the_camera_does_not_pass(message: Any) -> None:
    assert passed(msgspec.msgpack.encode(message)) is None


def test_the_camera_passes_and_rubbish_does_not() -> None:
    heard = passed(msgspec.msgpack.encode(CAMERA | {"more": {"type": "ShareUrlRequest"}}))
    assert heard is not None
    assert msgspec.msgpack.decode(heard) == CAMERA
    assert viser_messages.Message.deserialize(heard).fov == 1.0  # type: ignore[attr-defined]
    for rubbish in (b"", b"\xc1", b"ViewerCameraMessage", msgspec.msgpack.encode(CAMERA | {"more": "x" * 100_000})):
        assert passed(rubbish) is None


@pytest.mark.parametrize(
    "wrong",
    [{"fov": None}, {"fov": "1"}, {"position": [1.0, 1.0]}, {"position": [1.0, 1.0, 1.0, 1.0]}, {"wxyz": "abcd"},
     {"wxyz": [1.0, 0.0, 0.0, float("nan")]}, {"look_at": [float("inf"), 0.0, 0.0]}, {"look_at": {}}, {"near": [[[]]]},
     *({name: ...} for name in CAMERA if name != "type")],
)  # fmt: skip
def test_a_camera_that_is_none_is_dropped_and_viser_prints_nothing(
    client: TestClient, flight: Flight, capfd: pytest.CaptureFixture[str], wrong: dict[str, Any]
) -> None:
    message = {name: value for name, value in (CAMERA | wrong).items() if value is not ...}
    assert passed(msgspec.msgpack.encode(message)) is None


def test_what_was_dropped_is_one_line_in_the_log_however_much_it_was(
    client: TestClient, flight: Flight, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        for _ in range(50):
            socket.send_bytes(msgspec.msgpack.encode(CAMERA | {"position": "x"}))
        socket.send_bytes(msgspec.msgpack.encode(CAMERA))
        wait_until(lambda: len(scene_of(client, flight)._server.get_clients()) == 1)
    wait_until(lambda: len(caplog.records) == 1)
    assert "sent 50 messages" in caplog.records[0].getMessage()
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_browser_that_floods_the_scene_is_sent_away(client: TestClient, flight: Flight) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        for _ in range(MESSAGES_AT_ONCE + 200):
            socket.send_bytes(b"")
        with pytest.raises(WebSocketDisconnect) as left:
            [socket.receive_bytes() for _ in range(1000)]
    assert left.value.code == 1008


def test_scenes_are_capped() -> None:
    with client_of(Settings(streams_per_experiment=1)) as client:
        flight = Flight(client)
        with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as first:
            backlog(first)
            with (
                pytest.raises(WebSocketDisconnect) as left,
                client.websocket_connect(address(flight), subprotocols=[PROTOCOL]),
            ):
                pass
    assert left.value.code == 1008


def test_forbidden_messages_are_dropped_and_the_socket_lives_on(client: TestClient, flight: Flight) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        server = scene_of(client, flight)._server
        shared: list[Any] = []
        server.request_share_url = lambda *_, **__: shared.append(1)
        socket.send_bytes(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        socket.send_text("hello")
        socket.send_bytes(msgspec.msgpack.encode(CAMERA))
        wait_until(lambda: len(server.get_clients()) == 1)  # viser knows of a client once its camera was heard
        assert not shared


def test_visers_own_port_takes_nobody_but_the_proxy(client: TestClient, flight: Flight) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        scene = scene_of(client, flight)
        server = scene._server
        known = server._websock_server._client_state_from_id
        before = set(known)
        with connect(f"ws://127.0.0.1:{scene.port}/", subprotocols=[PROTOCOL]) as stranger:  # type: ignore[list-item]
            with pytest.raises(ConnectionClosedError) as closed:
                stranger.recv(timeout=60.0)  # the first thing it hears
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1008
        wait_until(lambda: set(known) == before)


def test_viser_cannot_be_asked_for_a_tunnel(client: TestClient, flight: Flight) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        handlers = scene_of(client, flight)._server._websock_server._incoming_handlers
    assert not [kind.__name__ for kind in handlers if kind.__name__ == "ShareUrlRequest"]


def test_a_deleted_experiment_takes_its_scene_along(client: TestClient, flight: Flight) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
        port = scene_of(client, flight).port
        flight.do("DELETE", "")
        with pytest.raises(WebSocketDisconnect):
            [socket.receive_bytes() for _ in range(1000)]
    with pytest.raises(ConnectionRefusedError):
        connect(f"ws://127.0.0.1:{port}/", open_timeout=60.0)


def test_a_scene_nobody_looks_at_is_not_drawn(client: TestClient, flight: Flight) -> None:
    with client.websocket_connect(address(flight), subprotocols=[PROTOCOL]) as socket:
        backlog(socket)
    scene = scene_of(client, flight)
    wait_until(lambda: scene.viewers == 0)
    drawn: list[Any] = []
    scene._scene.show = drawn.append
    flight.advance(epochs=5)
    time.sleep(0.3)
    assert drawn == []


# ---- drawing ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def test_health_overrides_the_familys_colour(server: viser.ViserServer) -> None:
    scene = Scene(server, toy.DESCRIPTION.scene)
    view = toy.Reporter().view(0.0, None, None, None, frozenset())  # type: ignore[arg-type]
    for kind in ("plane", "aircraft"):
        for health, colour in HEALTH.items():
            item = view.items[kind].model_copy(update={"health": health})
            scene.show(view.model_copy(update={"items": {kind: item}}))
            drawn: Any = scene._drawn[kind]
            assert tuple((drawn._patch if kind == "plane" else drawn._hull).color) == colour


def test_what_has_not_changed_is_not_sent_again(server: viser.ViserServer) -> None:
    scene = Scene(server, toy.DESCRIPTION.scene)
    view = toy.Reporter().view(1.0, None, None, None, frozenset())  # type: ignore[arg-type]
    scene.show(view)
    shown: list[str] = []
    for name, drawn in scene._drawn.items():
        drawn.show = lambda item, time, name=name: shown.append(name)  # type: ignore[method-assign,misc]
    scene.show(view.model_copy(update={"items": view.items | {"spin": ItemView(vector=(0.0, 0.0, 1.0))}}))
    assert set(shown) == {"spin", "path"}  # a path also has to know the time


def test_a_path_is_cut_when_time_goes_back(server: viser.ViserServer) -> None:
    scene = Scene(server, toy.DESCRIPTION.scene)
    drawn: Any = scene._drawn["path"]
    for t in (1.0, 2.0, 3.0, 4.0, 2.0):
        drawn.show(ItemView(vector=(t, 0.0, 0.0)), t)
    assert [time for time, _ in drawn._way] == [1.0, 2.0]
    assert drawn._line.points.shape == (1, 2, 3)


def test_the_camera_steps_back_for_what_reaches_far(server: viser.ViserServer) -> None:
    scene = Scene(server, toy.DESCRIPTION.scene)
    near = server.initial_camera.position
    view = toy.Reporter().view(1.0, None, None, None, frozenset())  # type: ignore[arg-type]
    far = view.items | {"line-of-sight": ItemView(vector=(0.0, 0.0, 9.0))}
    scene.show(view.model_copy(update={"items": far}))
    assert (server.initial_camera.position**2).sum() > (near**2).sum() * 4


@pytest.mark.parametrize("aspect", [0.8, 1.0, 1.3, 2.0])
@pytest.mark.parametrize("reach", [1.5, 2.0, 2.5])
def test_the_whole_sky_is_seen_in_a_picture_of_any_shape(
    server: viser.ViserServer, aspect: float, reach: float
) -> None:
    scene = Scene(server, toy.DESCRIPTION.scene)
    view = toy.Reporter().view(1.0, None, None, None, frozenset())  # type: ignore[arg-type]
    scene.show(view.model_copy(update={"items": {"line-of-sight": ItemView(vector=(0.0, 0.0, reach))}}))
    standing = server.initial_camera
    camera = SimpleNamespace(aspect=aspect, fov=standing.fov, position=standing.position, look_at=standing.look_at)
    scene._welcome(SimpleNamespace(camera=camera))
    elevation, azimuth = np.radians(np.meshgrid(np.arange(5.0, 91.0, 5.0), np.arange(0.0, 360.0, 10.0)))
    level = reach * np.cos(elevation)
    sky = np.stack([level * np.sin(azimuth), level * np.cos(azimuth), reach * np.sin(elevation)], axis=-1)
    ahead = np.array(camera.look_at) - np.array(camera.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    offset = sky - np.array(camera.position)
    depth, half = offset @ ahead, np.tan(0.5 * camera.fov)
    assert (depth > 0.0).all()
    assert (np.abs(offset @ right) <= 1.001 * half * aspect * depth).all()
    assert (np.abs(offset @ np.cross(right, ahead)) <= 1.001 * half * depth).all()


@pytest.mark.parametrize("vector", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0), (1.0, 2.0, -0.5), (0.0, 0.0, 0.0)])
def test_a_patch_faces_along_its_normal(vector: tuple[float, float, float]) -> None:
    w, x, y, z = shapes.turn_z_to(vector)
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
    length = sum(part * part for part in vector) ** 0.5
    turned = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    wanted = tuple(part / length for part in vector) if length else (0.0, 0.0, 1.0)
    assert turned == pytest.approx(wanted, abs=1e-12)
