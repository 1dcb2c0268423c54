"""Back to before the onset: a culprit that is named late is taken out of the past too.

What a filter took in before the culprit was found stays in it: these filters forget slowly. So some older banks are
kept, and what is needed to fly the epochs since then again (:mod:`.history`). When somebody is named who was trusted
since the onset, the bank is flown again from before it, with the decisions of then but without the culprit:

    GPS, Doppler   not fused from the onset on, as if isolated then. The filters that are alone keep their own sensor.
    a satellite    both of its rows are left out from the onset on.
    altimeter      by how much it moved the strapdown is known, whatever it read: a known input in place of damping.

The strapdown itself need not be flown again, its errors are what the filters estimate. Every run has an onset of its
own and is flown again by itself or with those that share its start; nothing happens in other runs.

Onset. The likelihood ratio names one within its window, the cumulative sum the epoch in which it left zero, other tests
the epoch of their alarm. The earliest of a series of alarms counts, a series ending when no test has alarmed for `GAP`
epochs; and `MARGIN` epochs are added, in which a slow fault was too small to be seen. If the onset lies before the
oldest bank that is kept, the flight starts from that.

Contradiction. A driving test may be blind to a fault, and let the fused estimate swallow it; the state test of Zhang
1992 is, after half a minute. Then the fused estimate contradicts the measurements that it takes in: their normalised
innovations are summed over up to `WINDOW` epochs. If chance explains the sum with less than `P_CONTRADICTION`, and the
aid's own tests
doubt it too, the aid was wrong since that doubt began: what it said until now is taken out again. It is not isolated;
that is for the driving test to say.

Source: FTLab's own. Onset estimates: A.S. Willsky and H.L. Jones (1976); E.S. Page (1954).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square
from ftcore.estimation import federated
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler import aids, bank, filtering, overruled, strapdowns
from ftcore.systems.sins_gps_doppler.bank import ALONE, CENTRAL, Filters
from ftcore.systems.sins_gps_doppler.forms import Aiding
from ftcore.systems.sins_gps_doppler.history import GAP, Culprits, Epoch, History, culprits_of_runs, of_runs, with_runs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MARGIN = 2
"""Epochs before the onset that are not trusted either."""
FEWEST = 5
"""Epochs at least over which a contradiction is judged."""
P_CONTRADICTION = 1e-6
"""Tail probability of the sum of normalised innovations."""


def review(
    history: History,
    filters: Filters,
    isolated: Flags,
    satellites: Flags,
    altimeter: tuple[Flags, Ints],
    a: Aiding,
    variance: float,
    biases: Array,
) -> tuple[History, Filters, Culprits | None]:
    """After an epoch: fly it again from before the onset where somebody was named who did harm meanwhile.

    Args:
        filters: as the epoch left them.
        isolated, satellites: ``(runs, 2)`` of GPS and Doppler, and ``(runs, satellites)``, isolated just now.
        altimeter: ``(runs,)`` isolated just now, and epochs since the onset.
        a, variance: the aids' noise, and the altimeter's variance [m^2].
        biases: of :func:`overruled.reopen`.
    """
    settings = history.epochs[-1].settings
    watched = settings.driving_test != "none"
    contradictory = _contradicted(history) & ~isolated & watched
    if not (isolated.any() or contradictory.any() or satellites.any() or altimeter[0].any()):
        return history, filters, None
    aids_ = isolated | contradictory
    since = _onset_of_aids(history, settings.within)
    far = np.int64(history.now + 1)
    first = np.where(aids_, since, far).min(axis=-1)
    first = np.where(satellites.any(axis=-1), np.minimum(first, since[:, 0]), first)
    first = np.where(altimeter[0], np.minimum(first, history.now - altimeter[1] - MARGIN), first)
    # Covariance intersection fuses the filters that are alone, so they must be cleaned there too.
    alone = contradictory & (settings.master == "covariance-intersection")
    culprits = _harmful(history, Culprits(aids_, alone, altimeter[0], satellites, first))
    if not culprits.named.any():
        return history, filters, None
    oldest = history.banks[0][0] + 1
    culprits = replace(culprits, since=np.clip(culprits.since, oldest, history.now))
    history, filters = fly_again(history, filters, culprits, a, variance, biases)
    history = replace(
        history,
        since=np.where(culprits.aids, history.now + 1, history.since),
        squares=np.where(culprits.named[:, None, None, None], 0.0, history.squares),
    )
    return history, filters, culprits


def fly_again(
    history: History, filters: Filters, culprits: Culprits, a: Aiding, variance: float, biases: Array
) -> tuple[History, Filters]:
    """The bank as it would be without the culprits since their onset, in the runs where there are any.

    ``filters``: after the last epoch; ``variance`` of the altimeter's noise [m^2]; ``biases`` as in `review`. The past
    that is kept is corrected as well, so a later return to it does not bring the culprit back.
    """
    first = history.banks[0][0]
    since = np.clip(culprits.since, first + 1, history.now)
    numbers = np.array([number for number, _ in history.banks])
    place = np.searchsorted(numbers, since, side="left") - 1
    banks, epochs = list(history.banks), list(history.epochs)
    for origin in np.unique(place[culprits.named]).tolist():
        who = np.flatnonzero(culprits.named & (place == origin))
        some = culprits_of_runs(culprits, who, since)
        flown = Filters(banks[origin][1].x[who], banks[origin][1].P[who])
        then = origin + 1
        for number in range(banks[origin][0] + 1, history.now + 1):
            i = number - first - 1
            amended = _amended(of_runs(epochs[i], who), some, number)
            flown = _again(flown, amended, a, variance, biases)
            if number >= some.since.min():
                epochs[i] = with_runs(epochs[i], amended, who)
            if then < len(banks) and banks[then][0] == number:
                banks[then] = (number, _put(banks[then][1], flown, who))
                then += 1
        filters = _put(filters, flown, who)
    return replace(history, banks=tuple(banks), epochs=tuple(epochs)), filters


# ---- who, and since when --------------------------------------------------------------------------------------------


def _contradicted(history: History) -> Flags:
    """``(runs, 2)`` which aid the fused estimate contradicts although it takes it in; at most one a run."""
    enough = np.count_nonzero(history.squares[..., 1], axis=1) >= FEWEST
    found = enough & (history.now - history.doubted <= GAP)
    if not found.any():
        return np.asarray(found)
    q, dof = np.moveaxis(history.squares.sum(axis=1), -1, 0)
    found = found & (q > chi_square.threshold(P_CONTRADICTION, dof.astype(np.int64)))
    excess = np.where(found, (q - dof) / np.sqrt(2.0 * np.maximum(dof, 1.0)), -np.inf)
    return np.asarray(found & (excess >= excess.max(axis=-1, keepdims=True)))


def _onset_of_aids(history: History, within: int) -> Ints:
    """``(runs, 2)`` number of the first epoch in which GPS and Doppler are not trusted, if they were named now."""
    series = history.now - history.doubted <= GAP
    return np.where(series, history.since, history.now - within) - MARGIN


def _harmful(history: History, culprits: Culprits) -> Culprits:
    """Those culprits whose measurements were taken in since the onset; the others did no harm.

    Without the margin: measurements that nobody doubts are no reason to fly again.
    """
    since = np.clip(culprits.since + MARGIN, history.now + 1 - len(history.epochs), history.now)
    aids_, altimeter = np.zeros_like(culprits.aids), np.zeros_like(culprits.altimeter)
    satellites = np.zeros_like(culprits.satellites)
    oldest = int(since[culprits.named].min())
    for number in range(oldest, history.now + 1):
        epoch = history.epochs[number - history.now - 1]
        then = number >= since
        taken = epoch.decided.use & epoch.decided.present & then[:, None]
        aids_ |= taken
        satellites |= epoch.trusted & taken[:, :1]
        altimeter |= epoch.damping.gains[:, 0].any(axis=-1) & ~epoch.wrong[:, 2] & then
    return replace(
        culprits,
        aids=culprits.aids & aids_,
        alone=culprits.alone & aids_,
        altimeter=culprits.altimeter & altimeter,
        satellites=culprits.satellites & satellites,
    )


# ---- one epoch again ------------------------------------------------------------------------------------------------


def _again(filters: Filters, e: Epoch, a: Aiding, variance: float, biases: Array) -> Filters:
    """The steps of an epoch in the order of the navigator's, with what is decided already."""
    Phi, Q = strapdowns.matrices(e.motion, a)
    filters = bank.predict(filters, Phi, Q, e.sharing, e.members)
    factors = federated.noise_factors(e.sharing, e.members)
    filters = filtering.bias_jump(filters, e.changed, e.jump, factors)
    filters = overruled.reopen(filters, e.opening, biases, factors)
    filters = bank.reopen_bias(filters, e.opened, e.shift, factors)
    filters = bank.damp(filters, e.damping, variance, factors, e.wrong[:, 2])
    gps, _ = aids.gps(a, e.ins, e.readings, len(filters.x), e.enabled[0])
    n = len(gps.columns) // 2
    trusted = e.trusted[:, gps.columns[:n]]
    gps = replace(gps, valid=gps.present & np.concatenate([trusted, trusted], axis=-1))
    pair = gps, aids.doppler(a, e.ins, e.readings, len(filters.x), e.enabled[1])
    updated, _ = filtering.measure(filters, pair)
    for j in range(len(pair)):
        if e.wrong[:, j].any():
            prior = filters.estimate(ALONE[j])
            updated = bank.reset_where(updated, (ALONE[j],), e.wrong[:, j], prior)
    return filtering.conclude(e.settings, e.sharing, filters, updated, pair, e.decided, e.turns)[0]


def _amended(e: Epoch, culprits: Culprits, number: int) -> Epoch:
    """The epoch of that number as it is seen now."""
    then = number >= culprits.since
    out = culprits.aids & then[:, None]
    d = e.decided
    wrong = np.column_stack([culprits.alone & then[:, None], culprits.altimeter & then])
    return replace(
        e,
        members=e.members & ~(culprits.aids & (number > culprits.since)[:, None]),
        trusted=e.trusted & ~(culprits.satellites & then[:, None]),
        decided=replace(d, use=d.use & ~out, suspect=d.suspect & ~out, back=d.back & ~out),
        opened=np.where(wrong[:, 2], 0.0, e.opened),
        shift=np.where(wrong[:, 2], 0.0, e.shift),
        wrong=e.wrong | wrong,
    )


def _put(filters: Filters, some: Filters, who: Ints) -> Filters:
    """The bank with the runs ``who`` from another; the unprotected filter stays as it was: it takes part in nothing."""
    x, P = filters.x.copy(), filters.P.copy()
    protected = np.flatnonzero(np.arange(bank.SIZE) != CENTRAL)
    at = np.ix_(who, protected)
    x[at], P[at] = some.x[:, protected], some.P[:, protected]
    return Filters(x, P)
