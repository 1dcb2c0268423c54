"""A receiver's log comes as a form, flies like any scenario, and is gone with the last experiment that flies it."""

from __future__ import annotations

import gzip
import os
import random
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi.testclient import TestClient
from rest_lab import API, client_of, served

from server.settings import Settings
from server.uploads import Uploads
from tests import packing
from tests.synthetic_log import Files, files

LOGS = f"{API}/logs"
EPOCHS = 20
SATELLITE = "gps.pseudorange.G10"


@pytest.fixture(scope="module")
def made() -> Files:
    return files(EPOCHS)


@pytest.fixture
def folder(client: TestClient) -> Iterator[Path]:
    """Where the server keeps uploaded files; empty before and after every test."""
    kept: Path = client.app.state.registry.uploads.folder  # type: ignore[attr-defined]
    assert list(kept.iterdir()) == []
    yield kept
    for experiment in client.get(f"{API}/experiments").json():
        client.delete(f"{API}/experiments/{experiment['id']}")
    assert list(kept.iterdir()) == []


def upload(client: Any, observation: bytes, navigation: bytes, **fields: str) -> Any:
    forms = {"observation": ("mine.26o", observation), "navigation": ("mine.26n", navigation)}
    return client.post(LOGS, files=forms, data=fields)


def flown(client: Any, made: Files, **fields: str) -> Any:
    answer = upload(client, made.observation, made.navigation, **fields)
    assert answer.status_code == 201, answer.text
    return answer.json()


def document(client: Any, experiment: Any) -> Any:
    return client.get(f"{API}/experiments/{experiment['id']}/scenario").json()


# ---- it flies -----------------------------------------------------------------------------------------------------


def test_an_uploaded_log_is_an_experiment_at_its_own_epochs(client: TestClient, folder: Path, made: Files) -> None:
    answer = upload(client, made.observation, made.navigation, antenna=made.position, title="on the roof")
    assert answer.status_code == 201
    experiment = answer.json()
    assert answer.headers["location"] == f"{API}/experiments/{experiment['id']}"
    assert client.get(answer.headers["location"]).json() == experiment
    assert (experiment["title"], experiment["system"]) == ("on the roof", "gps-receiver")
    clock = experiment["clock"]
    assert (clock["state"], clock["time"], clock["period"], clock["duration"]) == ("paused", 0.0, 30.0, 600.0)

    path = f"{API}/experiments/{experiment['id']}"
    flight = client.post(f"{path}/advance", json={"until": 95.0}).json()
    assert (flight["experiment"]["clock"]["time"], flight["experiment"]["clock"]["epoch"]) == (90.0, 3)
    fault = {"channel": SATELLITE, "kind": "bias", "magnitude": 100.0, "start": 240.0}
    assert client.post(f"{path}/faults", json=fault).status_code == 201
    flight = client.post(f"{path}/advance", json={}).json()
    assert flight["experiment"]["clock"]["state"] == "finished"
    assert {event["time"] % 30.0 for event in flight["events"]} == {0.0}
    assert "gps.G10" in [e["subject"] for e in flight["events"] if e["kind"] == "subsystem.isolated"]

    names = [f"combined.error.position.{part}" for part in ("east", "north", "up")]
    series = client.get(f"{path}/series", params={"signals": ",".join(names)}).json()
    assert series["time"] == [30.0 * k for k in range(1, 21)]
    error = np.sqrt(np.sum(np.square([series["signals"][name] for name in names]), axis=0))
    assert np.median(error) < 2.5
    assert client.get(f"{path}/report").status_code == 200


def test_the_antenna_may_be_left_to_the_file(client: TestClient, folder: Path, made: Files) -> None:
    log = document(client, flown(client, made))["parameters"]["log"]
    assert sorted(log) == ["navigation", "observation"]
    given = document(client, flown(client, made, antenna=made.position))["parameters"]["log"]
    assert given["antenna"] == pytest.approx(made.antenna, abs=1e-3)


