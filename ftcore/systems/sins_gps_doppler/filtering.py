"""What an epoch does to the bank of filters, without any decision in it: carried, measured, concluded.

The navigator decides between these steps. When an epoch is flown again (:mod:`.hindsight`) the same steps are taken,
with what was decided then or what should have been.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation import kalman
from ftcore.estimation.federated import Estimate, Sharing
from ftcore.estimation.kalman import Update
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler import bank, masters
from ftcore.systems.sins_gps_doppler.aids import Aid
from ftcore.systems.sins_gps_doppler.bank import ALONE, CENTRAL, FUSED, LOCAL, NEWER, PRIOR, REFERENCE, WITNESS, Filters
from ftcore.systems.sins_gps_doppler.forms import Settings
from ftcore.systems.sins_gps_doppler.masters import Fused, Verdict

Array = NDArray[np.float64]
Pair = tuple[Aid, Aid]


@dataclass(frozen=True)
class Turns:
    """What happens to the two propagators after an epoch, ``(runs,)`` each.

    Attributes:
        caught: somebody was isolated: the newer one goes on from the reference.
        due: the newer one becomes the reference, and starts anew from the fused estimate.
    """

    caught: Flags
    due: Flags


def bias_jump(filters: Filters, changed: Flags, jump: Array, factors: Array) -> Filters:
    """A changed set of instruments has other body biases: tell the filters on the protected strapdown by how much.

    ``changed (runs,)``, ``jump (runs, 2, 3, 3)`` of gyros and accelerometers. The jump is common to all filters, so the
    federation's get it with their shares of process noise, ``factors (runs or 1, 3)``.
    """
    if not changed.any():
        return filters
    P = filters.P.copy()
    protected = np.flatnonzero(bank.INS_OF_FILTER == 0)
    share = np.ones((len(P), len(protected), 1, 1))
    share[:, :3, 0, 0] = factors
    for cluster, block in ((0, slice(9, 12)), (1, slice(12, 15))):
        P[:, protected, block, block] += share * jump[:, None, cluster]
    return Filters(filters.x, P)


def measure(prior: Filters, pair: Pair) -> tuple[Filters, list[Update]]:
    """Every filter takes its own aids, whoever is trusted; with the updates of (alone, local, central, witness)."""
    x, P = prior.x.copy(), prior.P.copy()
    updates = []
    for j, aid in enumerate(pair):
        taking = [ALONE[j], LOCAL[j], CENTRAL, WITNESS]
        update = kalman.update(x[:, taking], P[:, taking], *aid.of(taking))
        x[:, taking], P[:, taking] = update.x, update.P
        updates.append(update)
    return Filters(x, P), updates


def conclude(
    settings: Settings, sharing: Sharing, prior: Filters, updated: Filters, pair: Pair, decided: Verdict, turns: Turns
) -> tuple[Filters, Fused]:
    """Fuse by what was ``decided``, share out, let the propagators take their turn, start anew who comes back.

    ``prior``: all filters as predicted; ``updated``: as `measure` left them.
    """
    x, P = updated.x.copy(), updated.P.copy()
    if not decided.use.all():
        x[:, WITNESS], P[:, WITNESS] = _trusted_only(prior.estimate(WITNESS), pair, decided.use)
    made = masters.fuse(settings, sharing, prior, updated, pair, decided)
    fused = made.estimate
    x[:, :3], P[:, :3] = made.federation.x, made.federation.P
    x[:, FUSED], P[:, FUSED] = fused.x, fused.P
    filters = Filters(x, P)
    filters = bank.reset_where(filters, (NEWER,), turns.caught, filters.estimate(REFERENCE))
    filters = bank.reset_where(filters, (REFERENCE,), turns.due, filters.estimate(NEWER))
    filters = bank.reset_where(filters, (NEWER,), turns.due, fused)
    for j in range(len(pair)):
        filters = bank.reset_where(filters, (ALONE[j], PRIOR[j]), decided.back[:, j], fused)
    return filters, made


def _trusted_only(prior: Estimate, pair: Pair, used: Flags) -> tuple[Array, Array]:
    """The witness with those measurements alone whose aid is trusted, ``used (runs, 2)``."""
    x, P = prior.x, prior.P
    for j, aid in enumerate(pair):
        update = kalman.update(x, P, aid.y[:, 0], aid.H[:, 0], aid.R[0], aid.valid & used[:, j, None])
        x, P = update.x, update.P
    return x, P
