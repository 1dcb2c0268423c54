"""The protected part of the navigator over one epoch: tests, decisions, fusion. It can be flown again.

It is a function of what it was before and of an `Epoch`, which holds what the strapdown flew and what the aids read. So
the past can be flown again with other readings, as if an aid had been switched off then: see :mod:`.hindsight`. The
strapdown itself need not be flown again; its errors are what the filters estimate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import propagators, supervisor
from ftcore.detection.propagators import SubsystemTests
from ftcore.estimation import imm, kalman
from ftcore.estimation.federated import Estimate
from ftcore.estimation.imm import Mixture
from ftcore.estimation.tolerant_fusion import SubsetUpdates
from ftcore.systems.base import Controls, Flags
from ftcore.systems.sins_gps_bd2_cns import branch as fault_tolerant
from ftcore.systems.sins_gps_bd2_cns import exclusion, federation
from ftcore.systems.sins_gps_bd2_cns.branch import Branch, Examined, Measured, Motion
from ftcore.systems.sins_gps_bd2_cns.error_model import ErrorModel, Flown
from ftcore.systems.sins_gps_bd2_cns.federation import FederationState
from ftcore.systems.sins_gps_bd2_cns.forms import Settings

Array = NDArray[np.float64]
Health = NDArray[np.int8]


@dataclass(frozen=True)
class Protected:
    """What the protected part carries.

    Attributes:
        main: the fault-tolerant filter with the IMM.
        supervisor: of the three aids.
        federation: the federated master, where it is chosen.
        turned: what scale factors of 1-sigma have turned the attitude by, as far as star fixes have not taken it away
            ``(runs, 3, 6)`` [rad]: at the rates flown, and through the drift that was learned at the usual ones.
    """

    main: Branch
    supervisor: supervisor.State
    federation: FederationState | None
    turned: Array


@dataclass(frozen=True)
class Epoch:
    """What an epoch needs to be flown again. All arrays lead with runs, or with 1.

    Attributes:
        controls: as they were.
        flown: what the protected strapdown flew.
        jump: covariance ``(runs, 15, 15)`` of a jump of its errors; None where the instruments stayed the same.
        y, H, valid: of all aids; see :class:`Measured`.
        motion: the witness of the star tracker.
        turning: what the epoch adds to :attr:`Protected.turned`.
        turned: that, with it.
        mu: predicted probabilities of the models ``(runs, 2)``.
        taken, out: ``(runs, 3)`` aids that the fused estimate took in, and those that were isolated.
        ruled: ``(runs, 3)`` what looking back made of the aids' health, -1 where it left that alone; None: of nobody.
        turns: whether the propagators took turns.
        correction: ``(runs, 15)`` what the strapdown was corrected by; None where it was not.
    """

    controls: Controls
    flown: Flown
    jump: Array | None
    y: Array
    H: Array
    valid: Flags
    motion: Motion
    turning: Array
    turned: Array
    mu: Array
    taken: Flags
    out: Flags
    ruled: Health | None = None
    turns: bool = False
    correction: Array | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of an epoch.

    Attributes:
        examined, decision: the tests and what the supervisor made of them.
        used: whom the master uses ``(runs, 3)``.
        alpha: weights of the subsets ``(runs, 8)``. beta: validities of the aids ``(runs, 3)``.
        mu: predicted probabilities of the models ``(runs, 2)``.
        fused: the estimate.
    """

    examined: Examined
    decision: supervisor.Decision
    used: Flags
    alpha: Array
    beta: Array
    mu: Array
    fused: Estimate


def begin(state: Protected, turning: Array, jump: Array | None, settings: Settings) -> Protected:
    """Before the prediction: another master, and what has changed of the strapdown's errors."""
    state = _master_changed(replace(state, turned=state.turned + turning), settings)
    if jump is None:
        return state
    f = state.federation
    return replace(
        state,
        main=fault_tolerant.widen(state.main, jump),
        federation=None if f is None else federation.widen(f, jump),
    )