def test_forks_ghosts_and_reposts_fly_the_same_log(client: TestClient, folder: Path, made: Files) -> None:
    experiment = flown(client, made)
    path = f"{API}/experiments/{experiment['id']}"
    client.post(f"{path}/faults", json={"channel": SATELLITE, "kind": "ramp", "magnitude": 1.0, "start": 120.0})
    client.post(f"{path}/advance", json={"until": 300.0})
    fork = client.post(f"{path}/fork", json={"at": 150.0})
    ghost = client.post(f"{path}/ghost", json=None)
    again = client.post(f"{API}/experiments", json={"scenario": document(client, experiment)})
    assert [one.status_code for one in (fork, ghost, again)] == [201, 201, 201]
    assert len(list(folder.iterdir())) == 2
    client.delete(path)  # the others still fly it

    last: list[Any] = []
    for one in (fork, again):
        own = f"{API}/experiments/{one.json()['id']}"
        assert client.post(f"{own}/fork", json={}).status_code == 201
        last.append(client.post(f"{own}/advance", json={}).json()["latest"])
    assert last[0] == last[1]
    healthy = client.post(f"{API}/experiments/{ghost.json()['id']}/advance", json={}).json()["latest"]
    name = "unprotected.error.position.east"
    assert abs(healthy[name]) < 5.0 < abs(last[0][name])


def test_noise_that_contradicts_what_is_assumed_is_an_event_and_its_floor_can_be_given(
    client: TestClient, folder: Path
) -> None:
    noisy = files(EPOCHS, noise=6.0)
    path = f"{API}/experiments/{flown(client, noisy)['id']}"
    said = {event["kind"]: event for event in client.get(f"{path}/events").json()}
    event = said["log.noise"]
    assert (event["time"], event["run"], event["detail"]["probability"]) == (0.0, -1, 1e-4)
    assert "a floor of" in event["detail"]["text"]
    fits = event["detail"]["fitting_floor"]
    assert fits == pytest.approx(6.0, rel=0.35)
    experiment = flown(client, noisy, noise_floor=str(fits))
    assert document(client, experiment)["parameters"]["log"]["floor"] == fits
    kinds = [event["kind"] for event in client.get(f"{API}/experiments/{experiment['id']}/events").json()]
    assert "log.noise" not in kinds


@pytest.mark.parametrize(("floor", "status"), [("0", 409), ("1000", 409), ("much", 422), ("", 422), ("nan", 422)])
def test_a_noise_floor_that_cannot_be_is_refused_at_its_field(
    client: TestClient, folder: Path, made: Files, floor: str, status: int
) -> None:
    answer = upload(client, made.observation, made.navigation, noise_floor=floor)
    assert answer.status_code == status
    assert [error["field"] for error in answer.json()["errors"]] == ["noise_floor"]


@pytest.mark.parametrize("packed", ["gz", "Z", "crx", "crx.gz", "bz2"])
def test_a_packed_log_flies_like_the_plain_one(client: TestClient, folder: Path, made: Files, packed: str) -> None:
    plain = flown(client, made)["clock"]
    answer = upload(client, packing.packed(made.observation, packed), packing.packed(made.navigation, packed[-2:]))
    assert answer.status_code == 201, answer.text
    assert answer.json()["clock"] == plain


# ---- the files ----------------------------------------------------------------------------------------------------


def test_files_are_the_servers_own_and_go_with_their_last_experiment(
    client: TestClient, folder: Path, made: Files
) -> None:
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    first, second = flown(client, made), flown(client, made)
    assert len(list(folder.iterdir())) == 2
    kept = document(client, first)
    client.delete(f"{API}/experiments/{first['id']}")
    assert len(list(folder.iterdir())) == 2
    client.delete(f"{API}/experiments/{second['id']}")
    assert list(folder.iterdir()) == []

    answer = client.post(f"{API}/experiments", json={"scenario": kept})
    assert answer.status_code == 409
    assert "upload the log again" in answer.json()["detail"]
    assert answer.json()["errors"][0]["pointer"] == "#/scenario/parameters/log/observation"
    flown(client, made)  # the same files have the same names
    assert client.post(f"{API}/experiments", json={"scenario": kept}).status_code == 201


def test_files_go_when_the_server_stops(made: Files) -> None:
    with client_of() as client:
        folder = client.app.state.registry.uploads.folder  # type: ignore[attr-defined]
        flown(client, made)
        assert len(list(folder.iterdir())) == 2
    assert not folder.exists()


