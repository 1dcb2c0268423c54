"""Measurements of the three aiding sensors against the strapdown: Yang 2016 (5)-(8), as resolved in FTLab.

GPS, BD2:  z = r_SINS - r = H x,      H = [I 0 0 0 0]
CNS:       z = rpy_SINS - rpy = H x,  H = [0 0 J 0 0]

J turns the level-frame rotation error phi of :mod:`ftcore.estimation.ins_error` into errors of roll, pitch and heading;
it is the "conversion matrix" of (8), which the paper does not print.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.estimation.ins_error import ATTITUDE, CORE_STATES, POSITION
from ftcore.estimation.strapdown import InsState
from ftcore.rotation import matrix_to_rpy

Array = NDArray[np.float64]
SUBJECTS, ROWS = 3, 3
_EYE = np.eye(3)


@dataclass(frozen=True)
class Chart:
    """Metres about a datum ``lla (3,)``: latitude, longitude [rad], height [m].

    A receiver's fix is latitude, longitude and height; a person, a fault and a table of errors think in metres. The
    principal radii at the datum tie the two: exact to invert, and metric to first order (a degree of latitude away
    from the datum a metre east is 1 % off).
    """

    datum: Array

    @cached_property
    def metres(self) -> Array:
        """Metres east a radian of longitude, north a radian of latitude, up a metre, ``(3,)``."""
        r_m, r_n = earth.principal_radii(self.datum[0])
        height = self.datum[2]
        return np.array([(r_n + height) * np.cos(self.datum[0]), r_m + height, 1.0])

    def to_metres(self, lla: Array) -> Array:
        """``(..., 3)`` latitude, longitude, height to east, north, up [m]."""
        d = (lla - self.datum)[..., [1, 0, 2]]
        d[..., 0] -= 2.0 * np.pi * np.round(d[..., 0] / (2.0 * np.pi))
        return np.asarray(d * self.metres)


def attitude_rows(rpy: Array) -> Array:
    """J ``(..., 3, 3)``: errors of roll, pitch and heading by a rotation error phi east, north, up, at ``rpy`` [rad].

    Not for a nose that points straight up or down, where roll and heading are one angle.
    """
    pitch, heading = rpy[..., 1], rpy[..., 2]
    s, c = np.sin(heading), np.cos(heading)
    cos_pitch, tan_pitch = np.cos(pitch), np.tan(pitch)
    J = np.zeros((*rpy.shape, 3))
    J[..., 0, 0], J[..., 0, 1] = s / cos_pitch, c / cos_pitch
    J[..., 1, 0], J[..., 1, 1] = c, -s
    J[..., 2, 0], J[..., 2, 1], J[..., 2, 2] = s * tan_pitch, c * tan_pitch, -1.0
    return J


def aids(ins: InsState, chart: Chart, readings: Array) -> tuple[Array, Array]:
    """z ``(runs, 3, 3)`` of GPS, BD2 and CNS, and H ``(runs, 3, 3, 15)``.

    Args:
        ins: indicated state ``(runs, ...)``.
        readings: ``(runs, 3, 3)``: of GPS and BD2 east, north, up in the chart [m], of CNS roll, pitch, heading [rad].
    """
    runs = len(ins.lla)
    rpy = matrix_to_rpy(ins.C_nb)
    z = np.empty((runs, SUBJECTS, ROWS))
    # The chart is metric at its datum; errors are metres where the aircraft is.
    r_m, r_n = earth.principal_radii(ins.lla[:, 0])
    height = ins.lla[:, 2]
    here = np.ones((runs, 3))
    here[:, 0], here[:, 1] = (r_n + height) * np.cos(ins.lla[:, 0]), r_m + height
    z[:, :2] = (chart.to_metres(ins.lla)[:, None] - readings[:, :2]) * (here / chart.metres)[:, None]
    turn = rpy - readings[:, 2]
    z[:, 2] = turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    H = np.zeros((runs, SUBJECTS, ROWS, CORE_STATES))
    H[:, :2, :, POSITION] = _EYE
    H[:, 2, :, ATTITUDE] = attitude_rows(rpy)
    return z, H
