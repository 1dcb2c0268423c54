"""What a system says of itself, with what a page needs on top: display factors and fault forms."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from ftcore import Fault, catalogue, units
from ftcore.description import SystemDescription
from ftcore.faults import form_schema


def signals_with_factors(description: SystemDescription) -> list[dict[str, Any]]:
    """Every signal with ``factor``: a shown value is the SI value divided by it."""
    return [signal.model_dump(mode="json") | {"factor": units.factor(signal.unit)} for signal in description.signals]


@lru_cache(maxsize=64)
def described(id: str) -> dict[str, Any]:
    """The description of one system as the API gives it. Raises CatalogueError if there is none of that id."""
    description = catalogue.system(id)
    document = description.model_dump(mode="json")
    document["signals"] = signals_with_factors(description)
    document["channels"] = [
        channel.model_dump(mode="json") | {"faults": form_schema(channel.kinds, channel.unit)}
        for channel in description.channels
    ]
    document["fault_schema"] = Fault.model_json_schema()
    return document
