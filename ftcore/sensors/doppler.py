"""Doppler radar: velocity in the body frame with a scale-factor error and a drift angle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group

Array = NDArray[np.float64]


def sense(
    velocity_n: Array,
    C_nb: Array,
    scale: Array,
    drift: Array,
    sigma: float,
    noise: NoiseSource,
    epoch: int,
    time: float,
) -> Group:
    """One epoch of body velocity.

    The drift angle turns the velocity about the local vertical (Zhang 1992 (62), as resolved: y2 = dv - d_k v - d_Delta
    (up x v) after rotation to level); the scale factor stretches it.

    Args:
        velocity_n: ``(1 or runs, 3)`` true, level frame [m/s].
        C_nb: ``(1 or runs, 3, 3)`` true attitude.
        scale: ``(runs,)`` d_k [1].
        drift: ``(runs,)`` d_Delta [rad].
        sigma: 1-sigma of the white noise, each axis [m/s].

    Returns:
        Group ``(runs, 3)``: forward, right, down.
    """
    c, s = np.cos(drift), np.sin(drift)
    east, north, up = np.moveaxis(velocity_n, -1, 0)
    turned = np.stack([c * east - s * north, s * east + c * north, np.broadcast_to(up, c.shape)], axis=-1)
    seen = ((1.0 + scale)[:, None] * turned)[:, None, :] @ C_nb
    values = seen[:, 0] + sigma * noise.normal("doppler.velocity", epoch, (3,))
    return Group(values, np.ones((1, 3), bool), np.asarray(time))
