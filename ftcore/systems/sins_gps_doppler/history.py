"""What the SINS/GPS/Doppler system remembers of its past, to fly it again: see :mod:`.hindsight`.

Matrices are made anew when they are needed, so an epoch is a kilobyte or two a run; banks are kept every `SPACING`
epochs. Everything is a value: a checkpoint or a fork keeps its own past.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation.federated import Sharing
from ftcore.estimation.kalman import Innovation
from ftcore.estimation.strapdown import InsState
from ftcore.readings import Group, Readings
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.aid_tests import AidTestResult
from ftcore.systems.sins_gps_doppler.bank import Filters
from ftcore.systems.sins_gps_doppler.filtering import Turns
from ftcore.systems.sins_gps_doppler.forms import Settings
from ftcore.systems.sins_gps_doppler.masters import Verdict
from ftcore.systems.sins_gps_doppler.strapdowns import Damping, Motion

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
T = TypeVar("T", bound=np.generic)

SPAN = 60
"""Epochs that can be flown again at least, once so many have been flown."""
SPACING = 20
"""Epochs between two banks that are kept."""
GAP = 10
"""Epochs without an alarm that end a series of alarms."""
WINDOW = 10
"""Epochs over which the innovations of the fused estimate are remembered."""
_NEEDED = ("gps.pseudorange", "gps.delta_range", "doppler.velocity")


@dataclass(frozen=True)
class Epoch:
    """What an epoch needs to be flown again.

    Attributes:
        settings, sharing, enabled: as they were; ``enabled`` of GPS and Doppler.
        motion, damping, ins: of the strapdowns; ``ins (2 runs,)`` at the end of the epoch.
        changed, jump: where the redundant IMU changed ``(runs,)``, and by how much ``(runs, 2, 3, 3)``.
        opening: ``(runs,)`` by which the filters were opened; see :mod:`.overruled`.
        opened, shift: of the altimeter's bias ``(runs,)``; see :func:`bank.reopen_bias`.
        readings: of GPS and Doppler.
        members: ``(runs, 2)`` that shared the process noise.
        trusted: ``(runs, satellites)``.
        decided, turns: see there.
        wrong: ``(runs, 3)`` GPS and Doppler where not even the filter that is alone may have them, and the altimeter.
    """

    settings: Settings
    sharing: Sharing
    enabled: tuple[bool, bool]
    motion: Motion
    damping: Damping
    ins: InsState
    changed: Flags
    jump: Array
    opening: Array
    opened: Array
    shift: Array
    readings: Readings
    members: Flags
    trusted: Flags
    decided: Verdict
    turns: Turns
    wrong: Flags


@dataclass(frozen=True)
class Culprits:
    """Who was wrong, since when.

    Attributes:
        aids: ``(runs, 2)``. alone: the same, where the filter that is alone shall not have had it either.
        altimeter: ``(runs,)``. satellites: ``(runs, satellites)``.
        since: ``(runs,)`` number of the first epoch that is not trusted.
    """

    aids: Flags
    alone: Flags
    altimeter: Flags
    satellites: Flags
    since: Ints

    @property
    def named(self) -> Flags:
        """``(runs,)`` whether anybody is."""
        return np.asarray(self.aids.any(axis=-1) | self.altimeter | self.satellites.any(axis=-1))

    @property
    def renewed(self) -> Flags:
        """``(runs, 2)`` whether the filter that is alone with GPS, or Doppler, has another past now."""
        satellites = np.column_stack([self.satellites.any(axis=-1), np.zeros_like(self.altimeter)])
        return self.alone | self.altimeter[:, None] | satellites


@dataclass(frozen=True)
class History:
    """What is remembered of the past.

    Attributes:
        now: number of the last epoch.
        banks: (number, bank after that epoch), oldest first.
        epochs: all since the oldest bank.
        since, doubted: first and last epoch of the latest series of alarms ``(runs, 2)`` of GPS and Doppler.
        rest: last epoch in which the cumulative sum was zero ``(runs, 2)``.
        squares: normalised innovations squared against the fused estimate, and their degrees of freedom
            ``(runs, WINDOW, 2, 2)``; both 0 where the aid was not taken in.
    """

    now: int
    banks: tuple[tuple[int, Filters], ...]
    epochs: tuple[Epoch, ...]
    since: Ints
    doubted: Ints
    rest: Ints
    squares: Array


def start(runs: int) -> History:
    """Nothing remembered."""
    never = np.full((runs, 2), -GAP - 1)
    return History(0, (), (), never, never, np.zeros((runs, 2), np.int64), np.zeros((runs, WINDOW, 2, 2)))


def keep(history: History, filters: Filters, anew: bool) -> History:
    """Before an epoch: keep the bank if it is time. ``anew``: the operator has chosen another master or mode, so the
    past cannot be flown again."""
    if anew:
        history = replace(history, banks=(), epochs=())
    if history.banks and history.now % SPACING:
        return history
    return replace(history, banks=(*history.banks, (history.now, filters)))


def light(readings: Readings) -> Readings:
    """The readings without the samples of the inertial unit, which are not needed again."""
    return Readings(readings.time, {name: readings.groups[name] for name in _NEEDED}, readings.aiding)


def remember(
    history: History,
    epoch: Epoch,
    tests: AidTestResult,
    sums: Array,
    predictions: Sequence[Innovation],
    driving: Flags,
) -> History:
    """After an epoch: add it, and what its tests say about an onset.

    ``sums (runs, 2)``: cumulative sums; ``predictions``: of GPS and Doppler, against the fused estimate first;
    ``driving (runs, 2)``: alarms of the driving test.
    """
    now, decided = history.now + 1, epoch.decided
    banks, epochs = history.banks, (*history.epochs, epoch)
    while len(banks) > 1 and banks[1][0] <= now - SPAN:
        epochs = epochs[banks[1][0] - banks[0][0] :]
        banks = banks[1:]
    by_ratio, by_sum = tests.found["glr"].alarm, tests.found["cusum"].alarm
    onset = np.where(by_ratio, now - tests.age, now)
    onset = np.where(by_sum, np.minimum(onset, history.rest + 1), onset)
    doubt = by_ratio | by_sum | tests.found["residual"].alarm | driving
    series = now - history.doubted <= GAP
    since = np.where(doubt, np.where(series, np.minimum(history.since, onset), onset), history.since)
    taken = decided.use & decided.present
    q = np.stack([p.statistic[:, 0] for p in predictions], axis=-1)
    dof = np.stack([np.broadcast_to(p.dof[:, 0], q.shape[:1]) for p in predictions], axis=-1)
    latest = np.stack([q * taken, dof * taken], axis=-1)
    return History(
        now,
        banks,
        epochs,
        since,
        np.where(doubt, now, history.doubted),
        np.where(sums > 0.0, history.rest, now),
        np.concatenate([history.squares[:, 1:], latest[:, None]], axis=1),
    )


def culprits_of_runs(culprits: Culprits, who: Ints, since: Ints) -> Culprits:
    """The culprits of the runs ``who`` alone, with their onsets ``since (runs,)``."""
    return Culprits(
        culprits.aids[who], culprits.alone[who], culprits.altimeter[who], culprits.satellites[who], since[who]
    )


def of_runs(e: Epoch, who: Ints) -> Epoch:
    """The epoch for the runs ``who`` alone."""
    twice = np.column_stack([2 * who, 2 * who + 1]).ravel()
    i = e.motion.interval

    def group(read: Group) -> Group:
        return Group(read.values[who], read.valid if len(read.valid) == 1 else read.valid[who], read.times)

    interval = replace(
        i,
        lla=i.lla[twice],
        v_n=i.v_n[twice],
        f_n=i.f_n[twice],
        C_nb=i.C_nb[twice],
        C_nb_nodes=i.C_nb_nodes[:, twice],
    )
    d, r, g = e.decided, e.readings, e.damping
    return replace(
        e,
        motion=Motion(interval, e.motion.noise[who]),
        damping=Damping(g.height[who], g.above[who], g.present[who], g.gains[who]),
        ins=InsState(e.ins.lla[twice], e.ins.v_n[twice], e.ins.C_nb[twice]),
        changed=e.changed[who],
        jump=e.jump[who],
        opening=e.opening[who],
        opened=e.opened[who],
        shift=e.shift[who],
        readings=Readings(r.time, {name: group(read) for name, read in r.groups.items()}, r.aiding),
        members=e.members[who],
        trusted=e.trusted[who],
        decided=Verdict(d.use[who], d.suspect[who], d.back[who], d.present[who], d.q[who], d.reject[who], d.dof[who]),
        turns=Turns(e.turns.caught[who], e.turns.due[who]),
        wrong=e.wrong[who],
    )


def with_runs(e: Epoch, amended: Epoch, who: Ints) -> Epoch:
    """The epoch with what was amended in the runs ``who``."""

    def put(old: NDArray[T], new: NDArray[T]) -> NDArray[T]:
        whole = old.copy()
        whole[who] = new
        return whole

    d, n = e.decided, amended.decided
    return replace(
        e,
        members=put(e.members, amended.members),
        trusted=put(e.trusted, amended.trusted),
        decided=replace(d, use=put(d.use, n.use), suspect=put(d.suspect, n.suspect), back=put(d.back, n.back)),
        opened=put(e.opened, amended.opened),
        shift=put(e.shift, amended.shift),
        wrong=put(e.wrong, amended.wrong),
    )
