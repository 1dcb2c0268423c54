"""What there is: systems and ready scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from pydantic import create_model

from ftcore.description import Indicator, SystemDescription
from ftcore.scenario import Scenario, ready_ids
from ftcore.sensors.rinex import MAX_EPOCHS
from ftcore.systems.base import FliesLogs, Form, Indicated
from ftcore.systems.registry import SYSTEMS

_DEFAULTS: Mapping[str, Any] = MappingProxyType({})


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


def indicators(
    id: str, parameters: Mapping[str, Any] = _DEFAULTS, settings: Mapping[str, Any] = _DEFAULTS
) -> tuple[Indicator, ...]:
    """Figures of a system that follow from parameters and settings (as in a scenario) before anything flies.

    None from a system that declares none. Raises CatalogueError if there is no such system, and pydantic's
    ValidationError, located below ``parameters`` or ``settings``, for values that are refused there.
    """
    chosen = choices(id).strictly({"parameters": dict(parameters), "settings": dict(settings)})
    model = SYSTEMS[id]
    return model.indicators(chosen.parameters, chosen.settings) if isinstance(model, Indicated) else ()


def choices(id: str) -> type[Any]:
    """Form with two fields: the ``parameters`` and ``settings`` of a system. Raises CatalogueError if there is none."""
    system(id)
    return _choices(id, SYSTEMS[id].Parameters, SYSTEMS[id].Settings)


@lru_cache(maxsize=64)
def _choices(id: str, parameters: type[Form], settings: type[Form]) -> type[Form]:
    fields: dict[str, Any] = {"parameters": (parameters, ...), "settings": (settings, ...)}
    return create_model(f"Choices of {id}", __base__=Form, **fields)


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


def log_scenario(
    observation: str,
    navigation: str,
    antenna: tuple[float, float, float] | None = None,
    max_epochs: int = MAX_EPOCHS,
    noise_floor: float | None = None,
) -> dict[str, Any]:
    """Scenario document that plays a receiver's log, by the system that flies logs.

    Args:
        observation, navigation: RINEX files of the same day.
        antenna: true position, Earth-fixed [m]; the observation file's approximate position if absent.
        max_epochs: of the longest log that is taken.
        noise_floor: pseudorange 1-sigma that is assumed at every elevation [m], see
            :data:`ftcore.systems.base.NOISE_FLOOR`; the usual one if absent.

    Raises:
        LogError: one sentence about the file that cannot be used.
    """
    system = next(system for system in SYSTEMS.values() if isinstance(system, FliesLogs))
    return system.log_scenario(observation, navigation, antenna, max_epochs, noise_floor)
