"""Toy flights that stop where a test wants them: epochs are let through by hand, one a turn."""

from __future__ import annotations

import threading
from typing import Any

import pytest
import toy_system as toy

from server import experiments

PATIENCE = 20.0
"""Seconds after which a test that waits for nothing fails."""


class Gate:
    """From its first epoch on, each epoch of every toy flight waits to be let through; each turn flies one.

    Args:
        first: the first epoch that waits.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, first: int) -> None:
        self._arrived, self._let = threading.Semaphore(0), threading.Semaphore(0)
        self._open = False
        fly = toy.Plant.step

        def step(plant: toy.Plant, state: float, epoch: int, command: Any) -> Any:
            if epoch >= first and not self._open:
                self._arrived.release()
                assert self._let.acquire(timeout=PATIENCE)
            return fly(plant, state, epoch, command)

        monkeypatch.setattr(toy.Plant, "step", step)
        monkeypatch.setattr(experiments, "SLICE", 0.0)

    def arrival(self) -> None:
        """Wait until an epoch stands at the gate."""
        assert self._arrived.acquire(timeout=PATIENCE)

    def let(self) -> None:
        """Let one epoch through."""
        self._let.release()

    def open(self) -> None:
        """Let everything through from now on."""
        self._open = True
        self._let.release()
