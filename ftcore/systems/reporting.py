"""What the reporters of several systems do alike: columns of the recording, and the state of diagram and scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Health
from ftcore.estimation import kalman
from ftcore.systems.base import HEALTH, Controls, Output

Array = NDArray[np.float64]

LEVEL = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
"""Body to level for level flight to the north: what is shown before the first epoch."""


@dataclass(frozen=True)
class Truth:
    """What really is, at the end of an epoch: arrays lead with 1, all runs fly the same path."""

    lla: Array
    v_n: Array
    C_nb: Array
    rpy: Array


def navigation_columns(error: Array, P: Array) -> Array:
    """Errors ``(runs, estimators, 9)`` [SI] and covariances ``(runs, estimators, 9, 9)`` as the signals that
    :func:`ftcore.systems.declarations.navigation_signals` declares, ``(runs, estimators * 20)``."""
    sigma = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    horizontal = np.sqrt(error[..., 0:1] ** 2 + error[..., 1:2] ** 2)
    nees = kalman.nees(error, P)[..., None]
    return np.concatenate([error, sigma, horizontal, nees], axis=-1).reshape(len(error), -1)


def columns_of_tests(output: Output) -> Array:
    """Statistic, threshold, degrees of freedom and alarm of every test, ``(runs, tests * 4)``."""
    columns = np.stack([output.statistic, output.threshold, output.dof, output.alarm], axis=-1)
    return columns.reshape(len(columns), -1)


def flight_columns(truth: Truth, runs: int) -> Array:
    """Height [m], speed [m/s], roll, pitch and heading [rad] that are really flown, ``(runs, 5)``."""
    flight = np.empty((runs, 5))
    flight[:, 0] = truth.lla[0, 2]
    flight[:, 1] = np.linalg.norm(truth.v_n[0])
    flight[:, 2:] = truth.rpy
    return flight


def healths(subjects: Sequence[str], output: Output | None, controls: Controls) -> dict[str, Health]:
    """Health of every subject in run 0; what the operator has switched off is off, whatever is thought of it."""
    found: dict[str, Health] = {subject: "ok" for subject in subjects}
    if output is not None:
        found |= {s: HEALTH[output.health[0, i]] for i, s in enumerate(subjects)}  # type: ignore[misc]
    return found | {name: "off" for name, on in controls.enabled.items() if not on}


def vector(v: Array) -> tuple[float, float, float]:
    """Three numbers of the scene."""
    return (float(v[0]), float(v[1]), float(v[2]))


def quaternion(C: Array) -> tuple[float, float, float, float]:
    """A rotation matrix ``(3, 3)`` as w, x, y, z."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(C).as_quat()
    return (float(w), float(x), float(y), float(z))
