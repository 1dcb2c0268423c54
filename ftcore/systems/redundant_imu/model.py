"""The flight model that the UKF believes in: the published F-16 as two functions of arrays.

The UKF (floor 3) knows neither world nor aircraft; the system hands it these. Its nine states are those that a short
flight depends on: airspeed, angles of attack and sideslip, roll, pitch, the three rates, height. Engine power follows
the commands without noise, so it is carried beside the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.systems.redundant_imu.aircraft import EPOCH
from ftcore.world.aircraft import STATES, Aircraft, C, S, midpoint_step, power_command, power_rate

Array = NDArray[np.float64]

MODELLED = (S.SPEED, S.ALPHA, S.BETA, S.ROLL, S.PITCH, S.P, S.Q, S.R, S.UP)
ATTITUDE, RATES = slice(3, 5), slice(5, 8)
"""Where roll and pitch, and the rates, stand among the modelled states."""
AIR_STATES = (0, 1, 2, 8)
"""Where airspeed, angles of attack and sideslip, and height stand."""

LOWEST = np.array([20.0, -1.5, -1.5, -20.0, -1.55, -10.0, -10.0, -10.0, -1e3])
HIGHEST = np.array([700.0, 1.5, 1.5, 20.0, 1.55, 10.0, 10.0, 10.0, 3e4])
"""What no flight leaves: a filter that was fed nonsense stays within, and its covariance finite."""


def within(points: Array) -> Array:
    """Points (..., 9) brought within what a flight can be."""
    return np.asarray(np.minimum(np.maximum(points, LOWEST), HIGHEST))


@dataclass(frozen=True)
class FlightModel:
    """What the navigator is given of the aircraft.

    Attributes:
        fly: points (..., n, 9), power (...) [%] and controls (..., 4) to points one epoch later.
        spool: power (...) and controls (..., 4) to power one epoch later.
    """

    fly: Callable[[Array, Array, Array], Array]
    spool: Callable[[Array, Array], Array]


def flight_model(aircraft: Aircraft) -> FlightModel:
    """The model of an aircraft: a midpoint step over an epoch, its error far below the model's own."""
    chosen = list(MODELLED)

    def fly(points: Array, power: Array, u: Array) -> Array:
        x = np.zeros((*points.shape[:-1], STATES))
        x[..., chosen] = within(points)
        x[..., S.POWER] = power[..., None]
        return within(midpoint_step(aircraft, x, u[..., None, :], EPOCH)[..., chosen])

    def spool(power: Array, u: Array) -> Array:
        command = power_command(u[..., C.THROTTLE])
        middle = power + (0.5 * EPOCH) * power_rate(power, command)
        return np.asarray(power + EPOCH * power_rate(middle, command))

    return FlightModel(fly, spool)
