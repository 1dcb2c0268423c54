"""Analytic redundancy: a UKF that flies along without the gyros under suspicion, to say which of them is wrong.

It runs only in an *episode*: from the epoch in which parity space declares more than one gyro (or cannot solve for the
rates) until everybody is trusted again. It starts some steps before that epoch, from states that were stored then, and
comes forward on the readings of the others and on air data (Kim 2005, section 4.2 and figure 2). Its rates are also
what is flown on while nobody is named, and when too few gyros are left.

Shapes lead with runs; in each epoch only the runs in an episode are computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation import kalman, unscented
from ftcore.systems.base import Flags
from ftcore.systems.redundant_imu.forms import MOST_LEAD, Parameters
from ftcore.systems.redundant_imu.model import AIR_STATES, MODELLED, RATES, FlightModel, within
from ftcore.systems.redundant_imu.names import EPOCH, INSTRUMENTS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

L = len(MODELLED)
AXES = 2 * INSTRUMENTS
RULE = unscented.Rule(redraw=False)
CLEAR = 5
"""Epochs in a row without a detection after which a doubt is dropped."""


@dataclass(frozen=True)
class Moment:
    """What is stored of one epoch, so that a filter can start there.

    Attributes:
        x: ``(runs, 9)`` navigated states.
        power, u: ``(runs,)`` and ``(runs, 4)``, engine power at this epoch and controls from it to the next.
        y, valid: ``(runs, 10)`` readings of six gyro axes and of air data.
    """

    x: Array
    power: Array
    u: Array
    y: Array
    valid: Flags


@dataclass(frozen=True)
class Episode:
    """The filters, and what they are about.

    Attributes:
        active: ``(runs,)`` the filter runs.
        open: ``(runs,)`` it is not known yet which of the suspects is wrong, or whether any is.
        suspects: ``(runs, 3)`` declared by parity space when it started; the filter does not take their readings.
        quiet: ``(runs,)`` epochs in a row without a detection.
        x, P: ``(runs, 9)``, ``(runs, 9, 9)``; meaningless where not active.
        past: the last epochs, the latest last.
    """

    active: Flags
    open: Flags
    suspects: Flags
    quiet: Ints
    x: Array
    P: Array
    past: tuple[Moment, ...]


class AnalyticRedundancy:
    """The UKF and its bookkeeping.

    Args:
        model: of the aircraft.
        H: ``(6, 3)`` input axes.
        p: noise of gyros and air data, trust in the model.
    """

    def __init__(self, model: FlightModel, H: Array, p: Parameters) -> None:
        self._model = model
        self._axes = H.reshape(INSTRUMENTS, 2, 3)
        self._seen = np.zeros((AXES + len(AIR_STATES), L))
        self._seen[:AXES, RATES] = H
        self._seen[np.arange(AXES, len(self._seen)), AIR_STATES] = 1.0
        a, t, gyro = p.air_data, p.trust, p.gyros.noise
        angle = np.deg2rad(a.angle)
        self._gyro = np.full(2, gyro**2)
        self._R = np.square([*[gyro] * AXES, a.speed, angle, angle, a.height])
        self._Q = np.diag(
            np.square(EPOCH * np.array([t.speed, *[t.wind] * 2, *[t.attitude] * 2, *[t.rate] * 3, t.height]))
        )
        # As good as what is stored: air data as read, rates of two instruments, attitude after some gyro noise.
        self._P0 = np.diag(np.square([a.speed, angle, angle, 0.005, 0.005, gyro, gyro, gyro, a.height]))

    def initial(self, start: Moment) -> Episode:
        """Nobody under suspicion."""
        runs = len(start.x)
        return Episode(
            active=np.zeros(runs, bool),
            open=np.zeros(runs, bool),
            suspects=np.zeros((runs, INSTRUMENTS), bool),
            quiet=np.zeros(runs, np.int64),
            x=start.x,
            P=np.array(np.broadcast_to(self._P0, (runs, L, L))),
            past=(start,),
        )

    def advance(self, episode: Episode, now: Moment, begin: Flags, suspects: Flags, out: Flags, lead: int) -> Episode:
        """One epoch: filters that run go on, those that ``begin`` start ``lead`` epochs ago and catch up.

        Args:
            now: readings of this epoch (its states, power and controls are not used).
            begin: ``(runs,)``.
            suspects: ``(runs, 3)`` who is declared, for those that begin.
            out: ``(runs, 3)`` whose readings no filter takes: isolated, off, without a reading.
            lead: epochs.
        """
        going = episode.active & ~begin
        if not (going.any() or begin.any()):
            return episode
        accused = np.where(begin[:, None], suspects, episode.suspects)
        trusted = ~(accused | out)
        x, P = episode.x.copy(), episode.P.copy()
        moments = (*episode.past[-lead:], now)
        if begin.any():
            rows = np.flatnonzero(begin)
            x[rows], P[rows] = self._run(moments[0].x[rows], self._P0, moments, trusted, rows)
        if going.any():
            rows = np.flatnonzero(going)
            x[rows], P[rows] = self._run(x[rows], P[rows], moments[-2:], trusted, rows)
        return Episode(
            active=episode.active | begin,
            open=np.where(begin, suspects.any(axis=-1), episode.open),
            suspects=accused,
            quiet=np.where(begin, 0, episode.quiet),
            x=x,
            P=P,
            past=episode.past,
        )

    def settle(self, episode: Episode, detected: Flags, isolated: Flags, blind: Flags, now: Moment) -> Episode:
        """The end of an epoch: what is settled, which filters rest, and what is stored.

        A doubt is settled when one of the suspects is isolated, or dropped after `CLEAR` epochs without a detection.
        The filter rests when nobody is in doubt, nobody isolated and the rates can be solved for.

        Args:
            detected: ``(runs,)`` by parity space.
            isolated: ``(runs, 3)``.
            blind: ``(runs,)`` rates cannot be solved from the gyros there are.
            now: this epoch, to be stored.
        """
        quiet = np.where(detected, 0, episode.quiet + 1)
        decided = (episode.suspects & isolated).any(axis=-1)
        dropped = episode.open & ~decided & (quiet >= CLEAR)
        open_ = episode.open & ~decided & ~dropped
        active = episode.active & (open_ | isolated.any(axis=-1) | blind)
        keep = active & ~dropped
        return Episode(
            active=active,
            open=open_,
            suspects=episode.suspects & keep[:, None],
            quiet=quiet,
            x=episode.x,
            P=episode.P,
            past=(*episode.past[-(MOST_LEAD - 1) :], now),
        )

    def residuals(self, episode: Episode, m: Array) -> tuple[Array, Array]:
        """Residuals (48)-(49) of readings ``m (runs, 6)``, and their statistic for every gyro, ``(runs, 3)``.

        r' (H_i P H_i' + sigma^2 I)^-1 r, chi-square on 2 for a gyro whose readings the filter does not take.
        """
        runs = len(m)
        seen = kalman.innovation(
            episode.x[:, None, RATES],
            episode.P[:, None, RATES, RATES],
            m.reshape(runs, INSTRUMENTS, 2),
            self._axes,
            self._gyro,
        )
        return seen.innovation.reshape(runs, AXES), seen.statistic

    def _run(self, x: Array, P: Array, moments: Sequence[Moment], trusted: Flags, rows: Ints) -> tuple[Array, Array]:
        """From the first of the moments to the last, taking in the readings of all but the first."""
        gyros = np.repeat(trusted[rows], 2, axis=1)
        usable = np.concatenate([gyros, np.ones((len(rows), len(AIR_STATES)), bool)], axis=1)
        for before, after in pairwise(moments):
            power, u = before.power[rows], before.u[rows]
            predicted = unscented.predict(x, P, lambda X, p=power, u=u: self._model.fly(X, p, u), self._Q, RULE)  # type: ignore[misc]
            # The readings are linear in the states: (41)-(47) are then the Kalman update, without points.
            y, valid = after.y[rows], after.valid[rows] & usable
            done = kalman.update(predicted.x, predicted.P, y, self._seen, self._R, valid)
            x, P = within(done.x), done.P
        return x, P
