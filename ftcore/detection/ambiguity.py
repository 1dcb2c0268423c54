"""Which faults of two-axis instruments parity space cannot place: the map around the singular directions.

Near a line that two fault planes share, one instrument's fault looks like the other's. Directions of a fault are
angles between the instrument's first and second input axis, over half a turn.
Source: H.S. Kim et al. (2005), section 4.1.
"""

from __future__ import annotations

import numpy as np

from ftcore.detection.parity import ANGLE_THRESHOLD, Reference, fault_angles
from ftcore.detection.result import Array, Mask

Band = tuple[float, float, int]
"""Faults between two directions [rad] look like those of another instrument."""

_NOTHING = 1e-9


def ambiguity_map(
    reference: Reference, limit: float = ANGLE_THRESHOLD, directions: int = 360
) -> tuple[Array, Array, Mask]:
    """Which faults of two-axis instruments the angle test cannot place, noise aside.

    Returns the direction of the fault between the instrument's first and second axis, over half a turn (directions,)
    [rad]; FI of every instrument (count, directions, count) [rad]: of which instrument failed, then to whose plane; and
    whether more than one lies below `limit` (count, directions). Instruments with other numbers of axes show nan and
    False. Source: section 4.1 of Kim et al.
    """
    cluster = reference.cluster
    angle = np.asarray(np.linspace(0.0, np.pi, directions, endpoint=False), dtype=np.float64)
    FI = np.full((cluster.count, directions, cluster.count), np.nan)
    for k in range(cluster.count):
        mine = np.flatnonzero(cluster.instrument == k)
        if len(mine) == 2:
            fault = np.cos(angle)[:, None] * cluster.V[:, mine[0]] + np.sin(angle)[:, None] * cluster.V[:, mine[1]]
            FI[k] = fault_angles(reference, fault)
    return angle, FI, np.asarray((limit > FI).sum(axis=-1) > 1)


def ambiguous_bands(reference: Reference, limit: float = ANGLE_THRESHOLD) -> tuple[tuple[Band, ...], ...]:
    """`ambiguity_map` without a grid: the faults of each two-axis instrument that lie nearer than `limit` [rad] to
    another's plane.

    For every instrument bands (start, end, other instrument) in rising order; start and end [rad] between 0 and pi are
    directions from its first axis over its second. A band across 0 comes in two parts. In FI_j < limit, that is
    f' (M_j - sin^2(limit)) f < 0 with the projection M_j out of plane j, a fault f at direction a enters by cos 2a and
    sin 2a only. Source: section 4.1 of Kim et al.
    """
    cluster = reference.cluster
    found: list[tuple[Band, ...]] = []
    for k in range(cluster.count):
        mine = cluster.V[:, cluster.instrument == k]
        bands: list[Band] = []
        for other in range(cluster.count) if mine.shape[1] == 2 else ():
            if other == k:
                continue
            M = mine.T @ (reference.plain_outside[1 << other] - np.sin(limit) ** 2 * np.eye(len(mine))) @ mine
            mean, swing = 0.5 * (M[0, 0] + M[1, 1]), np.hypot(0.5 * (M[0, 0] - M[1, 1]), M[0, 1])
            centre = 0.5 * (np.arctan2(2.0 * M[0, 1], M[0, 0] - M[1, 1]) + np.pi)
            half = 0.5 * np.arccos(np.clip(mean / max(swing, _NOTHING * abs(mean), 1e-300), -1.0, 1.0))
            start, length = float((centre - half) % np.pi), float(2.0 * half)
            if length >= np.pi - _NOTHING:
                bands.append((0.0, float(np.pi), other))
            elif length > 0.0:
                beyond = start + length - float(np.pi)
                bands += [(start, min(start + length, float(np.pi)), other)]
                bands += [(0.0, beyond, other)] if beyond > 0.0 else []
        found.append(tuple(sorted(bands)))
    return tuple(found)
