"""Refusals: what was wrong, where, what would be right; and nothing has changed."""

from __future__ import annotations

import json
from typing import Any

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from rest_lab import API, Flight, client_of

from server.settings import Settings

BIAS = {"channel": "ruler.position.x", "kind": "bias", "magnitude": 1.0}

REFUSED: list[tuple[str, str, Any, int, str]] = [
    ("POST", "/faults", BIAS | {"magnitud": 2}, 422, "/magnitud"),
    ("POST", "/faults", BIAS | {"magnitude": "1"}, 422, "/magnitude"),
    ("POST", "/faults", BIAS | {"magnitude": True}, 422, "/magnitude"),
    ("POST", "/faults", BIAS | {"magnitude": None}, 422, "/magnitude"),
    ("POST", "/faults", BIAS | {"magnitude": 1e300}, 422, "/magnitude"),
    ("POST", "/faults", BIAS | {"kind": "spin"}, 422, "/kind"),
    ("POST", "/faults", {"kind": "bias"}, 422, "/channel"),
    ("POST", "/faults", BIAS | {"channel": "ruler.position.z"}, 409, "/channel"),
    ("POST", "/faults", BIAS | {"channel": "ruler.position.y", "kind": "noise"}, 409, "/kind"),
    ("POST", "/faults", BIAS | {"kind": "stuck"}, 409, "/magnitude"),
    ("POST", "/faults", {"channel": "ruler.position.x", "kind": "stuck", "magnitude": 0.0}, 409, "/magnitude"),
    ("POST", "/faults", BIAS | {"rate": 0.1}, 409, "/rate"),
    ("POST", "/faults", BIAS | {"angular_frequency": 2.0}, 409, "/angular_frequency"),
    ("POST", "/faults", BIAS | {"start": 0.5}, 409, "/start"),
    ("POST", "/faults", BIAS | {"start": 61.0}, 409, "/start"),
    ("POST", "/faults", BIAS | {"end": 1.05}, 409, "/end"),
    ("POST", "/faults", BIAS | {"start": 2.02, "end": 2.08}, 409, "/end"),
    ("POST", "/faults", BIAS | {"magnitude": 1e-30}, 409, "/magnitude"),
    ("POST", "/faults", BIAS | {"kind": "scale-factor", "magnitude": 1e-17}, 409, "/magnitude"),
    ("POST", "/faults", BIAS | {"kind": "sine", "angular_frequency": 62.83185307179586}, 409, "/angular_frequency"),
    ("PATCH", "/faults/f1", {"start": 0.5}, 409, "/start"),
    ("PATCH", "/faults/f1", {"start": 5.0}, 409, "/start"),
    ("PATCH", "/faults/f1", {"end": 0.5}, 409, "/end"),
    ("PATCH", "/faults/f1", {"rate": 0.1}, 409, "/rate"),
    ("POST", "/faults", BIAS | {"unit": "deg"}, 409, "/unit"),
    ("POST", "/faults", BIAS | {"start": 3.0, "end": 2.0}, 409, "/end"),
    ("POST", "/faults", BIAS | {"magnitude": 0.0}, 409, "/magnitude"),
    ("POST", "/faults", [], 422, ""),
    ("PATCH", "/faults/f1", {"magnitude": 5, "channel": "ruler.position.y"}, 422, "/channel"),
    ("PATCH", "/faults/f1", {"kind": "delay", "magnitude": 100.0}, 409, "/magnitude"),
    ("PATCH", "/clock", {"speed": 0.1}, 422, "/speed"),
    ("PATCH", "/clock", {"speed": "fast"}, 422, "/speed"),
    ("PATCH", "/clock", {"state": "finished"}, 422, "/state"),
    ("PATCH", "/clock", {}, 409, ""),
    ("POST", "/advance", {"epochs": -1}, 422, "/epochs"),
    ("POST", "/advance", {"epochs": 1.5}, 422, "/epochs"),
    ("POST", "/advance", {"epochs": 1, "until": 2}, 409, ""),
    ("POST", "/advance", {"until": 0.5}, 409, "/until"),
    ("POST", "/rewind", {"to": 99.0}, 409, "/to"),
    ("POST", "/rewind", {}, 422, "/to"),
    ("POST", "/fork", {"at": 99.0}, 409, "/at"),
    ("PATCH", "/subsystems/ruler", {"enabled": "yes"}, 422, "/enabled"),
    ("PATCH", "/settings", {"treshold": 3.0}, 409, "/treshold"),
    ("PATCH", "/settings", {"threshold": -3.0}, 409, "/threshold"),
    ("PATCH", "/settings", {"threshold": "3"}, 409, "/threshold"),
    ("PATCH", "/settings", {"threshold": None}, 409, "/threshold"),
    ("PUT", "/cursor", {"time": 99.0}, 409, "/time"),
]


