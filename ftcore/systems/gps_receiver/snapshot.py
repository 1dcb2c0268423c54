"""The snapshot method: one epoch on its own, solved, tested, and relieved of its culprits: Chey 2004, section 2."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.detection import raim
from ftcore.detection.raim import Consistency, Isolation
from ftcore.estimation import least_squares
from ftcore.estimation.first_fix import first_fix
from ftcore.estimation.least_squares import Fix
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver import bank as filters
from ftcore.systems.gps_receiver.bank import Bank
from ftcore.systems.gps_receiver.forms import Parameters
from ftcore.systems.gps_receiver.measurements import Measurement, Pseudoranges, measure

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

FAR = 300.0
"""A solution that ends this far from its working point [m] is repeated from there (2 mm of range)."""
FOREIGN = 5e4
"""A level frame whose origin is this far from the working point [m] is laid anew: there it is no longer level."""
ASTRAY = 1e4
"""A working point that is this far from a first fix [m], and that no test has confirmed, is given up for it."""


@dataclass(frozen=True)
class Place:
    """Where the receiver is thought to be.

    Attributes:
        position_e: (runs, 3) working points, Earth-fixed [m].
        known: (runs,) whether there is one.
        confirmed: (runs,) whether the solution of the last epoch passed a test there.
        origin, C_en: (runs, 3), (runs, 3, 3) level frame of the filters, laid at the first fix; see :func:`levelled`.
    """

    position_e: Array
    known: Flags
    confirmed: Flags
    origin: Array
    C_en: Array


@dataclass(frozen=True)
class Judgement:
    """A set of satellites solved together, and what the test makes of it.

    ``status`` (runs,) is a code of :mod:`ftcore.detection.raim`.
    """

    everyone: Fix
    form: Consistency
    verdict: Isolation
    status: Codes


@dataclass(frozen=True)
class Snapshot(Judgement):
    """One epoch: all satellites judged, and the solution ``fix`` of the survivors.

    ``parity`` (runs,) is the test's statistic on the way of the parity space.
    """

    measurement: Measurement
    place: Place
    fix: Fix
    parity: Array

    @property
    def sound(self) -> Flags:
        """Where the solution has passed a test."""
        return self.status <= raim.EXCLUDED


def nowhere(runs: int) -> Place:
    """Nothing is known."""
    frame = np.array(np.broadcast_to(np.eye(3), (runs, 3, 3)))
    nobody = np.zeros(runs, bool)
    return Place(np.zeros((runs, 3)), nobody, nobody, np.zeros((runs, 3)), frame)


def locate(place: Place, measured: Pseudoranges) -> Place:
    """A position where there is none, from the pseudoranges alone; another where the one that is there is astray.

    A first fix from too few satellites to check each other can lie anywhere, and from there the wrong satellites are
    above the horizon. So a place that the last epoch did not confirm is looked for again, and given up where the
    satellites agree on one that is far away.
    """
    asked = np.flatnonzero(~place.confirmed & (measured.valid.sum(axis=-1) >= least_squares.UNKNOWNS))
    if not len(asked):
        return place
    start = first_fix(measured.values[asked], measured.satellites, measured.valid[asked])
    apart = start.position - place.position_e[asked]
    moves = np.where(place.known[asked], start.checked & (np.vecdot(apart, apart) > ASTRAY**2), start.found)
    new = asked[moves]
    if not len(new):
        return place
    position, known = place.position_e.copy(), place.known.copy()
    position[new], known[new] = start.position[moves], True
    return replace(place, position_e=position, known=known)


def levelled(place: Place, bank: Bank) -> tuple[Place, Bank]:
    """The place and the filters in a level frame of where the receiver is: laid at the first fix, or far from there."""
    apart = place.position_e - place.origin
    far = place.known & (np.vecdot(apart, apart) > FOREIGN**2)
    if not far.any():
        return place, bank
    at = np.where(far[:, None], place.position_e, earth.A)
    lla = earth.ecef_to_geodetic(at)
    C_en = np.where(far[:, None, None], earth.enu_to_ecef_matrix(lla[:, 0], lla[:, 1]), place.C_en)
    origin = np.where(far[:, None], at, place.origin)
    shift = np.vecmat(place.origin - origin, C_en)
    bank = filters.relaid(bank, far & bank.started, C_en.swapaxes(-1, -2) @ place.C_en, shift)
    return replace(place, origin=origin, C_en=C_en), bank


def take(p: Parameters, measured: Pseudoranges, place: Place, p_fa: float, margin: float) -> Snapshot:
    """Solve and test one epoch about the working point; again from the solution where that is far away."""
    for _ in range(4):
        snapshot = _take(p, measured, place, p_fa, margin)
        step = np.where(snapshot.sound[:, None], snapshot.fix.x[:, :3], 0.0)
        far = np.vecdot(step, step) > FAR**2
        if not far.any():
            break
        moved = place.position_e + np.matvec(place.C_en, step)
        place = replace(place, position_e=np.where(far[:, None], moved, place.position_e))
    return snapshot


def judge(m: Measurement, valid: Flags, p_fa: float, margin: float) -> Judgement:
    """Solve for the satellites ``valid (runs, n)`` together and test whether they agree."""
    everyone = least_squares.solve(m.H, m.y, m.sigma, valid)
    form = raim.from_projector(everyone.projector, m.y / m.sigma, everyone.residual, everyone.dof, everyone.valid)
    verdict = raim.isolate(form, p_fa, 1, margin)
    status = np.where(everyone.solved, verdict.state, raim.NO_FIX).astype(np.int8)
    return Judgement(everyone, form, verdict, status)


def _take(p: Parameters, measured: Pseudoranges, place: Place, p_fa: float, margin: float) -> Snapshot:
    m = measure(p, measured, place.position_e, place.C_en, place.known)
    j = judge(m, m.valid, p_fa, margin)
    fix = j.everyone
    if j.verdict.excluded.any():
        fix = least_squares.solve(m.H, m.y, m.sigma, m.valid & ~j.verdict.excluded)
    parity = raim.parity_statistic(m.H, m.y, m.sigma, j.everyone.valid)
    return Snapshot(j.everyone, j.form, j.verdict, j.status, m, place, fix, parity)


def advance(snapshot: Snapshot) -> Place:
    """The place to work from at the next epoch: the solution, where it can be trusted as far as anybody can tell."""
    place = snapshot.place
    trusted = snapshot.everyone.solved & (snapshot.status != raim.CANNOT_ISOLATE)
    # A gross fault with too few satellites to see it must not carry the working point away.
    near = np.abs(snapshot.fix.x[:, :3]).max(axis=-1) < 1e5
    step = np.where((trusted & near)[:, None], snapshot.fix.x[:, :3], 0.0)
    moved = place.position_e + np.matvec(place.C_en, step)
    return replace(place, position_e=moved, confirmed=snapshot.everyone.solved & snapshot.sound)
