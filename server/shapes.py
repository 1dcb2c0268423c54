"""Meshes of the 3-D scene."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]


def square(half: float) -> Mesh:
    """A square patch in the x-y plane."""
    corners = [(-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0)]
    return np.array(corners, np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def aircraft(length: float) -> Mesh:
    """A schematic aircraft in body axes: nose along x (forward), right wing along y, fin along -z."""
    vertices = np.array(
        [
            (1.0, 0.0, 0.0), (-0.9, 0.10, 0.0), (-0.9, -0.10, 0.0), (-0.2, 0.0, -0.16), (-0.2, 0.0, 0.10),
            (0.35, 0.0, 0.0), (-0.45, 0.95, 0.0), (-0.62, 0.95, 0.0), (-0.45, -0.95, 0.0), (-0.62, -0.95, 0.0),
            (-0.5, 0.0, 0.0), (-0.62, 0.0, -0.05), (-0.95, 0.42, 0.0), (-0.95, -0.42, 0.0), (-0.62, 0.0, 0.0),
            (-0.95, 0.0, -0.42), (-0.9, 0.0, 0.0),
        ],
        np.float32,
    )  # fmt: skip
    faces = np.array(
        [
            [0, 1, 3], [0, 3, 2], [1, 2, 3], [0, 4, 1], [0, 2, 4], [1, 4, 2],
            [5, 6, 7], [5, 7, 10], [5, 9, 8], [5, 10, 9],
            [14, 12, 16], [14, 16, 13], [11, 15, 16],
        ],
        np.uint32,
    )  # fmt: skip
    return vertices * np.float32(length), faces


def turn_z_to(vector: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of the shortest turn from the z axis to ``vector``; no turn for no direction."""
    length = math.hypot(*vector)
    if not math.isfinite(length) or length < 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    x, y, z = (part / length for part in vector)
    if z < -1.0 + 1e-9:
        return (0.0, 1.0, 0.0, 0.0)
    w = math.sqrt(0.5 * (1.0 + z))
    return (w, -y / (2.0 * w), x / (2.0 * w), 0.0)
