"""Star tracker (celestial navigation, CNS): roll, pitch and heading, each with white noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group

Array = NDArray[np.float64]


def sense(rpy: Array, sigma: float, noise: NoiseSource, epoch: int, time: float) -> Group:
    """One epoch of attitude.

    The angles are not wrapped: a heading just short of a full turn plus noise may read a little more than a full turn,
    as an error of the sensor is a number of radians and not a jump.

    Args:
        rpy: ``(1 or runs, 3)`` true roll, pitch, heading [rad].
        sigma: 1-sigma of the white noise of each angle [rad]; Yang 2016, Table 2.

    Returns:
        Group ``(runs, 3)``: roll, pitch, heading [rad].
    """
    values = rpy + sigma * noise.normal("cns.attitude", epoch, (3,))
    return Group(values, np.ones((1, 3), bool), np.asarray(time))
