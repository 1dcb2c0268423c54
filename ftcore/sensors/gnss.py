"""GPS receiver: pseudoranges and delta pseudoranges with one clock."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Clock:
    """Receiver clock: ``phase`` [m] and ``frequency`` [m/s], each ``(runs,)``."""

    phase: Array
    frequency: Array

    def step(self, dt: float, s_f: float, s_g: float, noise: NoiseSource, epoch: int) -> Clock:
        """The clock ``dt`` seconds later, exactly: white frequency noise S_f [m^2/s], random-walk S_g [m^2/s^3]."""
        white = noise.normal("gps.clock", epoch, (2,))
        # Cholesky factor of the exact two-state covariance, written out.
        var_phase = s_f * dt + s_g * dt**3 / 3.0
        cross = s_g * dt**2 / 2.0
        l11 = math.sqrt(var_phase) if var_phase > 0 else 0.0
        l21 = cross / l11 if l11 > 0 else 0.0
        l22 = math.sqrt(max(s_g * dt - l21**2, 0.0))
        return Clock(
            self.phase + self.frequency * dt + l11 * white[:, 0],
            self.frequency + l21 * white[:, 0] + l22 * white[:, 1],
        )


def sense(
    true_range: Array,
    true_range_rate: Array,
    visible: Mask,
    clock: Clock,
    sigma_range: float,
    sigma_rate: float,
    noise: NoiseSource,
    epoch: int,
    time: float,
) -> tuple[Group, Group]:
    """Pseudoranges and delta pseudoranges of one epoch.

    Args:
        true_range, true_range_rate: ``(1 or runs, satellites)`` [m, m/s].
        visible: ``(1, satellites)``; the others have no reading.
        clock: of the receiver.
        sigma_range, sigma_rate: 1-sigma of the white noise [m, m/s].

    Returns:
        Two groups ``(runs, satellites)``.
    """
    n = true_range.shape[-1]
    ranges = true_range + clock.phase[:, None] + sigma_range * noise.normal("gps.pseudorange", epoch, (n,))
    rates = true_range_rate + clock.frequency[:, None] + sigma_rate * noise.normal("gps.delta_range", epoch, (n,))
    at = np.asarray(time)
    return Group(ranges, visible, at), Group(rates, visible, at)
