"""Systems and their descriptions."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from ftcore import catalogue
from server.descriptions import described
from server.problems import documented

router = APIRouter(prefix="/systems", tags=["systems"])


@router.get("", operation_id="listSystems", summary="All systems", responses=documented())
def list_systems() -> list[dict[str, Any]]:
    """Descriptions of all systems: channels, subsystems, signals with units, charts, diagram, scene, schemas."""
    return [described(system.id) for system in catalogue.systems()]


@router.get("/{id}", operation_id="getSystem", summary="One system", responses=documented(404))
def get_system(id: str) -> dict[str, Any]:
    """The description of one system: everything a page needs to draw it, break it and plot it."""
    return described(id)
