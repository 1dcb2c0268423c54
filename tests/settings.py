"""Settings drawn at random, as a scenario takes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ftcore.systems.registry import SYSTEMS


def that_matter(system: str, parameters: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings without those that change nothing beside the others, which a scenario refuses."""
    model = SYSTEMS[system]
    given = model.Settings.model_validate(dict(settings))
    idle = given.without_effect(model.Parameters.model_validate(dict(parameters)))
    return {name: value for name, value in settings.items() if name not in idle}
