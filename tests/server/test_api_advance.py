"""An advance can be stopped: by a paused clock, a rewind, a deletion, a client that hangs up, the end of the server."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import httpx
import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from gate import PATIENCE, Gate
from rest_lab import API, Flight, Served, served, wait_until

PROBLEM = "application/problem+json"
FAULT = {"channel": "ruler.position.x", "kind": "bias", "magnitude": 40.0}


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Iterator[Gate]:
    """Epoch 5 (0.5 s) and all later ones wait."""
    gate = Gate(monkeypatch, first=5)
    yield gate
    gate.open()


@pytest.fixture
def aside() -> Iterator[ThreadPoolExecutor]:
    """Requests that are answered later."""
    with ThreadPoolExecutor(4) as pool:
        yield pool


def experiment(flight: Flight) -> Any:
    return flight.client.app.state.registry.get(flight.id)


def queued(flight: Flight, number: int) -> None:
    """Wait until so many have the simulation or stand in line for it."""
    wait_until(lambda: experiment(flight)._turns.taken >= number, PATIENCE)


def advancing(flight: Flight, gate: Gate, aside: ThreadPoolExecutor, **how: Any) -> Future[Any]:
    """An advance that has flown 0.4 s and stands at the gate of epoch 5."""
    answer = aside.submit(flight.ask, "POST", "/advance", how or {"until": 3.0})
    gate.arrival()
    return answer


def stopped(flight: Flight, why: str) -> None:
    wait_until(lambda: experiment(flight)._advance.stopped == why, PATIENCE)


def test_while_it_flies_the_clock_says_so(flight: Flight, gate: Gate, aside: ThreadPoolExecutor) -> None:
    answer = advancing(flight, gate, aside)
    seen = aside.submit(flight.get)
    queued(flight, 2)
    gate.let()
    gate.arrival()
    assert (seen.result()["clock"]["state"], seen.result()["clock"]["epoch"]) == ("advancing", 5)
    gate.open()
    assert answer.result().json()["experiment"]["clock"]["state"] == "paused"
    assert flight.get()["clock"]["epoch"] == 30


def test_a_paused_clock_stops_it_after_the_epoch_under_way(
    flight: Flight, gate: Gate, aside: ThreadPoolExecutor
) -> None:
    answer = advancing(flight, gate, aside)
    paused = aside.submit(flight.do, "PATCH", "/clock", {"state": "paused"})
    stopped(flight, "paused")
    gate.open()
    clock = paused.result()["clock"]
    assert (clock["state"], clock["epoch"]) == ("paused", 5)
    assert (answer.result().status_code, answer.result().headers["content-type"]) == (409, PROBLEM)
    assert "paused at 0.5 s, before the goal at 3 s" in answer.result().json()["detail"]
    assert flight.get()["clock"] == clock
    assert flight.advance(until=3.0)["experiment"]["clock"]["epoch"] == 30


def test_a_rewind_is_not_overrun(flight: Flight, gate: Gate, aside: ThreadPoolExecutor) -> None:
    answer = advancing(flight, gate, aside)
    rewound = aside.submit(flight.do, "POST", "/rewind", {"to": 0.2})
    queued(flight, 2)
    gate.open()
    assert (rewound.result()["clock"]["state"], rewound.result()["clock"]["epoch"]) == ("paused", 2)
    assert (answer.result().status_code, answer.result().headers["content-type"]) == (409, PROBLEM)
    assert "rewound" in answer.result().json()["detail"]
    assert flight.get()["clock"]["epoch"] == 2
    assert len(flight.get("/series", signals="gap")["time"]) == 2


def test_a_rewind_that_is_refused_stops_nothing(flight: Flight, gate: Gate, aside: ThreadPoolExecutor) -> None:
    answer = advancing(flight, gate, aside)
    refused = aside.submit(flight.ask, "POST", "/rewind", {"to": 50.0})
    queued(flight, 2)
    gate.open()
    assert refused.result().status_code == 409
    assert answer.result().json()["experiment"]["clock"]["epoch"] == 30


def test_a_deletion_ends_it_and_is_not_answered_as_if_it_had_arrived(
    flight: Flight, gate: Gate, aside: ThreadPoolExecutor
) -> None:
    answer, there = advancing(flight, gate, aside), experiment(flight)
    deleted = aside.submit(flight.ask, "DELETE", "")
    wait_until(lambda: there.closed, PATIENCE)
    gate.open()
    assert deleted.result().status_code == 204
    assert (answer.result().status_code, answer.result().headers["content-type"]) == (410, PROBLEM)
    assert "deleted" in answer.result().json()["detail"]


@pytest.mark.parametrize(
    ("method", "what", "body"),
    [
        ("POST", "/faults", FAULT),
        ("DELETE", "/faults", None),
        ("PATCH", "/settings", {"threshold": 5.0}),
        ("PATCH", "/subsystems/ruler", {"enabled": False}),
        ("POST", "/rewind", {"to": 0.0}),
    ],
)
def test_a_command_whose_experiment_is_deleted_while_it_waits_is_not_answered_as_if_it_were_done(
    flight: Flight, gate: Gate, aside: ThreadPoolExecutor, method: str, what: str, body: Any
) -> None:
    answer, there = advancing(flight, gate, aside), experiment(flight)
    command = aside.submit(flight.ask, method, what, body)
    queued(flight, 2)
    deleted = aside.submit(flight.ask, "DELETE", "")
    wait_until(lambda: there.closed, PATIENCE)
    gate.open()
    assert [each.result().status_code for each in (answer, command, deleted)] == [410, 410, 204]


def test_a_second_one_is_refused_and_so_is_a_running_clock(
    flight: Flight, gate: Gate, aside: ThreadPoolExecutor
) -> None:
    answer = advancing(flight, gate, aside)
    for method, what, body in (
        ("POST", "/advance", {"epochs": 1}),
        ("POST", "/advance", {}),
        ("PATCH", "/clock", {"state": "running"}),
    ):
        refused = flight.ask(method, what, body)
        assert refused.status_code == 409
        assert "an advance to 3 s flies already" in refused.json()["detail"]
    faster = aside.submit(flight.do, "PATCH", "/clock", {"speed": 50})
    gate.open()
    assert faster.result()["clock"]["speed"] == 50
    assert answer.result().json()["experiment"]["clock"]["epoch"] == 30


def test_a_running_clock_leaves_the_flight_to_it_and_goes_on_from_its_goal(
    flight: Flight, gate: Gate, aside: ThreadPoolExecutor
) -> None:
    flight.do("PATCH", "/clock", {"state": "running", "speed": 0.5})
    answer = advancing(flight, gate, aside)
    gate.open()
    clock = answer.result().json()["experiment"]["clock"]
    assert (clock["state"], clock["epoch"]) == ("running", 30)
    wait_until(lambda: flight.get()["clock"]["epoch"] > 31, PATIENCE)


def test_a_fault_given_meanwhile_acts_from_its_epoch_on_and_replays_to_the_same_bits(
    client: TestClient, flight: Flight, gate: Gate, aside: ThreadPoolExecutor
) -> None:
    answer = advancing(flight, gate, aside)
    given = aside.submit(flight.do, "POST", "/faults", FAULT)
    queued(flight, 2)
    setting = aside.submit(flight.do, "PATCH", "/settings", {"threshold": 9.0})
    queued(flight, 3)
    gate.open()
    assert given.result()["start"] == 0.5
    assert setting.result()["settings"] == {"threshold": 9.0}
    assert answer.result().status_code == 200
    again = Flight(client, flight.get("/scenario"))
    assert again.advance(until=3.0)["latest"] == answer.result().json()["latest"]
    assert again.get("/series") == flight.get("/series")
    assert [e["time"] for e in again.get("/events")] == [e["time"] for e in flight.get("/events")]


def test_a_ghost_that_flies_is_ended_by_its_deletion_and_its_maker_is_told(
    client: TestClient, flight: Flight, monkeypatch: pytest.MonkeyPatch, aside: ThreadPoolExecutor
) -> None:
    flight.advance(until=3.0)
    gate = Gate(monkeypatch, first=5)
    answer = aside.submit(flight.ask, "POST", "/ghost")
    gate.arrival()
    ghost = next(one for one in client.app.state.registry.all() if one.ghost_of)  # type: ignore[attr-defined]
    deleted = aside.submit(client.delete, f"{API}/experiments/{ghost.id}")
    wait_until(lambda: ghost.closed, PATIENCE)
    gate.open()
    assert deleted.result().status_code == 204
    assert answer.result().status_code == 410
    assert [one["id"] for one in client.get(f"{API}/experiments").json()] == [flight.id]


# ---- over the network: clients that hang up, and the end of the server -----------------------------------------------


@pytest.fixture(scope="module")
def _server() -> Iterator[Served]:
    with served() as server:
        yield server


@pytest.fixture
def server(_server: Served) -> Iterator[Served]:
    """One server for those who hang up; each finds it without experiments."""
    yield _server
    with httpx.Client(base_url=_server.base, timeout=PATIENCE) as client:
        for experiment in experiments_of(_server):
            client.delete(f"{API}/experiments/{experiment.id}")


def request(server: Served, method: str, path: str, body: Any) -> socket.socket:
    """A request that nobody waits for."""
    content = json.dumps(body).encode()
    head = f"{method} {path} HTTP/1.1\r\nhost: 127.0.0.1:{server.port}\r\ncontent-type: application/json\r\n"
    client = socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE)
    client.sendall(f"{head}content-length: {len(content)}\r\n\r\n".encode() + content)
    return client


def answer_on(client: socket.socket) -> tuple[int, str, Any]:
    """Status, media type and body of what comes back before the server hangs up."""
    heard = b""
    while part := client.recv(65536):
        heard += part
    head, _, body = heard.partition(b"\r\n\r\n")
    kind = next(line.split(b": ")[1] for line in head.split(b"\r\n") if line.lower().startswith(b"content-type"))
    return int(head.split()[1]), kind.decode(), json.loads(body)


def experiments_of(server: Served) -> list[Any]:
    found: list[Any] = server.app.state.registry.all()
    return found


@pytest.mark.parametrize("what", ["advance", "ghost"])
def test_a_client_that_hangs_up_leaves_nothing_flying(
    server: Served, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    with httpx.Client(base_url=server.base, timeout=PATIENCE) as client:
        flight = Flight(client)
        if what == "ghost":
            flight.advance(until=3.0)
        gate = Gate(monkeypatch, first=5)
        caller = request(server, "POST", f"{flight.path}/{what}", {"until": 30.0} if what == "advance" else {})
        gate.arrival()
        flying = next(one for one in experiments_of(server) if one._advance is not None)
        caller.close()
        wait_until(lambda: flying._advance.stopped == "gone", PATIENCE)
        gate.open()
        wait_until(lambda: flying._advance is None, PATIENCE)
        assert flying._simulation.epoch == 5
        wait_until(lambda: len(experiments_of(server)) == 1, PATIENCE)
        assert flight.get()["clock"]["state"] == "paused"


@pytest.mark.parametrize("what", ["", "/fork"])
def test_an_experiment_made_for_a_client_that_hung_up_is_not_kept(
    server: Served, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    begun, go_on, assemble = threading.Event(), threading.Event(), toy.Toy.assemble

    def slowly(*arguments: Any) -> Any:
        begun.set()
        assert go_on.wait(PATIENCE)
        return assemble(*arguments)

    with httpx.Client(base_url=server.base, timeout=PATIENCE) as client:
        flight = Flight(client)
        monkeypatch.setattr(toy.Toy, "assemble", slowly)
        path = flight.path if what else f"{API}/experiments"
        caller = request(server, "POST", f"{path}{what}", {} if what else {"scenario": toy.scenario()})
        assert begun.wait(PATIENCE)
        caller.close()
        wait_until(lambda: len(server.server.server_state.connections) <= 1, PATIENCE)
        go_on.set()
        wait_until(lambda: not server.app.state.registry.making, PATIENCE)
        wait_until(lambda: len(experiments_of(server)) == 1, PATIENCE)


def test_the_end_of_the_server_is_told_to_whoever_waits_for_a_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    with served() as server, httpx.Client(base_url=server.base, timeout=PATIENCE) as client:
        flight = Flight(client)
        gate = Gate(monkeypatch, first=5)
        caller = request(server, "POST", f"{flight.path}/advance", {"until": 30.0})
        gate.arrival()
        flying = experiments_of(server)[0]
        server.server.should_exit = True
        wait_until(lambda: flying._advance.stopped == "leaving", PATIENCE)
        gate.open()
        status, kind, told = answer_on(caller)
    assert (status, kind) == (503, PROBLEM)
    assert "the server is being stopped; this advance ended at 0.5 s of 30 s" in told["detail"]


def test_a_request_that_outlasts_the_server_is_answered_and_not_a_bare_500(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def never(*_: Any) -> Any:
        begun.set()
        assert go_on.wait(PATIENCE)

    monkeypatch.setattr(toy.Toy, "assemble", never)
    with served(grace=0.01) as server:
        caller = request(server, "POST", f"{API}/experiments", {"scenario": toy.scenario()})
        assert begun.wait(PATIENCE)
        server.server.should_exit = True
        status, kind, told = answer_on(caller)
        go_on.set()
    assert (status, kind, told["detail"]) == (503, PROBLEM, "the server is being stopped")
