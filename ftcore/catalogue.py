"""What there is: systems and ready scenarios."""

from __future__ import annotations

from functools import lru_cache

from ftcore.description import SystemDescription
from ftcore.scenario import Scenario, ready_ids
from ftcore.systems.registry import SYSTEMS


class CatalogueError(LookupError):
    """Nothing of that name; the message lists what there is."""


def systems() -> list[SystemDescription]:
    """Descriptions of all systems."""
    return [system.description for system in SYSTEMS.values()]


def system(id: str) -> SystemDescription:
    """Description of one system. Raises CatalogueError if there is none of that id."""
    if id not in SYSTEMS:
        raise CatalogueError(f"no system {id!r}; there are {', '.join(SYSTEMS)}")
    return SYSTEMS[id].description


@lru_cache(maxsize=1)
def _ready() -> tuple[Scenario, ...]:
    return tuple(sorted((Scenario.load(name) for name in ready_ids()), key=lambda s: (not s.featured, s.id)))


def scenarios() -> list[Scenario]:
    """All ready scenarios, the featured ones first, then by id."""
    return list(_ready())


def scenario(id: str) -> Scenario:
    """One ready scenario. Raises CatalogueError if there is none of that id."""
    for ready in _ready():
        if ready.id == id:
            return ready
    raise CatalogueError(f"no scenario {id!r}; there are {', '.join(s.id for s in _ready())}")
