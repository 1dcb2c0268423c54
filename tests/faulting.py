"""Faults drawn at random, as tests lay them."""

from __future__ import annotations

from typing import Any

from ftcore import CommandError, Fault, Simulation
from ftcore.faults import KINDS, Kind


def sized(channel: str, kind: Kind, magnitude: float, **more: Any) -> Fault:
    """A fault of that kind; what its kind has no use for is left out."""
    given = {"magnitude": magnitude, **more}
    return Fault(channel=channel, kind=kind, **{name: v for name, v in given.items() if KINDS[kind].uses(name)})


def lay(simulation: Simulation, fault: Fault) -> Fault | None:
    """Inject a fault drawn at random; None where it is refused because it could never act."""
    try:
        return simulation.inject(fault)
    except CommandError as refused:
        if any(words in str(refused) for words in ("in view", "is left between", "is zero at")):
            return None
        raise
