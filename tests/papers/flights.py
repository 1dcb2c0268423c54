"""Flights that several claims look at, flown once, and what is read off them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore import Scenario, Simulation

Array = NDArray[np.float64]

RUNS = 100
CALM = "calm"
"""The scenario `zhang-1992` with nothing failing."""


@lru_cache(maxsize=8)
def flown(scenario: str, runs: int = RUNS, seed: int | None = None, **settings: Any) -> Simulation:
    """A ready scenario (or :data:`CALM`), flown to its end with these settings."""
    return Simulation(prepared(scenario, **settings), runs=runs, seed=seed).advance()


def prepared(scenario: str, **settings: Any) -> Scenario:
    """A ready scenario (or :data:`CALM`) with these settings."""
    ready = Scenario.load("zhang-1992" if scenario == CALM else scenario)
    changes: dict[str, Any] = {"settings": ready.settings | settings}
    if scenario == CALM:
        changes["faults"] = ()
    return ready.model_copy(update=changes)


def batches(scenario: str, runs: int, seed: int, **settings: Any) -> Iterator[Simulation]:
    """The same flown in batches of :data:`RUNS`, so that memory stays small."""
    ready = prepared(scenario, **settings)
    for first in range(0, runs, RUNS):
        yield Simulation(ready, runs=min(RUNS, runs - first), seed=seed, first_run=first).advance()


def between(sim: Simulation, signal: str, start: float, end: float) -> Array:
    """A signal at start < t <= end, ``(epochs, runs)``."""
    inside = (sim.time > start + 1e-9) & (sim.time <= end + 1e-9)
    return sim[signal][inside]


def rms(sim: Simulation, signal: str, start: float, end: float) -> float:
    """Root mean square over all runs and start < t <= end."""
    return float(np.sqrt(np.mean(between(sim, signal, start, end) ** 2)))


def position_rms(sim: Simulation, estimator: str, start: float, end: float) -> float:
    """Root mean square of the length of the position error."""
    parts = [rms(sim, f"{estimator}.error.position.{part}", start, end) for part in ("east", "north", "up")]
    return float(np.linalg.norm(parts))


def runs_with(sim: Simulation, kind: str, subject: str, start: float = 0.0, end: float = np.inf) -> set[int]:
    """Runs in which an event of this kind came to this subject, or to a part of it, at start <= t <= end."""
    return {
        event.run
        for event in sim.events
        if event.kind == kind
        and (event.subject == subject or event.subject.startswith(subject + "."))
        and start - 1e-9 <= event.time <= end + 1e-9
    }
