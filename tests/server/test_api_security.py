"""Who is let in: names, origins, the token; and what browsers are told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from rest_lab import API, Flight, client_of
from starlette.websockets import WebSocketDisconnect

from server.limits import Patience
from server.limits import client_of as address_of
from server.security import Doorkeeper
from server.settings import Settings, SettingsError

FOREIGN_HOSTS = ["evil.example", "evil.example:8000", "127.0.0.1:9999", "127.0.0.1.evil.example:8000", "", "[::1",
                 "localhost:8000@x", "192.168.0.7:8000", "127.0.0.1:8000/", "127.0.0.1:x"]  # fmt: skip
FOREIGN_ORIGINS = ["http://evil.example", "null", "http://localhost:9999", "https://127.0.0.1.evil.example:8000", "",
                   "file://", "chrome-extension://abc", "http://127.0.0.1:8000.evil.example"]  # fmt: skip
ROUTES = ["/", "/static/app.js", "/vendor/plotly.min.js", "/docs", f"{API}/health", f"{API}/experiments",
          f"{API}/openapi.json", "/experiments/x/scene/", "/nothing"]  # fmt: skip


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("host", FOREIGN_HOSTS)
def test_a_foreign_host_is_refused_everywhere(client: TestClient, route: str, host: str) -> None:
    assert client.get(route, headers={"host": host}).status_code == 403


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("origin", FOREIGN_ORIGINS)
def test_a_foreign_origin_is_refused_everywhere(client: TestClient, route: str, origin: str) -> None:
    assert client.get(route, headers={"origin": origin}).status_code == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "[::1]:8000", "LOCALHOST:8000"])
def test_this_machine_has_three_names(client: TestClient, host: str) -> None:
    assert client.get(f"{API}/health", headers={"host": host}).status_code == 200
    assert client.get(f"{API}/health", headers={"origin": f"http://{host}"}).status_code == 200


def test_names_can_be_added() -> None:
    with client_of(Settings(allowed_hosts=("lab.example", "lab.example:80"))) as client:
        assert client.get(f"{API}/health", headers={"host": "lab.example:443"}).status_code == 200
        assert client.get(f"{API}/health", headers={"host": "lab.example"}).status_code == 200
        assert client.get(f"{API}/health", headers={"origin": "https://lab.example"}).status_code == 200
        assert client.get(f"{API}/health", headers={"host": "other.example"}).status_code == 403


@pytest.mark.parametrize("headers", [{"host": "evil.example"}, {"origin": "http://evil.example"}, {"origin": "null"}])
@pytest.mark.parametrize("what", ["stream", "scene", "scene/"])
def test_foreign_sockets_are_refused(flight: Flight, headers: dict[str, str], what: str) -> None:
    path = flight.stream if what == "stream" else f"ws://127.0.0.1:8000/experiments/{flight.id}/{what}"
    with pytest.raises(WebSocketDisconnect), flight.client.websocket_connect(path, headers=headers):
        pass


def test_a_form_of_another_page_cannot_command(flight: Flight) -> None:
    client = flight.client
    form = {"content-type": "application/x-www-form-urlencoded"}
    assert client.post(f"{flight.path}/faults", content="channel=x", headers=form).status_code == 415
    plain = {"content-type": "text/plain"}
    assert client.post(f"{flight.path}/advance", content="{}", headers=plain).status_code == 415
    cross = {"sec-fetch-site": "cross-site"}
    assert client.post(f"{flight.path}/ghost", headers=cross).status_code == 403
    assert client.delete(flight.path, headers=cross).status_code == 403
    assert flight.get()["clock"]["epoch"] == 0


def test_every_answer_tells_browsers_what_to_beware_of(client: TestClient) -> None:
    for route in [*ROUTES, f"{API}/systems/none"]:
        answer = client.get(route)
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "frame-ancestors 'self'" in answer.headers["content-security-policy"]
        assert answer.headers["referrer-policy"] == "same-origin"
    policy = client.get("/").headers["content-security-policy"]
    assert "script-src 'self';" in policy
    assert "'unsafe-eval'" not in policy


# ---- the token ----------------------------------------------------------------------------------------------------

TOKEN = "correct horse battery staple"


@pytest.fixture(scope="module")
def _guarded() -> Iterator[TestClient]:
    with client_of(Settings(token=TOKEN)) as client:
        yield client


@pytest.fixture
def clock() -> list[float]:
    """What the doorkeeper takes for the time [s]; a test sets it."""
    return [1000.0]


@pytest.fixture
def guarded(_guarded: TestClient, clock: list[float]) -> TestClient:
    """A server with a token that nobody has tried yet."""
    _guarded.cookies.clear()
    _guarded.app.state.doorkeeper.patience = Patience(lambda: clock[0])  # type: ignore[attr-defined]
    return _guarded


@pytest.mark.parametrize("route", ["/static/app.js", f"{API}/experiments", f"{API}/openapi.json", "/docs", "/nothing"])
def test_without_the_token_nobody_comes_in(guarded: TestClient, route: str) -> None:
    guarded.cookies.clear()
    answer = guarded.get(route)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    for wrong in (
        {"authorization": "Bearer wrong"},
        {"x-ftlab-token": "wröng".encode()},
        {"cookie": "ftlab-session=x"},
    ):
        assert guarded.get(route, headers=wrong).status_code == 401


def test_health_needs_no_token(guarded: TestClient) -> None:
    assert guarded.get(f"{API}/health").status_code == 200


@pytest.mark.parametrize("headers", [{"authorization": f"Bearer {TOKEN}"}, {"x-ftlab-token": TOKEN}])
def test_the_token_opens(guarded: TestClient, headers: dict[str, str]) -> None:
    guarded.cookies.clear()
    assert guarded.get(f"{API}/experiments", headers=headers).status_code == 200


def test_a_browser_logs_in_and_gets_a_cookie_that_scripts_cannot_read(guarded: TestClient) -> None:
    guarded.cookies.clear()
    asked = guarded.get("/", headers={"accept": "text/html"}, follow_redirects=False)
    assert (asked.status_code, asked.headers["location"]) == (303, "/login")
    assert guarded.get("/login").status_code == 200
    assert guarded.post("/login", data={"token": "wrong"}).status_code == 401
    answer = guarded.post("/login", data={"token": TOKEN}, follow_redirects=False)
    assert answer.status_code == 303
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert TOKEN not in answer.headers["set-cookie"]
    assert guarded.get(f"{API}/experiments").status_code == 200
    foreign = guarded.post("/login", data={"token": TOKEN}, headers={"origin": "http://evil.example"})
    assert foreign.status_code == 403


def test_sockets_need_the_token_too(guarded: TestClient) -> None:
    guarded.cookies.clear()
    bearer = {"authorization": f"Bearer {TOKEN}"}
    made = guarded.post(f"{API}/experiments", json={"scenario": toy.scenario()}, headers=bearer).json()
    path = f"ws://127.0.0.1:8000{API}/experiments/{made['id']}/stream"
    with pytest.raises(WebSocketDisconnect), guarded.websocket_connect(path):
        pass
    with guarded.websocket_connect(path, headers=bearer) as socket:
        assert socket.receive_json()["type"] == "hello"


def wrong(client: TestClient, path: str = f"{API}/experiments") -> Any:
    return client.get(path, headers={"authorization": "Bearer wrong"})


def test_after_a_few_wrong_tokens_each_doubles_the_wait_and_a_right_one_ends_it(
    guarded: TestClient, clock: list[float]
) -> None:
    assert [wrong(guarded).status_code for _ in range(Patience.FREE)] == [401] * Patience.FREE
    for wait in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0):
        early = wrong(guarded)
        assert (early.status_code, early.headers["retry-after"]) == (429, str(int(wait)))
        assert early.headers["content-type"] == "application/problem+json"
        # Not even the right one is looked at, or a guess would cost nothing.
        assert guarded.get(f"{API}/systems", headers={"x-ftlab-token": TOKEN}).status_code == 429
        clock[0] += wait - 0.01
        assert wrong(guarded).status_code == 429
        clock[0] += 0.01
        assert wrong(guarded).status_code == 401
    clock[0] += 60.0
    assert guarded.get(f"{API}/systems", headers={"x-ftlab-token": TOKEN}).status_code == 200
    assert wrong(guarded).status_code == 401


def test_the_login_form_and_sockets_wait_as_well(guarded: TestClient, clock: list[float]) -> None:
    assert [guarded.post("/login", data={"token": "wrong"}).status_code for _ in range(5)] == [401] * 5
    refused = guarded.post("/login", data={"token": TOKEN})
    assert (refused.status_code, refused.headers["retry-after"]) == (429, "1")
    assert "try again in 1 s" in refused.text
    with (
        pytest.raises(WebSocketDisconnect),
        guarded.websocket_connect(f"{API}/experiments/x/stream", headers={"x-ftlab-token": TOKEN}),
    ):
        pass
    clock[0] += 1.0
    assert guarded.post("/login", data={"token": TOKEN}, follow_redirects=False).status_code == 303


def test_whoever_is_logged_in_or_tries_nothing_does_not_wait(guarded: TestClient) -> None:
    guarded.post("/login", data={"token": TOKEN}, follow_redirects=False)
    cookie = dict(guarded.cookies)
    guarded.cookies.clear()
    for _ in range(8):
        wrong(guarded)
    assert guarded.get(f"{API}/health").status_code == 200
    assert guarded.get(f"{API}/systems").status_code == 401
    assert guarded.get(f"{API}/systems", headers={"cookie": "ftlab-session=stale"}).status_code == 401
    guarded.cookies.update(cookie)
    assert guarded.get(f"{API}/systems").status_code == 200


def test_a_stale_cookie_is_no_try(guarded: TestClient) -> None:
    for _ in range(20):
        assert guarded.get(f"{API}/systems", headers={"cookie": "ftlab-session=stale"}).status_code == 401
    assert guarded.get(f"{API}/systems", headers={"x-ftlab-token": TOKEN}).status_code == 200


def test_one_address_that_tries_does_not_delay_another_and_is_forgotten_in_time() -> None:
    now = [0.0]
    patience = Patience(lambda: now[0])
    for _ in range(7):
        patience.failed("10.0.0.1")
    assert (patience.wait("10.0.0.1"), patience.wait("10.0.0.2")) == (4.0, 0.0)
    now[0] = Patience.FORGOTTEN + 1.0
    patience.failed("10.0.0.1")
    assert patience.wait("10.0.0.1") == 0.0
    for number in range(Patience.REMEMBERED + 5):
        patience.failed(str(number))
    assert len(patience._tries) == Patience.REMEMBERED


@pytest.mark.parametrize(
    ("host", "counted"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:aaaa::1", "2001:db8:1:2::/64"),
        ("2001:db8:1:2:bbbb::2", "2001:db8:1:2::/64"),
        ("testclient", "testclient"),
    ],
)
def test_a_client_is_an_address_or_a_network_of_the_new_kind(host: str, counted: str) -> None:
    assert address_of({"client": (host, 1)}) == counted
    assert address_of({}) == ""


# ---- the bind address ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.4", "::", "lab.example"])
def test_another_address_is_refused_without_a_token(host: str) -> None:
    with pytest.raises(SettingsError, match="needs a token"):
        Settings.from_environment({"FTLAB_HOST": host})
    assert Settings.from_environment({"FTLAB_HOST": host, "FTLAB_TOKEN": TOKEN}).host == host


def test_on_all_addresses_any_address_is_this_server_but_no_other_name() -> None:
    doorkeeper = Doorkeeper(Settings(host="0.0.0.0", token=TOKEN))
    assert doorkeeper.answers_to("192.168.1.4:8000", 8000, "http")
    assert doorkeeper.answers_to("[fe80::1]:8000", 8000, "http")
    assert not doorkeeper.answers_to("rebound.example:8000", 8000, "http")


def test_settings_come_from_the_environment_and_wrong_ones_are_named() -> None:
    settings = Settings.from_environment(
        {"PORT": "9001", "FTLAB_MAX_EXPERIMENTS": "3", "FTLAB_ALLOWED_HOSTS": "a, b:1"}
    )
    assert (settings.port, settings.max_experiments, settings.allowed_hosts) == (9001, 3, ("a", "b:1"))
    assert Settings.from_environment({"PORT": "9001", "FTLAB_PORT": "9002"}).port == 9002
    assert Settings.from_environment({"PORT": "9001"}, port=9003).port == 9003
    with pytest.raises(SettingsError, match="max_experiments"):
        Settings.from_environment({"FTLAB_MAX_EXPERIMENTS": "many"})
