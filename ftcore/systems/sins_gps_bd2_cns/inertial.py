"""The IMU that is fitted, plain or redundant: channels, place in the scene, and what is said of it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Channel, SceneItem
from ftcore.faults import ALL_KINDS
from ftcore.parts import instruments
from ftcore.parts.declared import Declared
from ftcore.parts.instruments import AXES as PAIRS
from ftcore.parts.instruments import CLUSTERS

Array = NDArray[np.float64]

BODY: Final = ("x", "y", "z")
AXES: Final = (*BODY, *PAIRS)
"""Columns of the inertial groups: the plain IMU's axes, then the redundant IMU's. One of the two is fitted."""


def _channel(cluster: str, part: str, label: str, sensor: str, parts: tuple[int, ...]) -> Channel:
    unit, typical = CLUSTERS[cluster]
    return Channel(
        name=f"imu.{cluster}.{part}",
        label=f"{cluster.capitalize()}{label}",
        unit=unit,
        sensor=sensor,
        group=f"imu.{cluster}",
        parts=parts,
        kinds=ALL_KINDS,
        typical=typical,
    )


def _channels(cluster: str) -> tuple[Channel, ...]:
    group = f"imu.{cluster}"
    return (
        *(_channel(cluster, axis, f" {axis}", group, (i,)) for i, axis in enumerate(BODY)),
        *(
            _channel(cluster, axis, f" {axis} (redundant IMU)", f"{group}.{axis[0]}", (len(BODY) + i,))
            for i, axis in enumerate(PAIRS)
        ),
        _channel(cluster, "all", ", all axes", group, tuple(range(len(AXES)))),
    )


DECLARED: Final = instruments.declared("without the redundant IMU", " of the redundant IMU") + Declared(
    channels=tuple(channel for cluster in CLUSTERS for channel in _channels(cluster)),
    scene=(
        SceneItem(id="aircraft", label="aircraft", kind="aircraft", frame="level", family="aircraft"),
        *(
            SceneItem(
                id=f"axis.{cluster}.{axis}",
                label=f"{cluster[0].upper()}{axis}",
                kind="axis",
                family="IMU" if axis in BODY else f"instrument {axis[0]}",
                channel=f"imu.{cluster}.{axis}",
                subject=None if axis in BODY else f"imu.{cluster}.{axis[0]}",
            )
            for cluster in CLUSTERS
            for axis in AXES
        ),
    ),
)


def vectors(axes: Array) -> dict[str, Array]:
    """Scene items of the IMU that is fitted, whose input axes are ``axes (k, 3)``."""
    names = PAIRS if len(axes) == len(PAIRS) else BODY
    return {
        f"axis.{cluster}.{name}": instruments.LENGTH[cluster] * axis
        for cluster in CLUSTERS
        for name, axis in zip(names, axes, strict=True)
    }
