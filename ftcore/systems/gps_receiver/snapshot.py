"""The snapshot method: one epoch on its own, solved, tested, and relieved of its culprits: Chey 2004, section 2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.detection import raim
from ftcore.detection.raim import Consistency, Isolation
from ftcore.estimation import least_squares
from ftcore.estimation.least_squares import Fix
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver.forms import Parameters
from ftcore.systems.gps_receiver.measurements import Measurement, Pseudoranges, measure

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

FAR = 300.0
"""A solution that ends this far from its working point [m] is repeated from there (2 mm of range)."""


@dataclass(frozen=True)
class Place:
    """Where the receiver is thought to be.

    Attributes:
        position_e: (runs, 3) working points, Earth-fixed [m].
        known: (runs,) whether there is one.
        origin, C_en: (runs, 3), (runs, 3, 3) level frame of the filters, laid at the first fix.
    """

    position_e: Array
    known: Flags
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
    return Place(np.zeros((runs, 3)), np.zeros(runs, bool), np.zeros((runs, 3)), frame)


def locate(place: Place, measured: Pseudoranges) -> Place:
    """A first position where there is none, from the pseudoranges alone."""
    if place.known.all() or not measured.valid.any():
        return place
    position, found = least_squares.cold_start(
        measured.values, measured.satellites, measured.valid & ~place.known[:, None]
    )
    if not found.any():
        return place
    lla = earth.ecef_to_geodetic(np.where(found[:, None], position, place.position_e + earth.A))
    C_en = earth.enu_to_ecef_matrix(lla[:, 0], lla[:, 1])
    row = found[:, None]
    return Place(
        np.where(row, position, place.position_e),
        place.known | found,
        np.where(row, position, place.origin),
        np.where(row[..., None], C_en, place.C_en),
    )


def take(p: Parameters, measured: Pseudoranges, place: Place, p_fa: float, margin: float) -> Snapshot:
    """Solve and test one epoch about the working point; again from the solution where that is far away."""
    for _ in range(4):
        snapshot = _take(p, measured, place, p_fa, margin)
        step = np.where(snapshot.sound[:, None], snapshot.fix.x[:, :3], 0.0)
        far = np.vecdot(step, step) > FAR**2
        if not far.any():
            break
        moved = place.position_e + np.matvec(place.C_en, step)
        place = Place(np.where(far[:, None], moved, place.position_e), place.known, place.origin, place.C_en)
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
    return Place(place.position_e + np.matvec(place.C_en, step), place.known, place.origin, place.C_en)
