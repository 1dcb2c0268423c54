"""The three 8-state filters of the GPS receiver, carried over together: Chey 2004 (13)-(16).

    0  filter       position-velocity-clock filter with its own innovation test
    1  combined     takes what the snapshot test and the innovation test leave, and restarts from the snapshot
    2  unprotected  takes everything

States, in the paper's order: east and its rate, north and its rate, up and its rate, clock bias and drift [m, m/s], in
a level frame that is laid at the first fix. Arrays are ``(runs, 3, 8)`` and ``(runs, 3, 8, 8)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation import kalman
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver.forms import Filter

Array = NDArray[np.float64]

FILTER, COMBINED, UNPROTECTED = 0, 1, 2
SIZE, STATES = 3, 8
PLACE = np.array([0, 2, 4, 6])
"""East, north, up, clock among the states."""
RATE = PLACE + 1


@dataclass(frozen=True)
class Bank:
    """All three: ``x (runs, 3, 8)``, ``P (runs, 3, 8, 8)``, and which runs have started, ``(runs,)``."""

    x: Array
    P: Array
    started: Flags


def transition(p: Filter, dt: float) -> tuple[Array, Array]:
    """Phi (16) and Q (15), both (8, 8), over ``dt`` seconds."""
    Phi, Q = np.eye(STATES), np.zeros((STATES, STATES))
    Phi[PLACE, RATE] = dt
    white = np.array([0.0, 0.0, 0.0, p.clock_phase_noise])
    walk = np.array([p.position_noise] * 3 + [p.clock_frequency_noise])
    Q[PLACE, PLACE] = white * dt + walk * dt**3 / 3.0
    Q[PLACE, RATE] = Q[RATE, PLACE] = walk * dt**2 / 2.0
    Q[RATE, RATE] = walk * dt
    return Phi, Q


def empty(runs: int) -> Bank:
    """Nobody has started."""
    P = np.broadcast_to(np.eye(STATES), (runs, SIZE, STATES, STATES))
    return Bank(np.zeros((runs, SIZE, STATES)), np.array(P), np.zeros(runs, bool))


def predict(bank: Bank, Phi: Array, Q: Array) -> Bank:
    """Carry all over one epoch."""
    return Bank(*kalman.predict(bank.x, bank.P, Phi, Q), bank.started)


def relaid(bank: Bank, where: Flags, turn: Array, shift: Array) -> Bank:
    """The filters in another level frame, in the runs ``where``: same estimates, other axes and origin.

    Args:
        turn: (runs, 3, 3) from the old axes to the new.
        shift: (runs, 3) of the old origin in the new frame [m].
    """
    if not where.any():
        return bank
    T = np.broadcast_to(np.eye(STATES), (len(where), STATES, STATES)).copy()
    for places in (PLACE[:3], RATE[:3]):
        T[:, places[:, None], places] = turn
    T = T[:, None]
    x = np.matvec(T, bank.x)
    x[..., PLACE[:3]] += shift[:, None]
    P = T @ bank.P @ T.swapaxes(-1, -2)
    row = where[:, None, None]
    return Bank(np.where(row, x, bank.x), np.where(row[..., None], P, bank.P), bank.started)


def design(H: Array) -> Array:
    """Rows for the 8 states (..., n, 8) from rows for position and clock (..., n, 4)."""
    wide = np.zeros((*H.shape[:-1], STATES))
    wide[..., PLACE] = H
    return wide


def restart(bank: Bank, which: int, where: Flags, place: Array, covariance: Array, p: Filter) -> Bank:
    """Filter ``which`` starts, or starts again, from a snapshot in the runs ``where``.

    Args:
        place: (runs, 4) east, north, up, clock [m].
        covariance: (runs, 4, 4) [m^2].
    """
    if not where.any():
        return bank
    x0, P0 = np.zeros((len(place), STATES)), np.zeros((len(place), STATES, STATES))
    x0[:, PLACE] = place
    P0[:, PLACE[:, None], PLACE] = covariance
    P0[:, RATE, RATE] = np.array([p.velocity] * 3 + [p.clock_frequency]) ** 2
    x, P = bank.x.copy(), bank.P.copy()
    x[where, which], P[where, which] = x0[where], P0[where]
    return Bank(x, P, bank.started | where)
