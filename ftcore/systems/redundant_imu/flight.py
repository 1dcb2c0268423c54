"""The mission and the control law that flies it: from trim to trim, held by a regulator on the measured states.

Guidance and stability augmentation know the published aircraft, not the one that really flies. States and controls are
those of :mod:`ftcore.world.aircraft`; arrays lead with (runs, aircraft).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.systems.redundant_imu.aircraft import EPOCH
from ftcore.world import aircraft as f16
from ftcore.world.aircraft import REGULATED, Aircraft, S, Trim

if TYPE_CHECKING:
    from ftcore.systems.redundant_imu.forms import Flight, Leg

Array = NDArray[np.float64]

CHANGE = 4.0
"""Seconds in which one leg goes over into the next."""
BLOCK = 500
"""Epochs of a mission that are evaluated together."""

STATE_SCALE = (5.0, 0.05, 0.03, 0.10, 0.05, 0.30, 0.20, 0.10, 5.0, 15.0)
"""Deviations that weigh alike: m/s, rad, rad/s, m, per cent; in the order of REGULATED."""
CONTROL_SCALE = (0.15, 0.06, 0.06, 0.06)
"""Throttle, and surfaces [rad]."""

_PLACE = {state: i for i, state in enumerate(REGULATED)}


class Mission:
    """What is wanted at every epoch: states (10,) in the order of REGULATED, controls (4,).

    Each leg's trim, one going smoothly over into the next; the last leg goes on for ever. Evaluated block by block.
    """

    def __init__(self, flight: Flight, points: Sequence[Trim]) -> None:
        self._flight, self._points = flight, points
        self._begins = np.cumsum([leg.duration for leg in flight.legs[:-1]])
        # Memos of pure functions, the latter of two blocks and the heights gained before each.
        self._memo: dict[int, tuple[Array, Array]] = {}
        self._gained = {0: 0.0}

    def at(self, epoch: int) -> tuple[Array, Array]:
        """Wanted states and controls."""
        number, place = divmod(epoch, BLOCK)
        block = self._memo.get(number)
        if block is None:
            for before in range(max(n for n in self._gained if n <= number), number):
                self._evaluate(before)
            block = self._evaluate(number)
            self._memo = dict(list(self._memo.items())[-1:]) | {number: block}
        return block[0][place], block[1][place]

    def _evaluate(self, number: int) -> tuple[Array, Array]:
        """States (BLOCK, 10) and controls (BLOCK, 4) of a block."""
        first, points, chosen = number * BLOCK, self._points, list(REGULATED)
        start = max(first - 1, 0)
        time = EPOCH * np.arange(start, first + BLOCK + 1)
        states, controls = points[0].x[chosen] + np.zeros((len(time), 1)), points[0].u + np.zeros((len(time), 1))
        climb = units.to_si(self._flight.legs[0].climb_rate, "ft/s") + np.zeros(len(time))
        changes = zip(self._begins, pairwise(self._flight.legs), pairwise(points), strict=True)
        for begin, (leg, onwards), (before, after) in changes:
            share = np.clip((time - begin) / CHANGE, 0.0, 1.0)
            share = share * share * (3.0 - 2.0 * share)
            states += share[:, None] * (after.x - before.x)[chosen]
            controls += share[:, None] * (after.u - before.u)
            climb += share * units.to_si(onwards.climb_rate - leg.climb_rate, "ft/s")
        # While bank and pitch change there must be rates; height is what the climb rate adds up to.
        for rate, angle in ((S.P, S.ROLL), (S.Q, S.PITCH)):
            states[:, _PLACE[rate]] += np.gradient(states[:, _PLACE[angle]], EPOCH)
        within = slice(first - start, first - start + BLOCK)
        gains = 0.5 * EPOCH * (climb[1:] + climb[:-1])[within]
        gained = np.cumsum(np.concatenate([[self._gained[number]], gains]))
        states[within, _PLACE[S.UP]] = self._flight.height + gained[:-1]
        self._gained[number + 1] = float(gained[-1])
        return states[within], controls[within]


def trims(aircraft: Aircraft, f: Flight, legs: Sequence[Leg] | None = None) -> list[Trim]:
    """Steady flight of each leg, all by default. Raises ValueError for a leg that the aircraft cannot fly."""
    speed, heading = units.to_si(f.speed, "ft/s"), math.radians(f.heading)
    return [
        _steady(aircraft, speed, f.height, units.to_si(leg.climb_rate, "ft/s"), math.radians(leg.bank), heading)
        for leg in (f.legs if legs is None else legs)
    ]


def mission(aircraft: Aircraft, f: Flight) -> Mission:
    """What is wanted of an aircraft. Raises ValueError for a leg that it cannot fly."""
    return Mission(f, trims(aircraft, f))


def augmentation(aircraft: Aircraft, f: Flight, wanted: Mission) -> Augmentation:
    """The linear quadratic regulator about the first leg, gain (4, 10), on the way through a mission."""
    return Augmentation(wanted, f16.regulator(aircraft, trims(aircraft, f)[0], STATE_SCALE, CONTROL_SCALE))


@dataclass(frozen=True, eq=False)
class Augmentation:
    """Mission and stability augmentation: controls ``(..., 4)`` from measured states ``(..., 10)`` as in REGULATED."""

    mission: Mission
    gain: Array

    def __call__(self, epoch: int, states: Array) -> Array:
        """Controls at an epoch, within their stops."""
        x, u = self.mission.at(epoch)
        return np.asarray(np.clip(u - np.matvec(self.gain, states - x), f16.CONTROL_MIN, f16.CONTROL_MAX))


def path_angle(states: Array) -> Array:
    """Angle (...) [rad] at which the flight path climbs, of states ``(..., 10)`` as in REGULATED."""
    a, b, roll, pitch = (states[..., _PLACE[angle]] for angle in (S.ALPHA, S.BETA, S.ROLL, S.PITCH))
    across = np.sin(b) * np.sin(roll) + np.sin(a) * np.cos(b) * np.cos(roll)
    return np.asarray(np.arcsin(np.clip(np.cos(a) * np.cos(b) * np.sin(pitch) - across * np.cos(pitch), -1.0, 1.0)))


_steady = lru_cache(maxsize=256)(f16.trim)
