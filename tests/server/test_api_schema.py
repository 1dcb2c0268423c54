"""The API against its own OpenAPI document: schemathesis with every check, bounded so that it ends soon."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from rest_lab import API, client_of, served

from server.settings import Settings

OPERATIONS = {
    "listSystems", "getSystem", "getIndicators", "listScenarios", "getScenario", "getScenarioSchema",
    "createExperiment",
    "listExperiments", "getExperiment", "deleteExperiment", "forkExperiment", "ghostExperiment", "setClock",
    "advanceExperiment", "rewindExperiment", "injectFault", "listFaults", "getFault", "changeFault", "clearFault",
    "clearFaults", "switchSubsystem", "changeSettings", "getSeries", "listEvents", "getScore", "getReplay", "getView",
    "setCursor", "getReport", "flyLog", "getLogLimits", "getHealth", "getVersion",
}  # fmt: skip


def test_operation_ids_are_stable(client: TestClient) -> None:
    document = client.get(f"{API}/openapi.json").json()
    found = [operation["operationId"] for methods in document["paths"].values() for operation in methods.values()]
    assert sorted(found) == sorted(OPERATIONS)


def test_every_operation_says_what_it_does_and_how_it_refuses(client: TestClient) -> None:
    document = client.get(f"{API}/openapi.json").json()
    for methods in document["paths"].values():
        for operation in methods.values():
            assert operation["summary"]
            assert operation["description"]
            for status, answer in operation["responses"].items():
                if status >= "400":
                    assert list(answer["content"]) == ["application/problem+json"]
    assert "HTTPValidationError" not in str(document)


def test_a_guarded_server_says_that_it_wants_the_token() -> None:
    bearer = {"authorization": "Bearer sesame"}
    with client_of(Settings(token="sesame")) as client:
        document = client.get(f"{API}/openapi.json", headers=bearer).json()
    for methods in document["paths"].values():
        for operation in methods.values():
            wants = operation["operationId"] != "getHealth"
            assert ("401" in operation["responses"]) == wants
            assert ("security" in operation) == wants


@pytest.mark.parametrize(
    "phases", ["coverage,fuzzing", pytest.param("coverage,fuzzing,stateful", marks=pytest.mark.long)]
)
def test_schemathesis_finds_nothing(tmp_path: Path, phases: str) -> None:
    settings = Settings(max_advance_epochs=20, max_experiments=12)
    with served(settings) as server:
        result = subprocess.run(
            [
                str(Path(sys.executable).with_name("schemathesis")), "run", f"{server.base}{API}/openapi.json",
                "--checks", "all", "--phases", phases, "--max-examples", "2",
                "--seed", "7", "--workers", "1", "--suppress-health-check", "all", "--generation-database", "none",
                "--no-color",
            ],
            capture_output=True, text=True, timeout=1200, cwd=tmp_path,
        )  # fmt: skip
    assert result.returncode == 0, "\n".join(line[:300] for line in result.stdout.splitlines()[-120:])
