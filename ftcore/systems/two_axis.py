"""Readings of two-axis instruments that are there but not looked at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ftcore.readings import Readings
from ftcore.systems.base import LeftOut

UNPAIRED = "its instrument has no reading of the other axis, and is used with both or not at all"


def unpaired(readings: Readings, groups: Sequence[str], first: int = 0) -> dict[str, LeftOut]:
    """Axes whose instrument has no reading of the other one, of the groups in which there are some.

    Args:
        readings: of the epoch.
        groups: reading groups whose columns from ``first`` on are the axes of two-axis instruments, two and two.
        first: how many columns before are none of theirs.
    """
    found = {}
    for name in groups:
        valid = readings[name].valid
        if valid[:, first:].all():
            continue
        pairs = valid[:, first:].reshape(len(valid), -1, 2)
        alone = pairs & ~pairs.all(axis=-1, keepdims=True)
        if alone.any():
            where = np.zeros(valid.shape, bool)
            where[:, first:] = alone.reshape(len(valid), -1)
            found[name] = LeftOut(where, UNPAIRED)
    return found