PLAIN = [
    ({"magnitude": "x"}, "magnitude: a number is needed, not 'x'"),
    ({"magnitude": float("inf")}, "magnitude: a finite number is needed, not inf"),
    ({"start": -5}, "start: at least 0 is needed, not -5"),
    ({"start": 3.0, "end": 2.0}, "end is 2.0 s, which is not after the start at 3.0 s"),
    ({"angular_frequency": 0}, "angular_frequency: more than 0 is needed, not 0"),
]


@pytest.mark.parametrize(("wrong", "says"), PLAIN)
def test_what_is_wrong_is_said_in_plain_words(flight: Flight, wrong: Any, says: str) -> None:
    headers = {"content-type": "application/json"}
    answer = flight.client.post(flight.path + "/faults", content=json.dumps(BIAS | wrong), headers=headers)
    assert answer.json()["detail"] == says


@pytest.mark.parametrize(("method", "what", "body", "status", "where"), REFUSED)
def test_a_refused_command_says_where_and_changes_nothing(
    flight: Flight, method: str, what: str, body: Any, status: int, where: str
) -> None:
    flight.advance(until=1.0)
    flight.do("POST", "/faults", BIAS)
    before = flight.get(), flight.get("/events"), flight.get("/scenario")

    answer = flight.ask(method, what, body)

    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == status
    assert [error["pointer"] for error in problem["errors"]] == ["#" + where]
    assert problem["errors"][0]["field"] == where.removeprefix("/").replace("/", ".")
    assert (flight.get(), flight.get("/events"), flight.get("/scenario")) == before


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
@pytest.mark.parametrize(
    ("method", "what", "body"),
    [
        ("POST", "/faults", '{"channel":"ruler.position.x","kind":"bias","magnitude":%s}'),
        ("POST", "/faults", '{"channel":"ruler.position.x","kind":"bias","magnitude":1,"end":%s}'),
        ("POST", "/advance", '{"until":%s}'),
        ("POST", "/rewind", '{"to":%s}'),
        ("PATCH", "/clock", '{"speed":%s}'),
        ("PATCH", "/settings", '{"threshold":%s}'),
        ("PUT", "/cursor", '{"time":%s}'),
    ],
)
def test_nan_and_infinity_are_refused(flight: Flight, method: str, what: str, body: str, number: str) -> None:
    headers = {"content-type": "application/json"}
    answer = flight.client.request(method, flight.path + what, content=body % number, headers=headers)
    assert answer.status_code in (400, 409, 422), answer.text


def test_an_unknown_field_is_answered_with_the_known_ones(flight: Flight) -> None:
    error = flight.ask("POST", "/faults", BIAS | {"magnitud": 2}).json()["errors"][0]
    assert "magnitude" in error["accepted"]
    assert "there is no field 'magnitud'" in error["detail"]


@pytest.mark.parametrize(
    ("changes", "status", "where"),
    [
        ({"durration": 5}, 422, "#/scenario/durration"),
        ({"duration": "5"}, 422, "#/scenario/duration"),
        ({"duration": -5}, 422, "#/scenario/duration"),
        (
            {"faults": [{"channel": "ruler.position.x", "kind": "bias", "magnitude": "1"}]},
            422,
            "#/scenario/faults/0/magnitude",
        ),
        ({"commands": [{"action": "switch", "time": 1, "subsystem": "ruler", "on": True}]}, 422, None),
        ({"parameters": {"fails_att": 3}}, 409, "#/scenario/parameters/fails_att"),
        ({"system": "submarine"}, 409, "#/scenario/system"),
        ({"subsystems": {"sonar": True}}, 409, "#/scenario"),
        ({"seed": 2**63}, 422, "#/scenario/seed"),
    ],
)
def test_a_document_that_is_no_scenario_is_refused_at_the_place(
    client: TestClient, changes: dict[str, Any], status: int, where: str | None
) -> None:
    answer = client.post(f"{API}/experiments", json={"scenario": toy.scenario(**changes)})
    assert answer.status_code == status, answer.text
    if where is not None:
        assert where in [error["pointer"] for error in answer.json()["errors"]]
    assert client.get(f"{API}/experiments").json() == []


@pytest.mark.parametrize(
    ("method", "what"),
    [
        ("GET", "/events?kind=fault.injected"),
        ("GET", "/score?run=1"),
        ("GET", "/series?sgnals=gap"),
        ("GET", "?verbose=1"),
        ("GET", "/faults?state=active"),
        ("POST", "/faults?dry=1"),
        ("PATCH", "/clock?x=1"),
        ("PATCH", "/settings?x="),
        ("POST", "/advance?epochs=3"),
        ("PUT", "/cursor?time=0"),
        ("DELETE", "/faults?channel=ruler.position.x"),
        ("DELETE", "?force="),
    ],
)
def test_a_query_parameter_that_a_route_does_not_know_is_refused_with_those_it_does(
    flight: Flight, method: str, what: str
) -> None:
    before = flight.get()
    answer = flight.ask(method, what, BIAS if what.startswith("/faults?dry") else None)
    name = what.split("?")[1].split("=")[0]
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    error = answer.json()["errors"][0]
    assert error["parameter"] == name
    assert ("signals" in error["accepted"]) == what.startswith("/series")
    assert flight.get() == before


