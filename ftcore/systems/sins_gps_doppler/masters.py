"""The three masters of the SINS/GPS/Doppler system: how one estimate is made of two aids.

    federated                the local filters' estimates are merged and shared out again (Zhang 1992)
    covariance-intersection  the filters that are alone are merged as if nothing were known of their correlation
    tolerant                 the fused prediction is updated with every subset of the aids, and the four estimates are
                             weighed by how far the driving test believes each aid (Yang 2016)

Whom the supervisor has put out is out in all of them. The tolerant master goes further: an aid that has not alarmed,
but is beyond the doubt threshold, counts in part, so the estimate does not jump when somebody is excluded. Its validity
beta (15) falls from 1 at the doubt threshold to 0 at the alarm threshold of the driving test's own q. The GLR and the
cumulative sum have no q on the aid's degrees of freedom; with them, and with none, beta is 1 for whoever is not out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart, Trace
from ftcore.detection import chi_square, propagators, supervisor
from ftcore.estimation import federated, imm, tolerant_fusion
from ftcore.estimation.federated import Bank, Estimate, Sharing
from ftcore.estimation.tolerant_fusion import Layout
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.aid_tests import AidTestResult
from ftcore.systems.sins_gps_doppler.aids import AIDS, Aid
from ftcore.systems.sins_gps_doppler.bank import ALONE, FUSED, LOCAL, Filters
from ftcore.systems.sins_gps_doppler.forms import Settings

Array = NDArray[np.float64]

SUBSETS: Final = {"sins": "SINS alone", "gps": "with GPS", "doppler": "with Doppler", "gps+doppler": "with both"}
"""Subsets of the aids, in the order of :func:`ftcore.estimation.tolerant_fusion.subset_weights`."""
DECLARED: Final = Declared(
    members={"subset": SUBSETS},
    signals=(Signals("weight.{subset}", "weight of the estimate, {subset}", "1", "weight"),),
    charts=(
        Chart(
            id="weights",
            title="Weights of the aids in the fused estimate",
            unit="1",
            group="weights",
            stacked=True,
            traces=(Trace(signal="weight.{subset}", label="{subset}", role="weight"),),
        ),
    ),
)
_WITH_Q = ("residual", "state", "two-propagator")


@dataclass(frozen=True)
class Fused:
    """The global estimate, the federation that goes on into the next epoch, and ``(runs, 4)`` weights of the subsets:
    SINS alone, GPS, Doppler, both."""

    estimate: Estimate
    federation: Bank
    weights: Array


@dataclass(frozen=True)
class Verdict:
    """What was decided of GPS and Doppler in one epoch, ``(runs, 2)`` each.

    Attributes:
        use: measured and fused.
        suspect: withheld, not judged yet.
        back: comes back after this epoch.
        present: has a reading.
        q, reject, dof: of the driving test where that is a chi-square on the aid's measurement, else 0.
    """

    use: Flags
    suspect: Flags
    back: Flags
    present: Flags
    q: Array
    reject: Array
    dof: NDArray[np.int64]


def verdict(settings: Settings, decision: supervisor.Decision, present: Flags, tests: AidTestResult) -> Verdict:
    """The supervisor's decision, with what the driving test says of this epoch."""
    q, reject, dof = np.zeros(present.shape), np.zeros(present.shape), np.zeros(present.shape, np.int64)
    if settings.driving_test in _WITH_Q:
        driver = tests.found[settings.driving_test]
        q, reject = np.nan_to_num(driver.statistic), np.nan_to_num(driver.threshold)
        dof = driver.dof.astype(np.int64)
    return Verdict(decision.use, decision.suspect, decision.just_readmitted, present, q, reject, dof)


def fuse(
    settings: Settings, sharing: Sharing, prior: Filters, updated: Filters, aids: tuple[Aid, Aid], decided: Verdict
) -> Fused:
    """One epoch's fusion.

    Args:
        prior: all filters as predicted.
        updated: the same after every filter has taken its own aid, whoever is trusted.
        aids: GPS and Doppler, without satellites that integrity has left out.
        decided: of the two, in this epoch.
    """
    used, back = decided.use, decided.back
    if settings.master == "tolerant":
        estimate, weights = _tolerant(settings, prior.estimate(FUSED), aids, decided)
        # The local filters follow: each with its part of what is known, ready to take over.
        return Fused(estimate, federated.start(estimate.x, estimate.P, sharing), weights)
    local, alone = list(LOCAL), list(ALONE)
    bank = prior.federation
    x, P = updated.x[:, local], updated.P[:, local]
    if not used.all():
        x = np.where(used[..., None], x, bank.locals[0])
        P = np.where(used[..., None, None], P, bank.locals[1])
    # A suspect's measurement is withheld from its own filter too, or it would come to the master a little later.
    contributing = used | decided.suspect
    fallback = prior.estimate(FUSED)
    if settings.master == "covariance-intersection":
        estimate = federated.covariance_intersection(updated.x[:, alone], updated.P[:, alone], used, fallback=fallback)
    else:
        estimate = federated.master_estimate(bank, x, P, contributing, sharing, fallback)
    federation = federated.after_fusion(bank, x, P, estimate, contributing, sharing, back if back.any() else None)
    return Fused(estimate, federation, tolerant_fusion.subset_weights((used & decided.present).astype(np.float64)))


def _tolerant(settings: Settings, prior: Estimate, aids: tuple[Aid, Aid], decided: Verdict) -> tuple[Estimate, Array]:
    """The estimate of (35)-(36) and the weights of (17), with one model in place of the IMM."""
    runs = len(prior.x)
    layout = Layout(tuple(AIDS), tuple(aid.y.shape[-1] for aid in aids))
    y, H = (np.concatenate([getattr(aid, field)[:, 0] for aid in aids], axis=1) for field in ("y", "H"))
    R = np.concatenate([aid.R[0] for aid in aids], axis=-1)
    valid = np.concatenate([np.broadcast_to(aid.valid, (runs, aid.valid.shape[-1])) for aid in aids], axis=-1)
    doubt = chi_square.threshold(settings.doubt_probability, decided.dof)
    in_part = propagators.validity(decided.q, doubt, decided.reject)
    beta = np.where(decided.use & (decided.dof > 0), in_part, decided.use.astype(np.float64))
    mixture = imm.start(prior.x, prior.P, np.ones(1))
    fusion = tolerant_fusion.fuse(tolerant_fusion.subset_updates(mixture, y, H, R, layout, valid), beta, decided.q)
    return Estimate(fusion.x, fusion.P), fusion.alpha


def report(say: Ledger, made: Fused) -> None:
    """How much each subset of the aids weighs."""
    say["weight.{subset}"] = made.weights
