"""Weighted least squares on pseudoranges: a position and a clock from one epoch, for many runs at once.

Unknowns are the offset from a *working point* (east, north, up) and the receiver clock, all in metres: y = H x + e,
rows H = (-e_n, 1), where e_n is the unit vector from the receiver to the satellite (Chey 2004 (1)). Shapes lead with
``(runs,)``; n satellites, of which those not ``valid`` drop out exactly as if they had been deleted.

A working point that is D metres off costs D^2 / 2 rho of range, 2 um at 10 m and 25 mm at 1 km, so a solution is
repeated from where it ended only after a cold start or a long way.
Source: J. Chey, G.-I. Jee and J.G. Lee, ICCAS 2004, (1)-(10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import earth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNKNOWNS = 4
"""East, north, up, clock."""
_SINGULAR = 1e-9
"""A normal matrix of unit diagonal with a smaller determinant has no solution worth the name (a DOP of thousands)."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """Satellites as seen from working points.

    ``range`` (..., n) m, with the turn of the Earth while the signal travels; ``H`` (..., n, 4); ``unit_n`` (..., n, 3)
    from the receiver to the satellite, local level.
    """

    range: Array
    H: Array
    unit_n: Array


@dataclass(frozen=True, slots=True)
class Fix:
    """One weighted least-squares solution; ``normalised`` means divided by the measurement's own sigma.

    Attributes:
        x: (..., 4) offset from the working point and clock [m].
        covariance: (..., 4, 4) [m^2].
        gain: (..., 4, n), x = gain @ normalised measurement.
        projector: (..., n, n) S of (10), what the solution leaves over: residual = S @ normalised measurement.
        residual: (..., n) normalised, 0 where not valid.
        dof: (...) satellites minus unknowns, at least 0.
        valid: (..., n) satellites taken in.
        solved: (...) whether there is a solution; x and covariance are meaningless elsewhere.
    """

    x: Array
    covariance: Array
    gain: Array
    projector: Array
    residual: Array
    dof: NDArray[np.int64]
    valid: Mask
    solved: Mask

    @property
    def statistic(self) -> Array:
        """Weighted sum of squared residuals, (...): chi-square on ``dof`` while nothing has failed. Source: (12)."""
        return np.asarray(np.vecdot(self.residual, self.residual))


def geometry(position_e: Array, C_en: Array, satellites_e: Array) -> Geometry:
    """Predicted ranges and directions.

    Args:
        position_e: (..., 3) working points, Earth-fixed [m].
        C_en: (..., 3, 3) local level to Earth-fixed.
        satellites_e: (n, 3) at the time of emission, in the Earth-fixed frame of that time [m].

    The turn of the Earth during the travel is added to the range (IS-GPS-200, 20.3.3.4.3.4; exact to a millimetre).
    """
    to_satellite = satellites_e - position_e[..., None, :]
    distance = np.sqrt(np.vecdot(to_satellite, to_satellite))
    unit_n = (to_satellite / distance[..., None]) @ C_en
    H = np.ones((*unit_n.shape[:-1], UNKNOWNS))
    np.negative(unit_n, out=H[..., :3])
    return Geometry(distance + sagnac(position_e[..., None, :], satellites_e), H, unit_n)


def sagnac(position_e: Array, satellites_e: Array) -> Array:
    """What the turn of the Earth during the signal's travel adds to the range [m]; (..., 3) each, broadcasting."""
    turn: Array = satellites_e[..., 0] * position_e[..., 1] - satellites_e[..., 1] * position_e[..., 0]
    return turn * (earth.RATE / earth.SPEED_OF_LIGHT)


def solve(H: Array, y: Array, sigma: Array, valid: Mask) -> Fix:
    """Weighted least squares, (7)-(10) of the paper with measurements made unit by their sigma, (3)-(5).

    Args:
        H: (..., n, 4).
        y: (..., n) measured minus predicted ranges [m].
        sigma: (..., n) or broadcasting to it [m].
        valid: (..., n).
    """
    weight = np.where(valid, 1.0 / sigma, 0.0)
    Hw = H * weight[..., None]
    yw = np.where(valid, y, 0.0) * weight
    normal = Hw.swapaxes(-1, -2) @ Hw
    count = np.count_nonzero(valid, axis=-1)
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 1e-30))
    unit = normal * (scale[..., :, None] * scale[..., None, :])
    solved = np.asarray((count >= UNKNOWNS) & (np.linalg.det(unit) > _SINGULAR))
    if not solved.all():
        unit = np.where(solved[..., None, None], unit, np.eye(UNKNOWNS))
    covariance = np.linalg.inv(unit) * (scale[..., :, None] * scale[..., None, :])
    gain = covariance @ Hw.swapaxes(-1, -2)
    projector = _diagonal(valid) - Hw @ gain
    x = np.matvec(gain, yw)
    return Fix(
        x=x,
        covariance=covariance,
        gain=gain,
        projector=projector,
        residual=yw - np.matvec(Hw, x),
        dof=np.where(solved, count - UNKNOWNS, 0),
        valid=np.asarray(valid & solved[..., None]),
        solved=solved,
    )


def elevation(unit_n: Array) -> Array:
    """Angle above the horizon [rad] of unit vectors (..., 3), local level."""
    return np.asarray(np.arcsin(np.clip(unit_n[..., 2], -1.0, 1.0)))


def azimuth(unit_n: Array) -> Array:
    """Angle from north, clockwise, in [0, 2 pi) [rad], of unit vectors (..., 3), local level."""
    return np.asarray(np.mod(np.arctan2(unit_n[..., 0], unit_n[..., 1]), 2.0 * np.pi))


def hdop(H: Array, valid: Mask, solved: Mask) -> Array:
    """Horizontal dilution of precision (...), of satellites of equal weight; NaN where there is no solution."""
    Hv = H * valid[..., None]
    normal = np.where(solved[..., None, None], Hv.swapaxes(-1, -2) @ Hv, np.eye(UNKNOWNS))
    cofactor = np.linalg.inv(normal)
    return np.where(solved, np.sqrt(np.abs(cofactor[..., 0, 0] + cofactor[..., 1, 1])), np.nan)


def _diagonal(valid: Mask) -> Array:
    return np.asarray(valid[..., None] * np.eye(valid.shape[-1]))