def test_there_is_room_for_so_many_bytes_and_so_many_experiments(made: Files) -> None:
    size = len(made.observation) + len(made.navigation)
    other = files(EPOCHS, seed=2)
    with client_of(Settings(max_upload_bytes=size + 100, max_experiments=2)) as client:
        first = flown(client, made)
        full = upload(client, other.observation, other.navigation)
        assert (full.status_code, "delete an experiment" in full.json()["detail"]) == (429, True)
        flown(client, made)
        assert upload(client, made.observation, made.navigation).status_code == 429
        for one in (first, client.get(f"{API}/experiments").json()[1]):
            client.delete(f"{API}/experiments/{one['id']}")
        flown(client, other)
        assert len(list(client.app.state.registry.uploads.folder.iterdir())) == 2  # type: ignore[attr-defined]


def test_files_are_kept_while_somebody_reads_them() -> None:
    uploads = Uploads(100)
    try:
        with uploads.adding(b"one", b"two") as names:
            for name, content in zip(names, (b"one", b"two"), strict=True):
                uploads.write(name, content)
            with uploads.holding(names[:1]):
                uploads.keep(set())
                assert [(uploads.folder / name).read_bytes() for name in names] == [b"one", b"two"]
        uploads.keep({names[1]})
        assert [path.name for path in uploads.folder.iterdir()] == [names[1]]
        uploads.keep(set())
        assert len(uploads) == 0
    finally:
        uploads.close()


PATHS = ["/etc/passwd", "../{name}", "./{name}", "{folder}/{name}", "sub/{name}", ".", "..", "~", "\x00",
         "{name}\x00", "..\\{name}", "%2e%2e/{name}", "{name}/", "//{name}", "/proc/self/environ",
         "file:///{folder}/{name}"]  # fmt: skip


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("part", ["observation", "navigation"])
def test_no_other_file_of_the_machine_can_be_named(
    client: TestClient, folder: Path, made: Files, path: str, part: str
) -> None:
    scenario = document(client, flown(client, made))
    log = scenario["parameters"]["log"]
    log[part] = path.format(name=log[part], folder=folder)
    answer = client.post(f"{API}/experiments", json={"scenario": scenario})
    assert answer.status_code == 409
    assert answer.json()["errors"][0]["field"] == f"scenario.parameters.log.{part}"
    assert "root:" not in answer.text
    assert len(client.get(f"{API}/experiments").json()) == 1


def test_a_link_in_the_folder_cannot_be_made_from_outside(client: TestClient, folder: Path, made: Files) -> None:
    """The names of uploaded files are the server's choice, whatever the form calls them."""
    form = {"observation": ("../../etc/x", made.observation), "navigation": ("/tmp/y", made.navigation)}
    assert client.post(LOGS, files=form).status_code == 201
    assert sorted(len(path.name) for path in folder.iterdir()) == [36, 36]


# ---- what is wrong with them --------------------------------------------------------------------------------------


