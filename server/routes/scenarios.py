"""Ready scenarios, and the schema that every scenario follows."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from ftcore import Scenario, catalogue
from server.problems import documented

router = APIRouter(tags=["scenarios"])


@router.get("/scenarios", operation_id="listScenarios", summary="Ready scenarios", responses=documented())
def list_scenarios() -> list[Scenario]:
    """All ready scenarios, each a document that can be posted as an experiment."""
    return catalogue.scenarios()


@router.get("/scenarios/{id}", operation_id="getScenario", summary="One ready scenario", responses=documented(404))
def get_scenario(id: str) -> Scenario:
    """One ready scenario."""
    return catalogue.scenario(id)


@router.get(
    "/schema/scenario", operation_id="getScenarioSchema", summary="Schema of a scenario", responses=documented()
)
def get_scenario_schema() -> dict[str, Any]:
    """The JSON Schema of a scenario document, with units."""
    return Scenario.model_json_schema()
