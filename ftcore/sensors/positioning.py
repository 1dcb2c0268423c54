"""Satellite receivers that hand out a position: east, north and up in metres about a datum, each with white noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group

Array = NDArray[np.float64]


def sense(sensor: str, enu: Array, sigma: Array, noise: NoiseSource, epoch: int, time: float) -> Group:
    """One epoch of position of the receiver called ``sensor``.

    Args:
        enu: ``(1 or runs, 3)`` true east, north, up [m] about the datum.
        sigma: ``(3,)`` 1-sigma of the white noise [m]; Yang 2016, Table 2.

    Returns:
        Group ``(runs, 3)`` [m].
    """
    values = enu + sigma * noise.normal(f"{sensor}.position", epoch, (3,))
    return Group(values, np.ones((1, 3), bool), np.asarray(time))