def wrong(made: Files, which: str) -> tuple[bytes, bytes, dict[str, str]]:
    o, n = made.observation, made.navigation
    cases: dict[str, tuple[bytes, bytes, dict[str, str]]] = {
        "empty": (b"", n, {}),
        "empty navigation": (o, b"", {}),
        "noise": (os.urandom(5000), n, {}),
        "swapped": (n, o, {}),
        "twice the same": (o, o, {}),
        "packed": (gzip.compress(o)[:-20], n, {}),
        "truncated": (o[: len(o) // 2 + 3], n, {}),
        "truncated navigation": (o, n[: len(n) // 2 + 40], {}),
        "garbled": (o.replace(b".", b"!", 60), n, {}),
        "another day": (o, files(EPOCHS, days=3).navigation, {}),
        "no position": (files(EPOCHS, position=False).observation, n, {}),
        "antenna in space": (o, n, {"antenna": "1, 2, 3"}),
    }
    return cases[which]


@pytest.mark.parametrize(
    ("which", "fields", "says"),
    [
        ("empty", ["observation"], "observation file is empty"),
        ("empty navigation", ["navigation"], "navigation file is empty"),
        ("noise", ["observation"], "not a RINEX file"),
        ("swapped", ["observation"], "is a GPS navigation file"),
        ("twice the same", ["navigation"], "is an observation file"),
        ("packed", ["observation"], "gzip packing is damaged or cut off"),
        ("truncated", ["observation"], "truncated|corrupt at line"),
        ("truncated navigation", ["navigation"], "truncated|corrupt at line"),
        ("garbled", ["observation"], "corrupt|not a RINEX|is RINEX"),
        ("another day", ["observation", "navigation"], "do not belong together"),
        ("no position", ["antenna"], "give the antenna's position"),
        ("antenna in space", ["antenna"], "not near the Earth"),
    ],
)
def test_a_log_that_cannot_be_used_is_one_sentence_at_its_field(
    client: TestClient, folder: Path, made: Files, which: str, fields: list[str], says: str
) -> None:
    observation, navigation, form = wrong(made, which)
    answer = upload(client, observation, navigation, **form)
    assert answer.status_code == 409
    assert answer.headers["content-type"].startswith("application/problem+json")
    problem = answer.json()
    assert [error["field"] for error in problem["errors"]] == fields
    assert any(words in problem["detail"] for words in says.split("|"))
    assert "\n" not in problem["detail"]
    assert len(problem["detail"]) < 250
    assert list(folder.iterdir()) == []
    assert client.get(f"{API}/experiments").json() == []


@pytest.mark.parametrize(
    ("form", "fields"),
    [
        ({}, ["observation", "navigation"]),
        ({"observation": ("a", b"x")}, ["navigation"]),
        ({"observation": ("a", b"x"), "navigation": ("a", b"x"), "colour": ("", b"red")}, ["colour"]),
        ([("observation", ("a", b"x")), ("observation", ("b", b"x")), ("navigation", ("a", b"x"))], ["observation"]),
        ({"observation": ("a", b"x"), "navigation": ("a", b"x"), "antenna": (None, b"north pole")}, ["antenna"]),
        ({"observation": ("a", b"x"), "navigation": ("a", b"x"), "antenna": (None, b"1,2")}, ["antenna"]),
        ({"observation": ("a", b"x"), "navigation": ("a", b"x"), "antenna": (None, b"nan,1,2")}, ["antenna"]),
        ({"observation": ("a", b"x"), "navigation": ("a", b"x"), "antenna": ("f", b"1,2,3")}, ["antenna"]),
        ({"observation": ("a", b"x"), "navigation": ("a", b"x"), "title": (None, b"")}, ["title"]),
    ],
)
def test_a_form_that_does_not_fit_is_refused_at_its_fields(
    client: TestClient, folder: Path, form: Any, fields: list[str]
) -> None:
    empty = {"content": b"--x--\r\n", "headers": {"content-type": "multipart/form-data; boundary=x"}}
    answer = client.post(LOGS, **({"files": form} if form else empty))
    assert answer.status_code == 422
    assert [error["field"] for error in answer.json()["errors"]] == fields


def test_a_file_that_was_not_chosen_is_asked_for(client: TestClient, folder: Path) -> None:
    """A browser's form sends a part without name and content for it."""
    part = '--x\r\ncontent-disposition: form-data; name="{}"; filename="{}"\r\n\r\n{}\r\n'
    body = part.format("observation", "a.26o", "hello") + part.format("navigation", "", "") + "--x--\r\n"
    answer = client.post(LOGS, content=body, headers={"content-type": "multipart/form-data; boundary=x"})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "navigation")


def test_what_is_too_large_is_refused_with_the_limit(made: Files) -> None:
    n = len(made.navigation)
    with client_of(Settings(max_observation_bytes=2000, max_navigation_bytes=n, max_log_epochs=EPOCHS - 1)) as client:
        large = upload(client, made.observation, made.navigation)
        assert (large.status_code, large.json()["errors"][0]["field"]) == (413, "observation")
        assert "at most 0.002 MB" in large.json()["detail"]
        larger = upload(client, b" " * 100_000, made.navigation)
        assert larger.status_code == 413
    with client_of(Settings(max_navigation_bytes=n - 1, max_log_epochs=EPOCHS - 1)) as client:
        large = upload(client, made.observation, made.navigation)
        assert (large.status_code, large.json()["errors"][0]["field"]) == (413, "navigation")
    with client_of(Settings(max_log_epochs=EPOCHS - 1)) as client:
        long = upload(client, made.observation, made.navigation)
        assert (long.status_code, long.json()["errors"][0]["field"]) == (409, "observation")
        assert "20 epochs; at most 19" in long.json()["detail"]


def test_the_servers_limits_are_those_of_the_reader() -> None:
    from ftcore.sensors import rinex

    settings = Settings()
    with client_of(settings) as client:
        assert client.get(LOGS).json() == {
            "observation_bytes": 64_000_000,
            "navigation_bytes": 20_000_000,
            "epochs": 8640,
            "noise_floor": 1.0,
            "least_noise_floor": 0.01,
            "largest_noise_floor": 100.0,
        }
    assert settings.max_observation_bytes == rinex.MAX_OBSERVATION_BYTES
    assert settings.max_navigation_bytes == rinex.MAX_NAVIGATION_BYTES
    assert settings.max_log_epochs == rinex.MAX_EPOCHS


def test_a_body_without_end_is_cut_off_and_other_bodies_are_as_limited_as_ever(made: Files) -> None:
    """On a real port, since the limit counts what streams in."""

    def endless() -> Iterator[bytes]:
        yield b'--x\r\ncontent-disposition: form-data; name="observation"; filename="a"\r\n\r\n'
        for _ in range(1000):
            yield b"x" * 10_000

    form = {"content-type": "multipart/form-data; boundary=x"}
    settings = Settings(max_observation_bytes=50_000, max_navigation_bytes=20_000, max_body_bytes=20_000)
    with served(settings) as server, httpx.Client(base_url=server.base) as client:
        try:
            status = client.post(LOGS, content=endless(), headers=form).status_code
        except httpx.TransportError:  # the server may hang up on whoever goes on sending
            status = 413
        assert status == 413
        assert flown(client, made)["clock"]["period"] == 30.0
        json = {"content-type": "application/json"}
        assert client.post(f"{API}/experiments", content=b" " * 21_000, headers=json).status_code == 413


def test_any_cut_or_flipped_byte_is_flown_or_refused_in_one_sentence(
    client: TestClient, folder: Path, made: Files
) -> None:
    rng = random.Random(5)
    outcomes = set()
    for k in range(40):
        pair = [bytearray(made.observation), bytearray(made.navigation)]
        victim = pair[k % 2]
        at = rng.randrange(len(victim))
        if k % 3:
            victim[at] = rng.randrange(256)
        else:
            del victim[at:]
        answer = upload(client, bytes(pair[0]), bytes(pair[1]))
        outcomes.add(answer.status_code)
        if answer.status_code == 201:
            path = f"{API}/experiments/{answer.json()['id']}"
            assert client.post(f"{path}/advance", json={}).json()["experiment"]["clock"]["state"] == "finished"
            client.delete(path)
        else:
            assert answer.status_code == 409
            assert answer.json()["errors"]
            assert "\n" not in answer.json()["detail"]
    assert outcomes == {201, 409}


# ---- who may send them --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"origin": "null"},
                                     {"origin": "http://localhost:9999"}, {"sec-fetch-site": "cross-site"},
                                     {"host": "evil.example"}])  # fmt: skip
def test_a_form_of_another_page_brings_nothing_in(
    client: TestClient, folder: Path, made: Files, headers: dict[str, str]
) -> None:
    form = {"observation": ("a", made.observation), "navigation": ("b", made.navigation)}
    assert client.post(LOGS, files=form, headers=headers).status_code == 403
    assert list(folder.iterdir()) == []


def test_a_form_is_taken_there_and_nowhere_else(client: TestClient, folder: Path, made: Files) -> None:
    form = {"observation": ("a", made.observation), "navigation": ("b", made.navigation)}
    assert client.post(f"{API}/experiments", files=form).status_code == 415
    assert client.post(LOGS, json={}).status_code == 415
    assert client.post(LOGS, data={"observation": "x"}).status_code == 415
    nonsense = client.post(LOGS, content=b"xx", headers={"content-type": "multipart/form-data; boundary=y"})
    assert nonsense.status_code == 400
    assert client.put(LOGS).status_code == 405


def test_a_guarded_server_wants_the_token_for_a_log_too(made: Files) -> None:
    with client_of(Settings(token="sesame")) as client:
        assert upload(client, made.observation, made.navigation).status_code == 401
        client.headers["authorization"] = "Bearer sesame"
        flown(client, made)


def test_the_form_is_in_the_openapi_document(client: TestClient) -> None:
    operation = client.get(f"{API}/openapi.json").json()["paths"]["/api/v1/logs"]["post"]
    form = operation["requestBody"]["content"]["multipart/form-data"]["schema"]
    assert form["required"] == ["observation", "navigation"]
    assert form["properties"]["observation"]["format"] == "binary"
