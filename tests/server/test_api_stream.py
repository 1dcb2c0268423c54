"""The stream: what a viewer is told, how one that lags is spared, how one that was cut off goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from rest_lab import Flight, client_of, wait_until
from starlette.websockets import WebSocketDisconnect

from server.settings import Settings
from server.stream import MESSAGES_AT_ONCE, Credit

ERROR = "fused.error.position.x"
Message = dict[str, Any]


def until(socket: Any, wanted: Callable[[Message], bool], most: int = 400) -> list[Message]:
    """Messages up to the first that is wanted."""
    heard = []
    for _ in range(most):
        heard.append(socket.receive_json())
        if wanted(heard[-1]):
            return heard
    raise AssertionError(f"not heard in {most} messages: {[m['type'] for m in heard]}")


def of(kind: str) -> Callable[[Message], bool]:
    return lambda message: message["type"] == kind


def reaches(time: float) -> Callable[[Message], bool]:
    return lambda message: message["type"] == "frames" and message["time"][-1] >= time - 1e-9


def subscribe(socket: Any, *signals: str) -> None:
    socket.send_json({"type": "subscribe", "signals": list(signals)})


def times(messages: list[Message]) -> list[float]:
    return [time for message in messages if message["type"] == "frames" for time in message["time"]]


def test_hello_says_what_there_is(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        hello = socket.receive_json()
        watched = flight.get()
    assert (hello["type"], hello["history"]) == ("hello", 0)
    assert hello["experiment"] == watched
    assert watched["watchers"] == 1
    assert {"name", "label", "unit", "group", "factor"} <= set(hello["signals"][0])


def test_frames_carry_every_epoch_once_and_agree_with_the_series(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        subscribe(socket, ERROR, "gap")
        flight.advance(until=1.0)
        flight.advance(until=2.0)
        frames = [m for m in until(socket, reaches(2.0)) if m["type"] == "frames"]
    series = flight.get("/series", signals=ERROR)
    assert times(frames) == series["time"]
    assert [v for m in frames for v in m["signals"][ERROR]] == series["signals"][ERROR]
    assert {v for m in frames for v in m["signals"]["gap"]} == {None}


def test_events_state_and_view_are_told(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0})
        heard = until(socket, lambda m: m["type"] == "state" and m["faults"])
        event = next(m for m in heard if m["type"] == "event")
        assert (event["kind"], event["subject"], event["index"]) == ("fault.injected", "ruler", 0)
        assert heard[-1]["faults"][0]["state"] == "active"
        flight.advance(epochs=1)
        view = until(socket, lambda m: m["type"] == "view" and m["time"] > 0)[-1]
        assert view["blocks"]["ruler"]["health"] == "faulted"
        assert view["items"]["axis"]["health"] == "faulted"


def test_a_viewer_that_does_not_acknowledge_gets_three_frames_then_one_with_all_it_missed(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        subscribe(socket, ERROR)
        heard: list[Message] = []
        for k in range(1, 4):
            flight.advance(until=float(k))
            heard += until(socket, reaches(float(k)))
        for k in range(4, 20):
            flight.advance(until=float(k))
        flight.do("PATCH", "/subsystems/ruler", {"enabled": False})
        heard += until(socket, lambda m: m["type"] == "state" and not m["subsystems"]["ruler"]["enabled"])
        assert max(times(heard)) == 3.0

        socket.send_json({"type": "ack", "time": 3.0})

        merged = until(socket, of("frames"))[-1]
        assert merged["time"][0] == pytest.approx(3.1)
        assert merged["time"][-1] == 19.0


def test_what_a_lagging_viewer_missed_is_thinned_with_its_extremes(client: TestClient) -> None:
    flight = Flight(client, toy.scenario(duration=600.0))
    names = [f"extra.{i}" for i in range(100)]
    with client.websocket_connect(flight.stream) as socket:
        socket.receive_json()
        flight.advance(until=500.0)
        subscribe(socket, *names)
        merged = until(socket, of("frames"))[-1]
    full = flight.get("/series", signals="extra.99")
    assert len(merged["time"]) <= 520 < len(full["time"])
    assert (merged["time"][0], merged["time"][-1]) == (full["time"][0], 500.0)
    assert max(merged["signals"]["extra.99"]) == max(full["signals"]["extra.99"])
    assert min(merged["signals"]["extra.99"]) == min(full["signals"]["extra.99"])


def test_a_stalled_viewer_does_not_hold_anyone_up(flight: Flight) -> None:
    with (
        flight.client.websocket_connect(flight.stream) as stalled,
        flight.client.websocket_connect(flight.stream) as ok,
    ):
        subscribe(stalled, ERROR)
        subscribe(ok, ERROR)
        flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
        last = 0.0
        while last < 60.0:
            message = until(ok, of("frames"))[-1]
            last = message["time"][-1]
            ok.send_json({"type": "ack", "time": last})
    assert flight.get()["clock"]["state"] == "finished"


@pytest.mark.parametrize("since", [0.0, 1.0, 1.7])
def test_a_viewer_that_was_cut_off_goes_on_without_a_gap(flight: Flight, since: float) -> None:
    flight.advance(until=1.7)
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0})
    flight.advance(until=4.0)
    with flight.client.websocket_connect(f"{flight.stream}?since={since}") as socket:
        subscribe(socket, ERROR)
        flight.advance(until=5.0)
        heard = until(socket, reaches(5.0))
    wanted = [time for time in flight.get("/series", signals=ERROR)["time"] if time > since + 1e-9]
    assert times(heard) == wanted
    assert [m["index"] for m in heard if m["type"] == "event"] == [
        event["index"] for event in flight.get("/events") if event["time"] >= since - 1e-9
    ]


def test_what_was_done_while_a_viewer_was_away_is_told_even_if_no_time_went_by(flight: Flight) -> None:
    flight.advance(until=2.0)
    flight.do("PATCH", "/settings", {"threshold": 8.0})
    with flight.client.websocket_connect(f"{flight.stream}?since=2.0") as socket:
        assert until(socket, of("event"))[-1]["kind"] == "settings.changed"


def test_a_rewind_tells_the_viewer_to_truncate(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        subscribe(socket, ERROR)
        flight.advance(until=3.0)
        until(socket, reaches(3.0))
        flight.do("POST", "/rewind", {"to": 1.0})
        reset = until(socket, of("reset"))[-1]
        assert (reset["time"], reset["history"]) == (1.0, 1)
        flight.advance(until=2.0)
        assert times(until(socket, reaches(2.0)))[0] == pytest.approx(1.1)


def test_a_viewer_that_missed_a_rewind_is_told_when_it_returns(flight: Flight) -> None:
    flight.advance(until=3.0)
    flight.do("POST", "/rewind", {"to": 1.0})
    with flight.client.websocket_connect(f"{flight.stream}?since=3.0") as socket:
        assert until(socket, of("reset"))[-1]["time"] == 1.0
    flight.advance(until=4.0)
    with flight.client.websocket_connect(f"{flight.stream}?since=3.0&history=0") as socket:
        subscribe(socket, ERROR)
        heard = until(socket, reaches(4.0))
    assert next(m["time"] for m in heard if m["type"] == "reset") == 1.0
    assert times(heard)[0] == pytest.approx(1.1)


def test_a_viewer_of_a_deleted_experiment_is_sent_away(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        socket.receive_json()
        flight.do("DELETE", "")
        with pytest.raises(WebSocketDisconnect) as left:
            until(socket, lambda _: False)
    assert left.value.code == 4410


def test_a_viewer_of_no_experiment_is_sent_away(client: TestClient) -> None:
    with (
        client.websocket_connect("ws://127.0.0.1:8000/api/v1/experiments/none/stream") as socket,
        pytest.raises(WebSocketDisconnect) as left,
    ):
        socket.receive_json()
    assert left.value.code == 4404


@pytest.mark.parametrize(
    "message",
    ["", "{", "[]", '{"type":"advance"}', '{"type":"subscribe","signals":["nothing"]}', '{"type":"ack","time":"1"}',
     '{"type":"ack","time":1,"more":2}', '{"type":"ack","time":NaN}', "x" * 100_001],
)  # fmt: skip
def test_a_message_that_cannot_be_understood_ends_the_stream(flight: Flight, message: str) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        socket.send_text(message)
        with pytest.raises(WebSocketDisconnect) as left:
            until(socket, lambda _: False)
    assert left.value.code == 4400
    assert flight.get()["clock"]["state"] == "paused"


@pytest.mark.parametrize("since", ["x", "-1", "nan", "inf"])
def test_a_since_that_is_no_time_ends_the_stream(flight: Flight, since: str) -> None:
    with (
        flight.client.websocket_connect(f"{flight.stream}?since={since}") as socket,
        pytest.raises(WebSocketDisconnect) as left,
    ):
        socket.receive_json()
    assert left.value.code == 4400


def test_streams_are_capped() -> None:
    with client_of(Settings(streams_per_experiment=1)) as client:
        flight = Flight(client)
        with client.websocket_connect(flight.stream) as first:
            first.receive_json()
            with client.websocket_connect(flight.stream) as second, pytest.raises(WebSocketDisconnect) as left:
                second.receive_json()
    assert left.value.code == 4429


def test_a_viewer_that_floods_is_sent_away_and_of_its_subscriptions_the_newest_counts(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        for i in range(MESSAGES_AT_ONCE):
            subscribe(socket, f"extra.{i}")
        newest = [f"extra.{MESSAGES_AT_ONCE - 1}"]
        (viewer,) = flight.client.app.state.registry.get(flight.id).subscribers
        wait_until(lambda: viewer._names == newest)
        flight.advance(until=1.0)
        assert list(until(socket, reaches(1.0))[-1]["signals"]) == newest
    with flight.client.websocket_connect(flight.stream) as socket:
        for _ in range(3 * MESSAGES_AT_ONCE):
            subscribe(socket, ERROR)
        with pytest.raises(WebSocketDisconnect) as left:
            until(socket, lambda _: False)
    assert (left.value.code, left.value.reason) == (1008, "more than 50 messages a second")
    assert flight.get()["watchers"] == 0


def test_sockets_of_one_client_are_capped_over_all_experiments() -> None:
    with client_of(Settings(sockets_per_client=2)) as client:
        flights = [Flight(client) for _ in range(3)]
        with client.websocket_connect(flights[0].stream), client.websocket_connect(flights[1].stream):
            with client.websocket_connect(flights[2].stream) as third, pytest.raises(WebSocketDisconnect) as left:
                third.receive_json()
            assert left.value.code == 4429
        with client.websocket_connect(flights[2].stream) as again:
            assert again.receive_json()["type"] == "hello"


def test_credit_counts_frames_under_way_even_when_time_goes_back() -> None:
    credit = Credit()
    for time in (5.0, 1.0, 2.0):
        assert credit.left
        credit.sent(time)
    assert not credit.left
    credit.acknowledged(1.0)  # acknowledges 5.0, sent before it, too
    assert credit.left
    credit.sent(3.0)
    credit.acknowledged(2.5)  # a time between two frames
    credit.sent(4.0)
    assert credit.left
