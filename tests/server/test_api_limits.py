"""What a hostile client can send: it is refused in few words, and never a defect."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from gate import PATIENCE
from hypothesis import given, settings
from hypothesis import strategies as st
from rest_lab import API, Flight, client_of

from ftcore import commandlog
from server import bodies
from server.limits import SMALL_BODY
from server.problems import MOST_ERRORS
from server.registry import MOST_FIELDS
from server.settings import Settings

FAULT = {"channel": "ruler.position.x", "kind": "bias", "magnitude": 1.0}
MANY = {f"k{i}": i for i in range(100_000)}


def sent(client: TestClient, method: str, path: str, body: Any) -> Any:
    content, kind = json.dumps(body), {"content-type": "application/json"}
    return client.request(method, path, content=content, headers=kind)


@pytest.mark.parametrize(
    "scenario",
    [
        MANY,
        toy.scenario(parameters=MANY),
        toy.scenario(commands=[{"action": "configure", "time": 0.0, "settings": MANY}]),
        toy.scenario(commands=[{"action": "inject", "time": 0.0, "fault": FAULT | MANY}]),
        toy.scenario(commands=[{"action": "clear", "time": -1.0, "more": 1}] * 20_000),
        toy.scenario(commands=[{}] * 300_000),
        toy.scenario(faults=[{}] * 300_000),
        toy.scenario(faults=[FAULT | {"magnitude": None}] * 200),
        toy.scenario(**{f"k{i}": i for i in range(MOST_FIELDS - 10)}),
    ],
)
def test_a_document_that_is_wrong_in_a_hundred_thousand_places_is_refused_in_few_words(
    client: TestClient, scenario: Any
) -> None:
    refused = sent(client, "POST", f"{API}/experiments", {"scenario": scenario})
    assert refused.status_code in (409, 422)
    assert 1 <= len(refused.json()["errors"]) <= MOST_ERRORS
    assert len(refused.content) < 20_000


@pytest.mark.parametrize(
    ("method", "what"),
    [("POST", "/faults"), ("PATCH", "/settings"), ("POST", "/advance"), ("PATCH", "/clock"), ("PUT", "/cursor")],
)
def test_a_command_says_what_it_says_in_few_bytes(flight: Flight, method: str, what: str) -> None:
    assert sent(flight.client, method, f"{flight.path}{what}", MANY).status_code == 413
    refused = sent(flight.client, method, f"{flight.path}{what}", {f"k{i}": i for i in range(4000)})
    assert refused.status_code in (409, 422)
    assert 1 <= len(refused.json()["errors"]) <= MOST_ERRORS
    assert len(refused.content) < 100_000


@pytest.mark.parametrize(
    "path",
    ["/static/%00", "/static/" + "a" * 5000, "/static/" + "a/" * 2000, "/static/..%2f..%2fetc%2fpasswd", "/static/",
     "/static/%2e%2e/README.md", "/static//etc/passwd", "/docs/%00", "/experiments/%00/scene/",
     f"{API}/scenarios/%00", f"{API}/scenarios/%2e%2e", f"{API}/systems/%ff", f"{API}/experiments/%0d%0ax:y"],
)  # fmt: skip
def test_a_name_that_nothing_can_have_is_not_found(client: TestClient, path: str) -> None:
    answer = client.get(path)
    assert answer.status_code == 404
    assert len(answer.content) < 20_000


@pytest.mark.parametrize("body", ["a=1&" * 15_000, "token=" + "x" * 60_000, "token=%ff%00", "", "=" * 9])
def test_a_login_form_is_small(body: str) -> None:
    with client_of(Settings(token="secret")) as client:
        answer = client.post("/login", content=body, headers={"content-type": "application/x-www-form-urlencoded"})
        assert answer.status_code == 401
        assert client.post("/login", content="x" * (SMALL_BODY + 1)).status_code == 413


@pytest.mark.parametrize("history", ["9" * 6000, "-1", "1.5", "\u0663", "\u00b2", "x", ""])
def test_a_history_that_is_no_count_is_none(flight: Flight, history: str) -> None:
    with flight.client.websocket_connect(f"{flight.stream}?history={history}") as socket:
        assert socket.receive_json()["type"] == "hello"


def test_what_a_flight_hands_back_is_taken_again_however_much_was_done_to_it(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commandlog, "MAX_COMMANDS", 3)
    for enabled in (False, True, False):
        flight.do("PATCH", "/subsystems/ruler", {"enabled": enabled})
    before = flight.get("/events")
    refused = flight.ask("PATCH", "/subsystems/ruler", {"enabled": True})
    assert refused.status_code == 409
    assert "the command log is full" in refused.json()["detail"]
    assert flight.get("/events") == before
    document = flight.get("/scenario")
    assert len(document["commands"]) == 3
    again = Flight(flight.client, document)
    assert again.get()["subsystems"] == flight.get()["subsystems"]


LARGE = toy.scenario(commands=[{"action": "clear", "time": 0.0}] * 2000)


def test_a_large_document_is_read_while_others_are_served(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go, parse = threading.Event(), threading.Event(), bodies.parse

    def held(body: bytes) -> Any:
        begun.set()
        assert go.wait(PATIENCE)
        return parse(body)

    monkeypatch.setattr(bodies, "parse", held)
    with ThreadPoolExecutor(1) as pool:
        making = pool.submit(sent, client, "POST", f"{API}/experiments", {"scenario": LARGE})
        assert begun.wait(PATIENCE)
        assert client.get(f"{API}/health").status_code == 200
        go.set()
        made = making.result(PATIENCE)
    assert made.status_code == 201
    assert len(client.get(made.headers["location"] + "/scenario").json()["commands"]) == 2000


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


def outcome(read: Callable[[bytes], Any], body: bytes) -> str:
    """What was read, or what was wrong where; NaN is itself."""
    try:
        return repr(read(body))
    except json.JSONDecodeError as error:
        return f"{error.msg} at {error.pos}"


@settings(max_examples=25)
@given(document=JSON, encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]), spoil=st.integers(0, 40))
def test_a_large_body_says_what_json_says_it_does(document: Any, encoding: str, spoil: int) -> None:
    text = json.dumps(document)
    for written in (text, text[:spoil] + "}" + text[spoil:]):
        assert outcome(bodies.parse, written.encode(encoding)) == outcome(json.loads, written.encode(encoding))
