"""The snapshot method: one epoch on its own, solved, tested, and relieved of its culprits: Chey 2004, section 2."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.description import Block, BlockView, Chart, Test, Trace, Wire
from ftcore.detection import chi_square, raim
from ftcore.detection.raim import Consistency, Isolation
from ftcore.estimation import least_squares
from ftcore.estimation.first_fix import first_fix
from ftcore.estimation.least_squares import Fix
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver import bank as filters
from ftcore.systems.gps_receiver import satellites
from ftcore.systems.gps_receiver.bank import Bank
from ftcore.systems.gps_receiver.forms import Parameters
from ftcore.systems.gps_receiver.satellites import Measurement, Pseudoranges, measure
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

FAR = 300.0
"""A solution that ends this far from its working point [m] is repeated from there (2 mm of range)."""
FOREIGN = 5e4
"""A level frame whose origin is this far from the working point [m] is laid anew: there it is no longer level."""
ASTRAY = 1e4
"""A working point that is this far from a first fix [m], and that no test has confirmed, is given up for it."""


SETTINGS: Final = ("false_alarm_probability", "wrong_isolation_probability")
DECLARED: Final = Declared(
    tests=(
        Test(
            name="snapshot",
            label="snapshot test",
            subjects=("gps", "gps.{satellite}"),
            dof="satellites minus 4; a satellite: 1, and it alarms where the test of all names it",
            source="Chey 2004 (9)-(12)",
            probability="exact",
            probability_note="a satellite alarms only where the whole does and names it, at an eighth of the stated "
            "probability",
        ),
        Test(
            name="parity",
            label="parity-space test",
            subjects=("gps",),
            dof="satellites minus 4",
            source="Sturza; equal to the snapshot test (Brown 1992)",
            may_drive=False,
            probability="exact",
        ),
    ),
    signals=(
        Signals(
            "residual.snapshot.{satellite}", "{satellite}: snapshot residual against all others, in sigmas", "1",
            "residual",
        ),
        Signals("residual.threshold", "threshold of one satellite's residual, in sigmas", "1", "residual"),
        Signals("gps.hdop", "HDOP", "1", "geometry"),
        Signals("gps.dof", "degrees of freedom of the snapshot", "1", "geometry"),
    ),
    charts=(
        # Who disagrees with all others now: the normalised residuals, whose squares are tested.
        Chart(
            id="residual-bars",
            title="Residuals, in σ",
            unit="1",
            group="residuals",
            kind="bars",
            traces=(
                Trace(signal="residual.snapshot.{satellite}", label="{satellite}", item="satellite.{satellite}"),
                Trace(signal="residual.threshold", label="threshold", role="threshold"),
            ),
        ),
        chart_of_test("snapshot", "Snapshot test", "test.snapshot.gps"),
        chart_of_test("parity", "Parity-space test", "test.parity.gps"),
        satellites.chart(
            "residuals", "Residuals of the satellites, in σ", "1", "residuals", "residual.snapshot.{satellite}"
        ),
        Chart(id="hdop", title="HDOP", unit="1", group="geometry", traces=(Trace(signal="gps.hdop", label="HDOP"),)),
    ),
    blocks=(
        Block(
            id="snapshot-test", label="Snapshot test", kind="test", x=24, y=3, width=25, height=12,
            settings=SETTINGS,
        ),
        Block(id="snapshot", label="Snapshot", kind="computer", x=78, y=3, width=21, height=12),
    ),
    wires=(
        Wire(source="satellites", target="snapshot-test"),
        Wire(source="snapshot-test", target="snapshot"),
        Wire(source="snapshot-test", target="combination"),
    ),
)  # fmt: skip


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


def report(say: Ledger, snapshot: Snapshot, columns: NDArray[np.intp], p_fa: float) -> None:
    """The snapshot's test on both ways, and the residuals of the satellites in these ``columns``.

    A satellite's statistic is its residual against all others; it alarms where the test of all does and names it.
    """
    form, verdict, everyone = snapshot.form, snapshot.verdict, snapshot.everyone
    judged, single = form.dof > 0, chi_square.threshold(p_fa, 1)
    statistic = np.where(judged, form.statistic, np.nan)
    say.test("snapshot", "gps", statistic, verdict.threshold, form.dof, verdict.alarm)
    residual = np.where(judged[:, None], form.normalised, np.nan)
    named(say, "snapshot", residual, verdict.excluded, columns, single)
    say.test(
        "parity",
        "gps",
        np.where(judged, snapshot.parity, np.nan),
        verdict.threshold,
        form.dof,
        judged & (snapshot.parity >= verdict.threshold),
    )
    say["residual.snapshot.{satellite}", columns] = form.normalised
    say["residual.threshold"] = np.where(np.isfinite(residual).any(axis=-1), np.sqrt(single), np.nan)
    say["gps.hdop"] = least_squares.hdop(snapshot.measurement.H, snapshot.fix.valid, everyone.solved)
    say["gps.dof"] = snapshot.fix.dof


def named(
    say: Ledger, test: str, residual: Array, excluded: Flags, columns: NDArray[np.intp], threshold: float
) -> None:
    """A test of each satellite ``(runs, n)`` in these ``columns``: its residual against all others [sigma] squared."""
    finite = np.isfinite(residual)
    limit = np.where(finite, threshold, np.nan)
    say.test(test, "gps.{satellite}", residual**2, limit, finite, excluded, columns)


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's block of the snapshot test."""
    return {"snapshot-test": satellites.verdict(now, "snapshot")}
