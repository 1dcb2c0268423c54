"""Rotations, vectorised: rotation vectors, matrices, roll-pitch-heading, and ordered products of long sequences.

Conventions as in :mod:`ftcore.earth`: navigation frame n is east-north-up, body frame b is forward-right-down, ``C_nb``
turns b into n. A rotation vector's matrix turns vectors actively by its length about its direction. Angles are
(roll, pitch, heading): roll right wing down, pitch nose up, heading clockwise from north; body axes are reached from
north-east-down by heading, then pitch, then roll.

Shapes: vectors (..., 3), matrices (..., 3, 3), any leading axes. Nothing is changed in place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Levi-Civita symbol laid out so that (vector @ _SKEW) reshaped to 3x3 is the cross-product matrix.
_SKEW = np.zeros((3, 9))
_SKEW[0, 5], _SKEW[0, 7] = -1.0, 1.0
_SKEW[1, 2], _SKEW[1, 6] = 1.0, -1.0
_SKEW[2, 1], _SKEW[2, 3] = -1.0, 1.0
_EYE = np.eye(3)


def _quaternion_products(C: Array) -> Array:
    """4 q_i q_k (..., 4, 4) of the quaternion (w, x, y, z) of ``C`` (..., 3, 3), less 1 on the diagonal; linear."""
    xx, yy, zz = C[..., 0, 0], C[..., 1, 1], C[..., 2, 2]
    a, b, c = C[..., 2, 1] - C[..., 1, 2], C[..., 0, 2] - C[..., 2, 0], C[..., 1, 0] - C[..., 0, 1]
    d, e, f = C[..., 0, 1] + C[..., 1, 0], C[..., 0, 2] + C[..., 2, 0], C[..., 1, 2] + C[..., 2, 1]
    rows = (
        (xx + yy + zz, a, b, c),
        (a, xx - yy - zz, d, e),
        (b, d, yy - xx - zz, f),
        (c, e, f, zz - xx - yy),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


# The same as a matrix from the nine entries of C, row by row: one product instead of thirty calls.
_PRODUCTS = _quaternion_products(np.eye(9).reshape(9, 3, 3)).reshape(9, 16)
_EYE4 = np.eye(4)

# Keeps 0/0 out of sin(x)/x without a branch; its square root is far below any angle that matters.
_TINY = 1e-300


def cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis, (..., 3); numpy's own costs ten times as much on small arrays."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    x = a1 * b2 - a2 * b1
    out = np.empty((*x.shape, 3))
    out[..., 0] = x
    out[..., 1] = a2 * b0 - a0 * b2
    out[..., 2] = a0 * b1 - a1 * b0
    return out


def skew(v: Array) -> Array:
    """Cross-product matrix (..., 3, 3) of ``v`` (..., 3): ``skew(v) @ u == cross(v, u)``."""
    v = np.asarray(v, dtype=np.float64)
    return np.asarray((v @ _SKEW).reshape(*v.shape[:-1], 3, 3))


def rotation_coefficients(angle_squared: Array) -> tuple[Array, Array, Array]:
    """Coefficients ``sin(t)/t``, ``(1-cos t)/t^2``, ``(t-sin t)/t^3`` of Rodrigues' formula and of its integral.

    ``angle_squared``: (...) rad^2, any size from zero. Written with half angles, so that small angles lose no digits;
    the third one is exact to rounding after multiplication by t^2, which is how it is used.
    """
    t2 = angle_squared + _TINY
    half = 0.5 * np.sqrt(t2)
    s = np.sin(half) / half
    a = s * np.cos(half)
    return a, 0.5 * s * s, (1.0 - a) / t2


def rotvec_to_matrix(rotvec: Array) -> Array:
    """Rotation matrix (..., 3, 3) of a rotation vector (..., 3) rad, for any length including zero (Rodrigues)."""
    rotvec = np.asarray(rotvec, dtype=np.float64)
    t2 = np.sum(rotvec * rotvec, axis=-1)
    a, b, _ = rotation_coefficients(t2)
    C = (b[..., None] * rotvec)[..., :, None] * rotvec[..., None, :]
    C += skew(a[..., None] * rotvec)
    C += (1.0 - b * t2)[..., None, None] * _EYE
    return C


def matrix_to_rotvec(C: Array) -> Array:
    """Rotation vector (..., 3) rad, of length at most pi, of a rotation matrix (..., 3, 3).

    Through the quaternion divided by its largest component, so it is accurate at every angle, zero and pi included.
    Source: Shepperd (1978), "Quaternion from rotation matrix".
    """
    C = np.asarray(C, dtype=np.float64)
    rows = (C.reshape(-1, 9) @ _PRODUCTS).reshape(-1, 4, 4) + _EYE4
    # Any row is the quaternion up to a factor; the longest one is the safest.
    best = np.diagonal(rows, axis1=-2, axis2=-1).argmax(axis=-1)
    q = rows[np.arange(len(rows)), best].reshape(*C.shape[:-2], 4)
    q = q * np.where(q[..., :1] < 0.0, -1.0, 1.0)
    w, v = q[..., 0], q[..., 1:]
    sin_half = np.sqrt(np.sum(v * v, axis=-1))
    # angle / sin(angle / 2), with its limit 2 / w at zero; q is not normalised, the ratio does not care.
    small = sin_half < 1e-12 * w
    factor = np.where(small, 2.0 / np.where(small, w, 1.0), 2.0 * np.arctan2(sin_half, w) / np.maximum(sin_half, _TINY))
    return np.asarray(factor[..., None] * v)


def rpy_to_matrix(rpy: Array) -> Array:
    """``C_nb`` (..., 3, 3), body to ENU, of (roll, pitch, heading) (..., 3) rad."""
    rpy = np.asarray(rpy, dtype=np.float64)
    s, c = np.sin(rpy), np.cos(rpy)
    s_r, s_p, s_h = s[..., 0], s[..., 1], s[..., 2]
    c_r, c_p, c_h = c[..., 0], c[..., 1], c[..., 2]
    C = np.empty((*rpy.shape, 3))
    C[..., 0, 0] = s_h * c_p
    C[..., 1, 0] = c_h * c_p
    C[..., 2, 0] = s_p
    C[..., 0, 1] = c_h * c_r + s_h * s_p * s_r
    C[..., 1, 1] = -s_h * c_r + c_h * s_p * s_r
    C[..., 2, 1] = -c_p * s_r
    C[..., 0, 2] = -c_h * s_r + s_h * s_p * c_r
    C[..., 1, 2] = s_h * s_r + c_h * s_p * c_r
    C[..., 2, 2] = -c_p * c_r
    return C


def matrix_to_rpy(C_nb: Array) -> Array:
    """(roll, pitch, heading) (..., 3) rad of ``C_nb`` (..., 3, 3); heading in [0, 2 pi).

    With the nose straight up or down roll and heading are one angle; all of it is then reported as heading.
    """
    C = np.asarray(C_nb, dtype=np.float64)
    cos_pitch = np.hypot(C[..., 0, 0], C[..., 1, 0])
    pitch = np.arctan2(C[..., 2, 0], cos_pitch)
    level = cos_pitch > 1e-9
    roll = np.where(level, np.arctan2(-C[..., 2, 1], -C[..., 2, 2]), 0.0)
    heading = np.where(level, np.arctan2(C[..., 0, 0], C[..., 1, 0]), np.arctan2(-C[..., 1, 1], C[..., 0, 1]))
    return np.stack([roll, pitch, np.mod(heading, 2.0 * np.pi)], axis=-1)


def ordered_product(matrices: Array) -> Array:
    """Product M_0 M_1 ... M_{N-1} of a sequence of square matrices (..., N, k, k), N >= 1, as (..., k, k).

    Neighbours are multiplied pairwise, so it takes log2(N) batched products instead of N - 1 calls.
    """
    count = matrices.shape[-3]
    while count > 1:
        pairs = matrices[..., 0 : count - 1 : 2, :, :] @ matrices[..., 1:count:2, :, :]
        if count % 2:
            pairs = np.concatenate([pairs, matrices[..., -1:, :, :]], axis=-3)
        matrices = pairs
        count = matrices.shape[-3]
    return matrices[..., 0, :, :]


def cumulative_product(matrices: Array) -> Array:
    """Running products (..., N, k, k) of a sequence (..., N, k, k): element i is M_0 M_1 ... M_i.

    Parallel prefix: pairs are multiplied, the half-length sequence is solved the same way, and the elements between are
    filled with one product each. 2 log2(N) batched calls and 2 N matrix products in all. Source: Brent & Kung (1982).
    """
    count = matrices.shape[-3]
    if count == 1:
        return matrices.copy()
    odd = cumulative_product(matrices[..., 0 : count - 1 : 2, :, :] @ matrices[..., 1:count:2, :, :])
    out = np.empty_like(matrices)
    out[..., 0, :, :] = matrices[..., 0, :, :]
    out[..., 1::2, :, :] = odd
    out[..., 2::2, :, :] = odd[..., : (count - 1) // 2, :, :] @ matrices[..., 2::2, :, :]
    return out
