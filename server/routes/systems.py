"""Systems and their descriptions."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from pydantic import ValidationError

from ftcore import catalogue
from ftcore.description import Indicator
from server.descriptions import described
from server.models import Choices
from server.problems import documented, from_validation

router = APIRouter(prefix="/systems", tags=["systems"])


@router.get("", operation_id="listSystems", summary="All systems", responses=documented())
def list_systems() -> list[dict[str, Any]]:
    """Descriptions of all systems: channels, subsystems, signals with units, charts, diagram, scene, schemas."""
    return [described(system.id) for system in catalogue.systems()]


@router.get("/{id}", operation_id="getSystem", summary="One system", responses=documented(404))
def get_system(id: str) -> dict[str, Any]:
    """The description of one system: everything a page needs to draw it, break it and plot it."""
    return described(id)


@router.post(
    "/{id}/indicators",
    operation_id="getIndicators",
    summary="Figures before anything flies",
    responses=documented(400, 404, 409, 413, 415, 422),
)
def get_indicators(id: str, body: Choices) -> list[Indicator]:
    """Figures that follow from parameters and settings, such as what a mounting of the gyros is good for.

    Nothing is made or flown. None from a system that declares none.
    """
    form = catalogue.choices(id)
    try:
        return list(catalogue.indicators(id, body.parameters, body.settings))
    except ValidationError as error:
        raise from_validation(error, body.model_dump(), form, free=("parameters", "settings")) from None
