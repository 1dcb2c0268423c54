"""Readings: the only thing that passes from the plant to the navigator.

A reading group is one quantity of one sensor, for instance ``gps.pseudorange``: an array ``(runs, parts)`` or, for an
instrument sampled faster than the epoch, ``(runs, parts, samples)``. What the navigator may know besides (a
satellite's broadcast position, say) travels in ``aiding``; truth does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Group:
    """One quantity of one sensor.

    Attributes:
        values: ``(runs, parts)`` or ``(runs, parts, samples)``, SI.
        valid: ``(runs or 1, parts)``; False where there is no reading.
        times: ``(samples,)`` or ``()``; time of each sample [s].
    """

    values: Array
    valid: Mask
    times: Array


@dataclass(frozen=True)
class Readings:
    """All readings of one epoch: ``groups`` by ``<sensor>.<quantity>`` and ``aiding`` data that is not truth."""

    time: float
    groups: Mapping[str, Group]
    aiding: Mapping[str, Array] = field(default_factory=dict)

    def __getitem__(self, group: str) -> Group:
        """The group ``<sensor>.<quantity>``."""
        return self.groups[group]
