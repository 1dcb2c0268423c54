"""One fault-tolerant filter of Yang 2016: IMM predictions, two propagators, tests on every aid, fusion of the subsets.

The system flies two of them on the same measurements: with the IMM, and without it (one model, Q_small).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, coasting, propagators, recovery
from ftcore.detection.chi_square import Propagators
from ftcore.detection.coasting import Coast
from ftcore.detection.propagators import SubsystemTests
from ftcore.detection.recovery import Standoff
from ftcore.estimation import imm, ins_error, tolerant_fusion
from ftcore.estimation.imm import Mixture
from ftcore.estimation.tolerant_fusion import Drives, Fusion, Layout, SubsetUpdates
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.forms import Settings

Array = NDArray[np.float64]
LAYOUT = Layout(tuple(AIDS), (3, 3, 3))
STARS = 2
"""Place of the star tracker, which no other aid can vouch for."""


@dataclass(frozen=True)
class Branch:
    """What a fault-tolerant filter carries.

    Attributes:
        mixture, pair: the models, and the two propagators.
        watch, coast: what is remembered of GPS and BD2 against each other, of the star tracker against raw motion.
        age: seconds since each propagator was reset ``(runs, 2)``.
        known: logarithms of the model probabilities of the last epoch ``(runs, models)``, before their transition.
        drifting: those that each propagator has by itself ``(runs, 2, models)``: the filter's at its reset, since then
            moved by the transition matrix alone.
    """

    mixture: Mixture
    pair: Propagators
    watch: Standoff
    coast: Coast
    age: Array
    known: Array
    drifting: Array


@dataclass(frozen=True)
class Measured:
    """All aids at one epoch: y ``(runs, 9)`` = SINS - sensor, H ``(runs, 9, 15)``, R ``(9,)``, valid ``(runs, 9)``."""

    y: Array
    H: Array
    R: Array
    valid: Flags


@dataclass(frozen=True)
class Motion:
    """What the gyros say by themselves, nothing that was learned taken off: the witness of a star tracker.

    Attributes:
        raw: level-frame rotation ``(runs, 3)`` of the raw inertial attitude against the star tracker's [rad], from any
            origin; NaN without a reading.
        reach: its sensitivity ``(runs, 3, 6)`` to the biases and scale factors of the gyros, each in units of its
            1-sigma on the data sheet.
        bias: what the strapdown takes off ``(runs, 6)``, as learned so far.
    """

    raw: Array
    reach: Array
    bias: Array


@dataclass(frozen=True)
class Examined:
    """The tests of an epoch.

    Attributes:
        innovation: q in its innovation form.
        state: q in its state form; None where nobody asked for it.
        driving: the one of them that weighs the aids.
        believed: ``(runs, 3)`` rejected aids that are believed against the reference.
        rescued: ``(runs,)`` where that began in this epoch.
        moved: ``(runs, 3)`` aids that have jumped away, whatever a reference that has grown wide says of them.
        beta: ``(runs, 3)`` validity of each aid, (15).
        updates: the filter's updates with every subset of the aids.
    """

    innovation: SubsystemTests
    state: SubsystemTests | None
    driving: SubsystemTests
    believed: Flags
    rescued: Flags
    moved: Flags
    beta: Array
    updates: SubsetUpdates


def start(x: Array, P: Array, mu: Array) -> Branch:
    """Everybody at ``x (runs, 15)``, ``P (runs, 15, 15)``; ``mu (models,)``."""
    runs = len(x)
    return Branch(
        imm.start(x, P, mu),
        chi_square.start_propagators(x, P),
        recovery.start_standoff(runs, LAYOUT),
        coasting.start(runs, LAYOUT.sizes[STARS], 2 * LAYOUT.sizes[STARS], 6),
        np.zeros((runs, 2)),
        np.broadcast_to(np.log(mu), (runs, len(mu))),
        np.broadcast_to(np.log(mu), (runs, 2, len(mu))),
    )


def carried(branch: Branch, mixture: Mixture, x: Array, P: Array, drifting: Array) -> Branch:
    """One epoch on: what the models have become, and both propagators' ``x (runs, 2, 15)``, ``P (runs, 2, 15, 15)``."""
    pair = Propagators(x, P, branch.pair.reference)
    return Branch(mixture, pair, branch.watch, branch.coast, branch.age + 1.0, branch.known, drifting)


def compare(branches: Sequence[Branch], m: Measured, settings: Settings) -> list[tuple[SubsystemTests, SubsetUpdates]]:
    """The innovation form's tests, and the updates with every subset of the aids, of several filters at once."""
    references = [branch.pair.estimate() for branch in branches]
    mixtures = [branch.mixture for branch in branches]
    x = np.concatenate([*(mixture.x for mixture in mixtures), *(x[:, None] for x, _ in references)], axis=1)
    P = np.concatenate([*(mixture.P for mixture in mixtures), *(P[:, None] for _, P in references)], axis=1)
    residuals = tolerant_fusion.residuals(x, P, m.y, m.H, m.R, LAYOUT, m.valid)
    first = x.shape[1] - len(branches)
    updates = tolerant_fusion.updates_of(mixtures, residuals.of(slice(0, first)))
    bounds = settings.doubt_probability, settings.false_alarm_probability
    return [(propagators.judge(residuals, first + i, *bounds), u) for i, u in enumerate(updates)]


