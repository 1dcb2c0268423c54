"""Barometric altimeter with a bias and a scale-factor error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group

Array = NDArray[np.float64]


def sense(height: Array, bias: Array, scale: Array, sigma: float, noise: NoiseSource, epoch: int, time: float) -> Group:
    """One epoch of height: ``height + E_po + E_hsf height + white noise``.

    Args:
        height: ``(1 or runs,)`` true [m].
        bias: ``(runs,)`` E_po [m].
        scale: ``(runs,)`` E_hsf [1].
        sigma: 1-sigma of the white noise [m].

    Returns:
        Group ``(runs, 1)``.
    """
    values = height + bias + scale * height + sigma * noise.normal("altimeter.height", epoch)
    return Group(values[:, None], np.ones((1, 1), bool), np.asarray(time))
