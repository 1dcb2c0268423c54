"""Both tests together: who is accused, who may come back, and what is said of the combined solution."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Wire
from ftcore.detection import chi_square, supervisor
from ftcore.detection.raim import CANNOT_DETECT, CANNOT_ISOLATE, CONSISTENT, EXCLUDED, NO_FIX, Isolation
from ftcore.estimation import least_squares
from ftcore.estimation.least_squares import Fix
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags, Notice
from ftcore.systems.gps_receiver.bank import COMBINED, FILTER, PLACE, Bank
from ftcore.systems.gps_receiver.forms import Settings
from ftcore.systems.gps_receiver.innovations import Agreement
from ftcore.systems.gps_receiver.satellites import SATELLITES, Measurement
from ftcore.systems.gps_receiver.snapshot import Judgement, Snapshot
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

DECLARED: Final = Declared(
    signals=(Signals("used.gps.{satellite}", "{satellite} used by the combined solution", "1", "decision"),),
    blocks=(
        Block(
            id="combination", label="Combination", kind="supervisor", x=52, y=20, width=23, height=14,
            settings=("combination", "confirm", "within", "hold_off"),
        ),
    ),
    wires=(Wire(source="combination", target="combined"),),
)  # fmt: skip


def accuse(
    settings: Settings, m: Measurement, free: Flags, kept: Judgement, by_innovation: Flags, p_fa: float
) -> tuple[Flags, Flags]:
    """Who is accused by both tests together (runs, n), and where measurements may be taken at all (runs,).

    Both tests look at the satellites that are ``free``, not held out. Where the snapshot knows that something is wrong
    but not who, the innovations may know: they are believed if the rest then agrees. If not, nothing is taken.
    """
    by_snapshot = kept.verdict.excluded
    accused = by_snapshot & by_innovation if settings.combination == "and" else by_snapshot | by_innovation
    doubtful = kept.status == CANNOT_ISOLATE
    if not doubtful.any():
        return accused, ~doubtful
    rest = least_squares.solve(m.H, m.y, m.sigma, free & ~by_innovation)
    passed = (rest.dof > 0) & (rest.statistic < chi_square.threshold(p_fa, rest.dof))
    helped = doubtful & by_innovation.any(axis=-1) & passed
    return np.where(doubtful[:, None], by_innovation & helped[:, None], accused), ~doubtful | helped


def admissible(
    m: Measurement, held: Flags, others: Flags, resolved: Flags, prior: Bank, z: Array, p_fa: float
) -> Flags:
    """Which satellites agree with an estimate that they had no part in; who was never held out needs no such proof.

    That is a snapshot of ``others`` (runs, n). Where these are too few for one, it is the combined filter's prediction:
    its covariance grows while nothing better is known, so nobody stays out for ever.
    """
    if not held.any():
        return m.valid
    fix = least_squares.solve(m.H, m.y, m.sigma, others)
    alone = fix.solved[:, None]
    x = np.where(alone, fix.x, prior.x[:, COMBINED, PLACE])
    P = np.where(alone[..., None], fix.covariance, prior.P[:, COMBINED][:, PLACE[:, None], PLACE])
    residual = np.where(alone, m.y, z) - np.matvec(m.H, x)
    variance = m.sigma**2 + np.vecdot(m.H @ P, m.H)
    like = (residual**2 <= chi_square.threshold(p_fa, 1) * variance) & resolved[:, None]
    return np.asarray(m.valid & (like | ~held))


def status(
    snapshot: Snapshot,
    verdict: Isolation,
    fixes: Fix,
    excluded: Flags,
    resolved: Flags,
    disagrees: Flags,
    started: Flags,
) -> Codes:
    """Codes of :mod:`ftcore.detection.raim` for the four estimators, (runs, 4); the unprotected one knows of nothing.

    A filter whose satellites do not check each other is not vouched for, whatever its prediction says of them: that is
    what a slow fault would have carried away.
    """
    own, both = verdict.state[:, FILTER], np.where(excluded.any(axis=-1), EXCLUDED, CONSISTENT)
    blind = fixes.dof[:, 1:3] <= 0
    own = np.where(blind[:, 0] & (own != CANNOT_ISOLATE), CANNOT_DETECT, own)
    doubt = ~resolved | disagrees | (verdict.state[:, COMBINED] == CANNOT_ISOLATE)
    both = np.where(doubt, CANNOT_ISOLATE, np.where(blind[:, 1], CANNOT_DETECT, both))
    every = np.stack([snapshot.status, own, both, np.full(len(own), CONSISTENT)], axis=-1)
    every[:, 1:] = np.where(started[:, None], every[:, 1:], NO_FIX)
    return every.astype(np.int8)


def over_all(values: Flags, columns: NDArray[np.intp]) -> Flags:
    """(runs, n) over all satellites that there are."""
    wide = np.zeros((len(values), len(SATELLITES)), bool)
    wide[:, columns] = values
    return wide


def report(
    say: Ledger, decision: supervisor.Decision, status: Codes, trusted: Flags, valid: Flags, columns: NDArray[np.intp]
) -> None:
    """Health and use of the receiver as a whole ``(runs,)`` and of each satellite in these ``columns (runs, n)``."""
    whole = np.where(status > EXCLUDED, supervisor.SUSPECT, supervisor.HEALTHY)
    say.judge("gps", whole, trusted.any(axis=-1))
    say.judge("gps.{satellite}", decision.health, over_all(trusted, columns))
    say["used.gps.{satellite}", columns] = np.where(valid, trusted, np.nan)


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's block of the combination: who is out."""
    if now.said is None or now.health["gps"] == "off":
        return {}
    lost = [name for name in SATELLITES if now.health[f"gps.{name}"] in ("isolated", "suspect")]
    text = f"{', '.join(lost)[:18]} out" if lost else now.controls.settings.combination
    return {"combination": BlockView(health="isolated" if lost else "ok", text=text)}


_ANNOUNCED = {
    CANNOT_ISOLATE: "integrity.cannot-isolate",
    CANNOT_DETECT: "integrity.cannot-detect",
    NO_FIX: "integrity.no-fix",
}


def notices(before: Codes, now: Codes, reset: Flags, agreement: Agreement) -> list[Notice]:
    """What happened to the combined solution."""
    numbers = {"statistic": agreement.statistic, "threshold": agreement.limit}
    notices = [Notice("filter.reset", "gps", reset, numbers)] if reset.any() else []
    if np.array_equal(before, now):
        return notices
    for code, kind in _ANNOUNCED.items():
        turned = (now == code) & (before != code)
        if turned.any():
            notices.append(Notice(kind, "gps", turned, {}))
    good, was_good = now <= EXCLUDED, before <= EXCLUDED
    if (good & ~was_good).any():
        notices.append(Notice("integrity.restored", "gps", good & ~was_good, {}))
    return notices
