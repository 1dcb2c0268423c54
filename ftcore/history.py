"""The past of a flight: states to go back to, and what the operator had set in each epoch.

Checkpoints thin out as a flight grows long; a moment between two of them is reached by flying again from the earlier
one, to the same bits.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.acting import Deeds
from ftcore.injection import FaultMemory
from ftcore.operator import Operator
from ftcore.systems.base import Flags

CHECKPOINTS = 64
"""States kept for rewinding; a batch keeps fewer, so that memory stays bounded."""
LARGE_BATCH = 256
"""Runs of a batch from which on only the state at the start is kept."""


@dataclass(frozen=True)
class State:
    """Everything one epoch needs from the one before; a value."""

    epoch: int
    plant: Any
    navigator: Any
    memory: FaultMemory
    command: Any
    alarm: Flags
    health: NDArray[np.int8]
    used: Flags
    deeds: Deeds = field(default_factory=Deeds)


class History:
    """Checkpoints and operators of the epochs that were flown.

    Args:
        state: at the start.
        operator: at the start.
        runs: how many fly side by side.
    """

    def __init__(self, state: State, operator: Operator, runs: int) -> None:
        self._most = max(1 if runs >= LARGE_BATCH else 4, CHECKPOINTS // runs)
        self._every = 1
        self._states: dict[int, State] = {state.epoch: state}
        self._operators: list[tuple[int, Operator]] = [(state.epoch, operator)]

    def flown(self, state: State) -> None:
        """Keep the newest state, unless checkpoints are further apart by now."""
        if state.epoch % self._every == 0:
            self._states[state.epoch] = state
        if len(self._states) > self._most:
            self._every *= 2
            self._states = {epoch: s for epoch, s in self._states.items() if epoch % self._every == 0}

    def commanded(self, epoch: int, operator: Operator) -> None:
        """Keep what the operator has set when ``epoch`` was the newest."""
        if self._operators[-1][0] == epoch:
            self._operators.pop()
        self._operators.append((epoch, operator))

    def operator(self, epoch: int) -> Operator:
        """What the operator had set at the end of an epoch."""
        return self._operators[bisect_right(self._operators, epoch, key=lambda pair: pair[0]) - 1][1]

    def checkpoint(self, epoch: int) -> State:
        """The newest state that is kept of an epoch and those before it."""
        return self._states[max(e for e in self._states if e <= epoch)]

    def until(self, epoch: int) -> History:
        """An independent history of everything up to the end of an epoch."""
        twin = object.__new__(History)
        twin._most, twin._every = self._most, self._every
        twin._states = {e: state for e, state in self._states.items() if e <= epoch}
        twin._operators = [(e, operator) for e, operator in self._operators if e <= epoch]
        return twin
