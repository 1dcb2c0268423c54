"""The federated master of Zhang 1992 over the aids of Yang 2016: SINS/GPS, SINS/BD2, SINS/CNS, one model each.

Its process noise is what the IMM thinks of both models at the moment. The supervisor says who is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import supervisor
from ftcore.estimation import federated, kalman
from ftcore.estimation.federated import Bank, Estimate, Sharing
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.branch import Measured
from ftcore.systems.sins_gps_bd2_cns.forms import Settings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FederationState:
    """Local filters and master, the estimate they made, how they share information, and who belongs to them."""

    bank: Bank
    fused: Estimate
    sharing: Sharing
    members: Flags


def start(known: Estimate, settings: Settings) -> FederationState:
    """A federation that together knows ``known``."""
    sharing = Sharing.equal(settings.fusion_mode, len(AIDS))
    return FederationState(
        federated.start(known.x, known.P, sharing), known, sharing, np.ones((1, len(AIDS)), dtype=bool)
    )


def step(
    state: FederationState, Phi: Array, Q: Array, m: Measured, decision: supervisor.Decision, settings: Settings
) -> FederationState:
    """One epoch with Phi and Q ``(runs, 15, 15)``; a suspect's measurement is withheld from its own filter too."""
    if settings.fusion_mode != state.sharing.mode:
        state = start(state.fused, settings)
    sharing = state.sharing
    prior = federated.predict(state.bank, Phi, Q, sharing, state.members)
    prior = Bank(prior.x, kalman.sound(prior.P))
    x, P = prior.locals
    runs, count, n = x.shape
    rows = (runs, count, m.y.shape[-1] // count)
    update = kalman.update(x, P, m.y.reshape(rows), m.H.reshape(*rows, n), m.R.reshape(rows[1:]), m.valid.reshape(rows))
    used = decision.use
    x = np.where(used[..., None], update.x, x)
    P = np.where(used[..., None, None], update.P, P)
    contributing = used | decision.suspect
    fused = federated.master_estimate(prior, x, P, contributing, sharing, prior.master)
    back = decision.just_readmitted
    bank = federated.after_fusion(prior, x, P, fused, contributing, sharing, back if back.any() else None)
    return FederationState(bank, fused, sharing, decision.members)


def shift(state: FederationState, dx: Array) -> FederationState:
    """The strapdown was corrected by ``dx (runs, 15)``."""
    bank, fused = state.bank, state.fused
    return FederationState(
        Bank(bank.x - dx[:, None], bank.P), Estimate(fused.x - dx, fused.P), state.sharing, state.members
    )


def widen(state: FederationState, jump: Array) -> FederationState:
    """The errors jumped by something of covariance ``jump (runs, 15, 15)``; it is shared out like process noise."""
    factors = federated.noise_factors(state.sharing, state.members)
    bank = Bank(state.bank.x, state.bank.P + federated.inflate(jump, factors))
    return FederationState(bank, state.fused, state.sharing, state.members)
