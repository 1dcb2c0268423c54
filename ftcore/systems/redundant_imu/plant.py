"""World and sensors of the redundant-IMU system: three F-16s that fly the same mission in the same noise.

They differ only in their controls: one flies on rates that the FDI hands it, one on all gyros, and one is the healthy
twin, which no fault reaches. A fault's channel touches the columns of the first two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group, Readings
from ftcore.systems.redundant_imu.aircraft import AIRCRAFT, EPOCH, RATES, Truth
from ftcore.systems.redundant_imu.flight import trims
from ftcore.systems.redundant_imu.forms import Parameters
from ftcore.world.aircraft import S, midpoint_step

Array = NDArray[np.float64]
FASTEST = 15.0
"""Angular rate [rad/s] at which an aircraft has broken up, some three times the fastest roll of an F-16: beyond it the
tables of the aerodynamics mean nothing, and the equations soon overflow."""


class Plant:
    """See :class:`ftcore.systems.base.Plant`. The command is ``(runs, 3 aircraft, 4)`` controls."""

    def __init__(self, p: Parameters, axes: Array, noise: NoiseSource) -> None:
        self._p, self._axes, self._noise = p, axes, noise
        self.aircraft = p.flown()
        steady = trims(self.aircraft, p.flight)[0]
        shape = (len(noise.runs), AIRCRAFT)
        self._x0 = np.array(np.broadcast_to(steady.x, (*shape, len(steady.x))))
        self._u0 = np.array(np.broadcast_to(steady.u, (*shape, len(steady.u))))

    def initial(self) -> Truth:
        """In steady flight on the first leg."""
        return Truth(self._x0)

    def alignment(self) -> tuple[Array, Array]:
        """What the navigators are told at the start: state and controls, without errors."""
        return self._x0, self._u0

    def step(self, state: Truth, epoch: int, command: Array | None) -> tuple[Truth, Truth, Readings]:
        """One epoch. What has reached the ground stays there, and what breaks up where it broke."""
        u = self._u0 if command is None else command
        after = midpoint_step(self.aircraft, state.x, u, EPOCH)
        whole = np.abs(after[..., RATES]).max(axis=-1, keepdims=True) < FASTEST
        flies = whole & (state.x[..., S.UP, None] > 0.0)
        truth = Truth(np.where(flies, after, state.x))
        return truth, truth, sense(self._p, self._axes, self._noise, truth.x, epoch)


def sense(
    p: Parameters, axes: Array, noise: NoiseSource, x: Array, epoch: int, aiding: Mapping[str, Array] | None = None
) -> Readings:
    """Gyros with input axes (6, 3) and air data, of states ``(runs, aircraft, 13)``; ``aiding`` goes with them."""
    a, draw = p.air_data, noise.normal
    runs, now = len(x), np.asarray(epoch * EPOCH)
    angle = math.radians(a.angle)

    def group(values: Array) -> Group:
        columns = values.reshape(runs, -1)
        return Group(columns, np.ones((1, columns.shape[1]), bool), now)

    # One draw for all three: the twins fly in the same noise.
    gyro = x[..., RATES] @ axes.T + p.gyros.noise * draw("imu.gyro", epoch, (1, len(axes)))
    groups = {
        "imu.gyro": group(gyro),
        "air.speed": group(x[..., S.SPEED] + a.speed * draw("air.speed", epoch, (1,))),
        "air.alpha": group(x[..., S.ALPHA] + angle * draw("air.alpha", epoch, (1,))),
        "air.beta": group(x[..., S.BETA] + angle * draw("air.beta", epoch, (1,))),
        "air.height": group(x[..., S.UP] + a.height * draw("air.height", epoch, (1,))),
    }
    return Readings(epoch * EPOCH, groups, aiding or {})
