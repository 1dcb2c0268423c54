"""A scenario that comes over the network cannot name a file of the machine."""

import pytest
from fastapi.testclient import TestClient

from server.app import create_app
from server.settings import Settings


@pytest.mark.parametrize("name", ["/etc/passwd", "../secret.05o", "log.05o", "."])
def test_given_a_log_named_over_rest_then_it_is_refused_and_nothing_is_read(name):
    scenario = {"system": "gps-receiver", "parameters": {"log": {"observation": name, "navigation": name}}}
    with TestClient(create_app(Settings()), base_url="http://127.0.0.1:8000") as client:
        answer = client.post("/api/v1/experiments", json={"scenario": scenario})
        assert answer.status_code in (409, 422)
        assert answer.headers["content-type"].startswith("application/problem+json")
        assert "file" in answer.json()["detail"]
        assert client.get("/api/v1/experiments").json() == []