def conclude(
    state: Protected,
    compared: tuple[SubsystemTests, SubsetUpdates],
    m: Measured,
    motion: Motion,
    controls: Controls,
    Phi: Array,
    Q: Array,
) -> tuple[Protected, Outcome]:
    """After the prediction: test, decide and fuse. ``compared``: what the main filter's `compare` says; Phi
    ``(runs, 15, 15)`` and Q ``(runs, 2, 15, 15)`` of the epoch."""
    settings: Settings = controls.settings
    mu = state.main.mixture.mu
    main, examined = fault_tolerant.examine(
        state.main, compared, m, motion, settings, True, settings.recovery != "none"
    )
    rules = supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off)
    supervision, decision = exclusion.decide(state.supervisor, examined, m, state.turned, controls, rules)
    federated = state.federation
    if federated is not None:
        used = decision.use & examined.driving.present
        main, fusion = fault_tolerant.fuse(main, examined, used.astype(float), settings)
        noise = (mu[:, :, None, None] * Q).sum(axis=1)
        federated = federation.step(federated, Phi, noise, m, decision, settings)
        fused = federated.fused
    else:
        beta = examined.beta
        if settings.exclusion == "isolation":
            beta = np.where(decision.isolated & ~examined.believed, 0.0, beta)
        main, fusion = fault_tolerant.fuse(main, examined, beta, settings)
        used = (beta > 0.0) & examined.driving.present
        fused = Estimate(fusion.x, fusion.P)
    after = Protected(main, supervision, federated, exclusion.kept(state.turned, examined, m))
    return after, Outcome(examined, decision, used, fusion.alpha, examined.beta, mu, fused)


def rule(state: Protected, ruled: Health) -> Protected:
    """What looking back has made of the aids' health ``(runs, 3)``, -1 where it leaves that alone."""
    where, old = ruled >= 0, state.supervisor
    health = np.where(where, ruled, old.health)
    made = supervisor.State(health, np.where(where, np.uint64(0), old.history), np.where(where, 0, old.streak))
    state = replace(state, supervisor=made)
    if state.federation is None:
        return state
    return replace(state, federation=replace(state.federation, members=members(health)))


def members(health: Health) -> Flags:
    """``(runs, 3)`` aids that are neither isolated nor switched off."""
    return np.asarray((health != supervisor.ISOLATED) & (health != supervisor.OFF))


def take_turns(state: Protected, fused: Estimate) -> Protected:
    """The older propagator restarts from the estimate of the epoch."""
    return replace(state, main=fault_tolerant.alternate(state.main, fused.x, fused.P))


def feed_back(state: Protected, dx: Array) -> Protected:
    """The strapdown was corrected by ``dx (runs, 15)``."""
    f = state.federation
    return replace(
        state,
        main=fault_tolerant.feed_back(state.main, dx),
        federation=None if f is None else federation.shift(f, dx),
    )


def again(state: Protected, e: Epoch, model: ErrorModel, R: Array, transition: Array) -> tuple[Protected, Outcome]:
    """The whole epoch, from what is remembered of it. ``R (9,)``: of the aids; ``transition``: of the IMM."""
    settings: Settings = e.controls.settings
    state = begin(state, e.turning, e.jump, settings)
    Phi, Q = (a[:, 0] for a in model.matrices(e.flown))
    main = state.main
    mixture = imm.predict(main.mixture, Phi, Q, transition)
    drifting = imm.predicted_probabilities(main.drifting, transition)
    pair = propagators.carry(main.pair, Phi, Q, np.exp(drifting) if settings.propagator_models == "own" else mixture.mu)
    mixture = replace(mixture, P=kalman.sound(mixture.P))
    state = replace(state, main=fault_tolerant.carried(main, mixture, pair.x, kalman.sound(pair.P), drifting))
    m = Measured(e.y, e.H, R, e.valid)
    compared = fault_tolerant.compare([state.main], m, settings)[0]
    state, outcome = conclude(state, compared, m, e.motion, e.controls, Phi, Q)
    if e.ruled is not None:
        state = rule(state, e.ruled)
    if e.turns:
        state = take_turns(state, outcome.fused)
    if e.correction is not None:
        state = feed_back(state, e.correction)
    return state, outcome


def _master_changed(state: Protected, settings: Settings) -> Protected:
    """Hand the estimate over where the operator has chosen another master."""
    if settings.master == "federated" and state.federation is None:
        known = Estimate(*imm.combine(state.main.mixture))
        return replace(state, federation=federation.start(known, settings))
    if settings.master != "federated" and state.federation is not None:
        known, mixture = state.federation.fused, state.main.mixture
        models = mixture.log_mu.shape[-1]
        x = np.repeat(known.x[:, None], models, axis=1)
        P = np.repeat(known.P[:, None], models, axis=1)
        main = replace(state.main, mixture=Mixture(x, P, mixture.log_mu))
        return replace(state, main=main, federation=None)
    return state