def test_every_route_of_the_api_refuses_an_unknown_query_parameter(client: TestClient) -> None:
    for path, methods in client.get(f"{API}/openapi.json").json()["paths"].items():
        for method in methods:
            answer = client.request(method, path.replace("{", "").replace("}", ""), params={"unheard-of": "1"})
            # What is not there is said first; so is a body that is not sent.
            assert answer.status_code in (404, 422), (method, path, answer.text)


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/nothing"),
        ("GET", "/systems/none"),
        ("GET", "/scenarios/none"),
        ("GET", "/experiments/none"),
        ("DELETE", "/experiments/none"),
        ("GET", "/experiments/none/series"),
        ("POST", "/experiments/none/ghost"),
    ],
)
def test_what_is_not_there_is_404(client: TestClient, method: str, path: str) -> None:
    answer = client.request(method, API + path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


def test_names_below_an_experiment_that_are_not_there_are_404(flight: Flight) -> None:
    for method, what, body in [
        ("GET", "/faults/f9", None),
        ("DELETE", "/faults/f9", None),
        ("PATCH", "/faults/f9", {"magnitude": 1.0}),
        ("PATCH", "/subsystems/sonar", {"enabled": True}),
        ("GET", "/series?signals=fused.error.position.q", None),
    ]:
        answer = flight.ask(method, what, body)
        assert answer.status_code == 404, (method, what)
    assert "fused.error.position.x" in answer.json()["errors"][0]["accepted"]


def test_an_unknown_ready_scenario_is_404_with_those_there_are(client: TestClient) -> None:
    answer = client.post(f"{API}/experiments", json={"scenario": "atlantis"})
    assert answer.status_code == 404
    assert "zhang-1992" in answer.json()["detail"]


def test_a_wrong_method_is_405_with_the_right_ones(flight: Flight) -> None:
    answer = flight.ask("PUT", "", {})
    assert answer.status_code == 405
    assert answer.headers["allow"] == "DELETE, GET"


def test_a_body_that_is_not_json_is_400_or_415(flight: Flight) -> None:
    client = flight.client
    cut = client.post(flight.path + "/faults", content='{"channel":', headers={"content-type": "application/json"})
    assert cut.status_code == 400
    deep = client.post(flight.path + "/faults", content="[" * 60_000, headers={"content-type": "application/json"})
    assert deep.status_code == 400
    binary = client.post(flight.path + "/faults", content=b"\xff\xfe", headers={"content-type": "application/json"})
    assert binary.status_code == 400
    form = client.post(flight.path + "/faults", data={"channel": "x"})
    assert form.status_code == 415
    untyped = client.post(flight.path + "/faults", content="{}")
    assert untyped.status_code == 415
    for answer in (cut, deep, binary, form, untyped):
        assert answer.headers["content-type"] == "application/problem+json"


def test_a_media_type_that_cannot_be_given_is_406(flight: Flight) -> None:
    answer = flight.client.get(flight.path + "/series", headers={"accept": "image/png"})
    assert answer.status_code == 406
    assert "text/csv" in answer.json()["detail"]


def test_a_large_body_is_refused_while_it_streams_in(flight: Flight) -> None:
    sent = 0

    def endless() -> Any:
        nonlocal sent
        for _ in range(500):
            sent += 1
            yield b" " * 10_000

    headers = {"content-type": "application/json"}
    answer = flight.client.post(flight.path + "/faults", content=endless(), headers=headers)
    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"
    declared = flight.client.post(flight.path + "/faults", content=b" " * 4_100_000, headers=headers)
    assert declared.status_code == 413


def test_experiments_are_capped() -> None:
    settings = Settings(max_experiments=2)
    with client_of(settings) as client:
        first = Flight(client)
        Flight(client)
        answer = client.post(f"{API}/experiments", json={"scenario": toy.scenario()})
        assert answer.status_code == 429
        assert first.ask("POST", "/fork", {}).status_code == 429
        assert first.ask("POST", "/ghost").status_code == 429
        first.do("DELETE", "")
        Flight(client)


def test_one_advance_is_capped() -> None:
    with client_of(Settings(max_advance_epochs=10)) as client:
        flight = Flight(client)
        assert flight.ask("POST", "/advance", {"epochs": 11}).status_code == 409
        assert flight.ask("POST", "/advance", {}).status_code == 409
        assert flight.advance(epochs=10)["experiment"]["clock"]["epoch"] == 10
