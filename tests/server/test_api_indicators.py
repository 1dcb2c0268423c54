"""Figures before anything flies, over REST."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient
from rest_lab import API

SLOW_TURN = {"flight": {"legs": [{}, {"bank": 70}], "speed": 350, "height": 10000}}
IMU = f"{API}/systems/redundant-imu/indicators"


def test_given_a_mounting_then_its_figures_are_answered(client: TestClient) -> None:
    answer = client.post(IMU, json={"parameters": {"gyros": {"mounting": [0, 45, 45]}}})
    assert answer.status_code == 200
    found = {indicator["id"]: indicator for indicator in answer.json()}
    assert found["fdi"]["value"] == pytest.approx(2.0)
    assert found["fdi"]["ideal"] == 4.0
    assert found["ambiguous.1"]["map"]["bands"][0]["label"] == "gyro 2"
    assert len(client.get(f"{API}/experiments").json()) == 0


def test_given_nothing_then_the_defaults_are_shown(client: TestClient) -> None:
    answer = client.post(IMU, json={})
    assert [i["value"] for i in answer.json() if i["id"] == "fdi"] == [pytest.approx(4.0)]


def test_given_a_setting_then_the_map_follows(client: TestClient) -> None:
    wide = client.post(IMU, json={"settings": {"angle_threshold": 30}}).json()
    share = next(i for i in wide if i["id"] == "ambiguous.3")["value"]
    assert share == pytest.approx(200.0 / 3.0)


def test_a_system_that_declares_none_says_none(client: TestClient) -> None:
    for system in ("gps-receiver", "toy"):
        assert client.post(f"{API}/systems/{system}/indicators", json={}).json() == []


@pytest.mark.parametrize(
    ("body", "status", "field", "words"),
    [
        ({"parameters": {"gyros": {"mounting": [45, "a", 45]}}}, 409, "parameters.gyros.mounting.1", "number"),
        ({"parameters": {"gyros": {"mounting": [45, 45]}}}, 409, "parameters.gyros.mounting.2", "needed"),
        ({"parameters": {"gyro": {}}}, 409, "parameters.gyro", "accepted are air_data, flight, gyros"),
        ({"parameters": {"gyros": {"noise": 0}}}, 409, "parameters.gyros.noise", "at least"),
        ({"settings": {"angle_threshold": 90}}, 409, "settings.angle_threshold", "at most 44"),
        ({"settings": {"confirm": 3, "within": 2}}, 409, "settings", "confirm 3 of 2 cannot be"),
        ({"parameters": SLOW_TURN}, 409, "parameters.flight.legs.1", "cannot fly"),
        ({"parameters": []}, 422, "parameters", "an object with named fields"),
        ({"mounting": [45, 45, 45]}, 422, "mounting", "accepted are parameters, settings"),
    ],
)
def test_what_cannot_be_is_refused_at_its_field(
    client: TestClient, body: dict[str, Any], status: int, field: str, words: str
) -> None:
    answer = client.post(IMU, json=body)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    error = answer.json()["errors"][0]
    assert error["field"] == field
    assert error["pointer"] == "#/" + field.replace(".", "/")
    assert words in error["detail"]


def test_an_unknown_system_is_404(client: TestClient) -> None:
    answer = client.post(f"{API}/systems/nothing/indicators", json={})
    assert answer.status_code == 404
    assert "redundant-imu" in answer.json()["detail"]
