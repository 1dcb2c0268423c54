"""The inertial solution overruled by GPS and Doppler: see :mod:`ftcore.detection.overruling`.

GPS has to be there. Its satellites determine position and velocity many times over, so they agree with each other or
not, and Doppler agrees with them or not; Doppler alone would agree with itself. The receiver's clock is not opened: a
jump that all satellites have in common is no matter of the inertial solution.

In the epoch after the verdict every filter on the protected strapdown is given the opening as process noise, and the
aids that were out are taken back. The altimeter comes back by itself: its witness is opened too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import overruling, supervisor
from ftcore.estimation.ins_error import ALTIMETER_BIAS, STATES
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.aids import Aid
from ftcore.systems.sins_gps_doppler.bank import FUSED, INS_OF_FILTER, Filters
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch

Array = NDArray[np.float64]

POSITION, VELOCITY, ATTITUDE = 10.0, 1.0, 3e-3
"""Basic opening [m, m/s, rad]: what a tilt of that size makes of velocity and position within half a minute."""
BASIC = np.array([POSITION] * 3 + [VELOCITY] * 3 + [ATTITUDE] * 3 + [0.0] * (STATES - 9))
BY_RANGES, BY_DOPPLER = 6, 2
"""Combinations of opened states that GPS determines, and Doppler besides: attitude but for a roll about the path."""


@dataclass(frozen=True)
class State:
    """What is carried from epoch to epoch.

    Attributes:
        votes: see there.
        opening: ``(runs,)`` factor of `BASIC` by which the next epoch opens the filters; 0 where it does not.
    """

    votes: overruling.State
    opening: Array


def start(runs: int) -> State:
    """Nobody doubted."""
    return State(overruling.start(runs), np.zeros(runs))


def judge(state: State, prior: Filters, pair: tuple[Aid, Aid], there: Flags, out: Flags, imu: ImuEpoch) -> State:
    """After an epoch: whether the next one opens the filters.

    Args:
        prior: filters as predicted in this epoch.
        pair: GPS, without satellites that integrity has left out, and Doppler.
        there, out: ``(runs, 2)`` with a reading, and isolated.
    """
    doubtful = (imu.series > 0).any(axis=-1) | imu.undecided.isolated.any(axis=-1)
    doubtful = np.asarray(doubtful | imu.decision.isolated.any(axis=-1))
    opening = np.zeros(len(out))
    asked = overruling.asked(state.votes, out, there) & there[:, 0]
    if asked.any():
        who = np.flatnonzero(asked)
        y, H = (np.concatenate([getattr(aid, field)[who, 0] for aid in pair], axis=1) for field in ("y", "H"))
        R = np.concatenate([aid.R[0] for aid in pair], axis=-1)
        valid = np.concatenate([np.broadcast_to(aid.valid, (len(out), aid.valid.shape[-1])) for aid in pair], axis=-1)
        determined = BY_RANGES + BY_DOPPLER * there[who, 1].astype(np.int64)
        opening[who] = overruling.smallest_opening(
            prior.x[who, FUSED], prior.P[who, FUSED], y, H, R, valid[who], BASIC, determined
        )
    agree = asked & np.isfinite(opening)
    votes, due = overruling.step(state.votes, doubtful, out, agree)
    return State(votes, np.where(due, overruling.MARGIN * np.where(due, opening, 0.0), 0.0))


def reopen(filters: Filters, opening: Array, biases: Array, factors: Array) -> Filters:
    """Every filter on the protected strapdown with its share of the ``opening (runs,)``, in factors of `BASIC`.

    ``biases (21, 21)``: covariance of the instruments' biases at switch-on: what was learned of them may be a fault, so
    they are opened in the same factors. ``factors (runs or 1, 3)`` as in `filtering.bias_jump`.
    """
    if not opening.any():
        return filters
    P = filters.P.copy()
    protected = np.flatnonzero(INS_OF_FILTER == 0)
    share = np.ones((len(P), len(protected), 1, 1))
    share[:, :3, 0, 0] = factors
    wide = BASIC.copy()
    wide[ALTIMETER_BIAS] = POSITION
    D = np.square(opening)[:, None, None] * (np.diag(np.square(wide)) + biases)
    P[:, protected] += share * D[:, None]
    return Filters(filters.x, P)


def taken_back(state: supervisor.State, opening: Array) -> supervisor.State:
    """The supervisor of GPS and Doppler: those that were out are in again, where the filters are opened."""
    if not opening.any():
        return state
    back = (opening > 0.0)[:, None] & (state.health == supervisor.ISOLATED)
    return replace(
        state,
        health=np.where(back, np.int8(supervisor.HEALTHY), state.health),
        history=np.where(back, np.uint64(0), state.history),
        streak=np.where(back, 0, state.streak),
    )