def examine(
    branch: Branch,
    compared: tuple[SubsystemTests, SubsetUpdates],
    m: Measured,
    motion: Motion,
    settings: Settings,
    shadows: bool,
    recovers: bool,
) -> tuple[Branch, Examined]:
    """Test every aid against the reference.

    ``compared``: what `compare` says of this filter. ``shadows``: make the state form too where it does not drive.
    ``recovers``: whether aids may be believed against the reference.
    """
    bounds = settings.doubt_probability, settings.false_alarm_probability
    innovation, updates = compared
    by_state = settings.driving_test == "two-propagator-state"
    state = None
    if shadows or by_state:
        state = propagators.state_tests(branch.pair, updates, *bounds)
    driving = state if by_state and state is not None else innovation
    beta = driving.present.astype(float)
    fresh = believed = np.zeros(driving.beta.shape, dtype=bool)
    moved = np.zeros(driving.beta.shape, dtype=bool)
    if settings.driving_test != "none":
        beta = driving.beta
    if settings.driving_test != "none" and recovers:
        branch, believed, fresh = _recover(branch, m, motion, driving.beta)
        beta = np.where(believed, 1.0, beta)
        moved[:, STARS] = coasting.moved(branch.coast)
    if fresh.any():
        prior = recovery.widen(branch.mixture, m.y, m.H, LAYOUT, fresh)
        prior = _forgotten(prior, _learned(branch.mixture, motion) - branch.coast.learned[:, 0], fresh[:, STARS])
        updates = tolerant_fusion.subset_updates(prior, m.y, m.H, m.R, LAYOUT, m.valid)
    rescued = np.asarray(fresh.any(axis=-1))
    return branch, Examined(innovation, state, driving, believed, rescued, moved, beta, updates)


def _recover(branch: Branch, m: Measured, motion: Motion, beta: Array) -> tuple[Branch, Flags, Flags]:
    """Which aids are believed against the reference, and which since just now, ``(runs, 3)``."""
    watch, fresh = recovery.stand_off(branch.watch, m.y, m.R, beta, LAYOUT, m.valid)
    variance = float(m.R[LAYOUT.slices[STARS]].mean())
    coast, heard, begins = coasting.coast(
        branch.coast, motion.raw, motion.reach, variance, beta[:, STARS], _learned(branch.mixture, motion)
    )
    believed = fresh.copy()
    fresh[:, STARS], believed[:, STARS] = begins, heard
    return replace(branch, watch=watch, coast=coast), believed, fresh


def _learned(mixture: Mixture, motion: Motion) -> Array:
    """Biases of gyros and accelerometers as learned so far, ``(runs, 6)``."""
    return np.asarray(motion.bias + np.vecmat(mixture.mu, mixture.x)[:, ins_error.GYRO.start :])


def _forgotten(prior: Mixture, learned: Array, where: Flags) -> Mixture:
    """Biases made as uncertain as they have changed, by ``learned (runs, 6)``, where the attitude is found to have been
    wrong: a filter with a tilt takes gravity for a bias."""
    if not where.any():
        return prior
    P = prior.P.copy()
    for cluster, kind in ((ins_error.GYRO, slice(0, 3)), (ins_error.ACCELEROMETER, slice(3, 6))):
        variance = np.where(where, np.square(learned[:, kind]).mean(axis=-1), 0.0)
        P[..., cluster, cluster] += variance[:, None, None, None] * np.eye(3)
    return replace(prior, P=P)


def fuse(branch: Branch, examined: Examined, beta: Array, settings: Settings) -> tuple[Branch, Fusion]:
    """Fuse the subsets of aids with the validities ``beta (runs, 3)``; where two were believed against the reference,
    the propagators restart from the result."""
    drives: Drives = "smallest" if settings.mode_driver == "smallest" else "accepted"
    fusion = tolerant_fusion.fuse(examined.updates, beta, examined.driving.q, drives)
    mixture = fusion.mixture
    known = mixture.log_mu
    if settings.mode_driver == "held":
        known = np.where(fusion.driver[:, None] >= 0, mixture.log_mu, branch.known)
        mixture = replace(mixture, log_mu=known)
    doubted = np.asarray(examined.believed.any(axis=1))
    return renew(replace(branch, mixture=mixture, known=known), fusion.x, fusion.P, doubted), fusion


def renew(branch: Branch, x: Array, P: Array, where: Flags) -> Branch:
    """Both propagators restart from an estimate in the runs ``where``: their reference was wrong."""
    if not where.any():
        return branch
    return replace(
        branch,
        pair=propagators.renew(branch.pair, x, P, where),
        age=np.where(where[:, None], 0.0, branch.age),
        drifting=np.where(where[:, None, None], branch.mixture.log_mu[:, None], branch.drifting),
    )


def alternate(branch: Branch, x: Array, P: Array) -> Branch:
    """The older propagator restarts from an estimate; the other one is the reference from now on."""
    due = np.stack([branch.pair.reference == 0, branch.pair.reference == 1], axis=1)
    return replace(
        branch,
        pair=chi_square.alternate(branch.pair, x, P),
        age=np.where(due, 0.0, branch.age),
        drifting=np.where(due[:, :, None], branch.mixture.log_mu[:, None], branch.drifting),
    )


def feed_back(branch: Branch, dx: Array) -> Branch:
    """The strapdown was corrected by ``dx (runs, 15)``: all errors are about a new origin."""
    return replace(branch, mixture=imm.shift(branch.mixture, dx), pair=propagators.feed_back(branch.pair, dx))


def widen(branch: Branch, jump: Array) -> Branch:
    """The errors jumped by something of covariance ``jump (runs, 15, 15)``."""
    mixture = replace(branch.mixture, P=branch.mixture.P + jump[:, None])
    return replace(branch, mixture=mixture, pair=replace(branch.pair, P=branch.pair.P + jump[:, None]))
