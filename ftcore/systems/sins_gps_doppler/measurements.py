"""Measurement equations of the two local filters: Zhang 1992 (59)-(62), as resolved in FTLab.

GPS:      y1 = rho_G - rho_I          = e . dr + d_tu,  and the same for the rates
Doppler:  y2 = C_bn v_I - v_D         = C_bn (dv - d_k v - d_Delta (up x v) + v x T)        in body axes

Zhang 1992 leaves the attitude term v x T out; at 300 m/s an azimuth error of 1 mrad is 0.3 m/s, more than the radar's
noise, so it is kept. Body axes keep one row an axis: a lost axis is a lost row. e points from the user to the
satellite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.estimation.ins_error import (
    ATTITUDE,
    CLOCK_FREQUENCY,
    CLOCK_PHASE,
    DOPPLER_DRIFT,
    DOPPLER_SCALE,
    POSITION,
    STATES,
    VELOCITY,
)
from ftcore.estimation.strapdown import InsState
from ftcore.rotation import skew

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measurement:
    """y ``(runs, m)`` and H ``(runs, m, 21)``."""

    y: Array
    H: Array


@dataclass(frozen=True)
class Geometry:
    """Lines of sight as the navigator sees them: ``e_n (runs, satellites, 3)`` unit vectors user to satellite."""

    e_n: Array


def gps(
    ins: InsState, satellites: Array, velocities: Array, ranges: Array, rates: Array
) -> tuple[Measurement, Geometry]:
    """Pseudoranges, then delta pseudoranges, against the strapdown's prediction.

    Args:
        ins: indicated state, ``(runs, ...)``.
        satellites, velocities: ``(s, 3)`` broadcast position and velocity, ECEF [m, m/s].
        ranges, rates: ``(runs, s)`` readings [m, m/s].
    """
    s = len(satellites)
    C_en = earth.enu_to_ecef_matrix(ins.lla[..., 0], ins.lla[..., 1])
    line_n = (satellites - earth.geodetic_to_ecef(ins.lla)[:, None]) @ C_en
    rho = np.sqrt(np.vecdot(line_n, line_n))
    e_n = line_n / rho[..., None]
    relative_n = velocities @ C_en - ins.v_n[:, None]
    rho_rate = np.vecdot(e_n, relative_n)
    H = np.zeros((len(rho), 2 * s, STATES))
    H[:, :s, POSITION] = e_n
    H[:, :s, CLOCK_PHASE] = 1.0
    # The line of sight turns with the position error: (v - e (e.v)) / rho, 0.2 mm/s a metre.
    H[:, s:, POSITION] = (relative_n - e_n * rho_rate[..., None]) / rho[..., None]
    H[:, s:, VELOCITY] = e_n
    H[:, s:, CLOCK_FREQUENCY] = 1.0
    y = np.concatenate([ranges - rho, rates - rho_rate], axis=-1)
    return Measurement(y, H), Geometry(e_n)


def doppler(ins: InsState, velocity_b: Array) -> Measurement:
    """The strapdown's velocity in body axes minus the radar's, ``velocity_b (runs, 3)`` [m/s]."""
    C_bn = ins.C_nb.swapaxes(-1, -2)
    v = ins.v_n
    up_cross_v = np.stack([-v[..., 1], v[..., 0], np.zeros_like(v[..., 0])], axis=-1)
    H_n = np.zeros((len(v), 3, STATES))
    H_n[:, :, VELOCITY] = np.eye(3)
    H_n[:, :, ATTITUDE] = skew(v)
    H_n[:, :, DOPPLER_SCALE] = -v
    H_n[:, :, DOPPLER_DRIFT] = -up_cross_v
    return Measurement(np.matvec(C_bn, v) - velocity_b, C_bn @ H_n)
