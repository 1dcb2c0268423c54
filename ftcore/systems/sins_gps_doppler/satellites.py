"""Satellite-level integrity in front of the GPS measurement: a wrong satellite goes, GPS stays.

The pseudoranges and delta pseudoranges of all satellites are compared with each other and with what is known without
them. What may be known is the choice, and one form covers it: the innovation against a prediction whose covariance is
infinite in every state that counts as unknown.

    snapshot     position, velocity and clock are unknown: the residual of least squares of Chey 2004, n - 4 degrees of
                 freedom for the ranges and as many for the rates. Nothing that the navigator believes can deceive it.
    innovation   the clock is unknown, position and velocity come from the strapdown with the covariance of the
                 two-propagator test's reference: n - 1 for each.

``innovation`` is the better one: position from the strapdown is redundancy that the constellation does not have. A bias
of 60 m on one of 8 satellites is named within an epoch or two before GPS as a whole is given up in 97 of 100 runs, with
the snapshot in 76; a ramp of 1 m/s in 97 and in 65. The usual price of innovations is that the prediction may be wrong
itself. Therefore it is the reference propagator's and not the fused one, which a slow fault of a satellite, or of
Doppler, carries along before it is noticed; the reference took its last measurement half a minute ago at least, from an
estimate that nobody doubted. And therefore the clock is left open: against a predicted clock a common jump of 300 m
ended with sound satellites accused in 84 % of the epochs, but a clock is nobody's satellite; such a jump is left to the
tests of the filter, and GPS goes as a whole.

Who is named is left out at once with both of its rows, is isolated by the supervisor's m-of-n, and comes back after it
has agreed, for the hold-off, with the fused prediction, which it had no part in. At most a minority is ever left out.
Where the culprit cannot be told nobody is: the answer is "cannot isolate", and GPS as a whole is judged by the driving
test. Source: J. Chey et al., ICCAS 2004; R.G. Brown, Navigation 39 (1992); :mod:`ftcore.detection.raim`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Health, Test
from ftcore.detection import chi_square, raim, supervisor
from ftcore.detection.raim import CANNOT_DETECT, CANNOT_ISOLATE, CONSISTENT, EXCLUDED, Consistency, Isolation
from ftcore.estimation import kalman
from ftcore.estimation.ins_error import CLOCK_FREQUENCY, CLOCK_PHASE
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.parts.satellites import LINES_OF_SIGHT
from ftcore.systems.base import Flags, Notice
from ftcore.systems.reporting import Now
from ftcore.systems.sins_gps_doppler.aids import SLOTS, Aid
from ftcore.systems.sins_gps_doppler.bank import FUSED, REFERENCE, Filters
from ftcore.systems.sins_gps_doppler.forms import Settings

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Codes = NDArray[np.int8]

DECLARED: Final = Declared(
    subjects={"gps.{satellite}": "satellite {satellite}"},
    signals=(Signals("used.gps.{satellite}", "satellite {satellite} used", "1", "decision"),),
    tests=(
        Test(
            name="integrity",
            label="satellite integrity test",
            subjects=("gps",),
            dof="ranges minus unknowns, and rates minus as many; none while it is off",
            source="Chey 2004; Brown 1992",
            may_drive=False,
            probability="exact",
        ),
    ),
    charts=(chart_of_test("integrity-gps", "Satellite integrity test, SINS/GPS", "test.integrity.gps"),),
    scene=(LINES_OF_SIGHT,),
)
LINE: Final = 1.5
"""Length of a line of sight in the scene."""

_OPEN = {
    "snapshot": np.array([0, 1, 2, CLOCK_PHASE, 3, 4, 5, CLOCK_FREQUENCY]),
    "innovation": np.array([CLOCK_PHASE, CLOCK_FREQUENCY]),
}
"""States that are unknown: those of the ranges, then as many of the rates."""
_WIDE = 1e8
"""Variance of an unknown state, in variances of a measurement of it: wide enough, and S keeps eight digits."""
_ANNOUNCED = {CANNOT_ISOLATE: "integrity.cannot-isolate", CANNOT_DETECT: "integrity.cannot-detect"}


@dataclass(frozen=True)
class SatelliteState:
    """Supervisor of all satellites, and what came of the epoch before ``(runs,)``, codes of ``raim``."""

    supervisor: supervisor.State
    status: Codes


@dataclass(frozen=True)
class SatelliteEpoch:
    """What integrity says of one epoch.

    Attributes:
        gps: the measurement without the excluded satellites.
        statistic, threshold, dof, alarm: ``(runs, 1)`` of the test of all satellites there are; dof 0 when it is off.
        health: ``(runs, satellites)`` codes of the supervisor.
        used: ``(runs, satellites)`` whose rows go on to the filters.
        notices: what there is to announce.
    """

    gps: Aid
    statistic: Array
    threshold: Array
    dof: Ints
    alarm: Flags
    health: Codes
    used: Flags
    notices: tuple[Notice, ...]


@lru_cache(maxsize=8)
def start(runs: int) -> SatelliteState:
    """Every satellite trusted."""
    return SatelliteState(supervisor.start(runs, len(SLOTS)), np.full(runs, CONSISTENT, np.int8))


def step(
    state: SatelliteState, gps: Aid, filters: Filters, settings: Settings, rules: supervisor.Rules
) -> tuple[SatelliteState, SatelliteEpoch]:
    """One epoch, before any filter has taken the measurement ``gps``; ``filters`` are predictions."""
    runs, n = len(gps.y), len(gps.columns) // 2
    slots = gps.columns[:n]
    rows = np.broadcast_to(gps.present, (runs, 2 * n))
    there = rows[:, :n] | rows[:, n:]
    if settings.satellite_integrity == "off":
        nothing, quiet = np.zeros((runs, 1)), np.zeros((runs, 1), bool)
        everyone = _spread(there, slots)
        sound = np.where(everyone, supervisor.HEALTHY, supervisor.OFF).astype(np.int8)
        silent = SatelliteEpoch(gps, nothing, nothing, np.zeros((runs, 1), np.int64), quiet, sound, everyone, ())
        return start(runs), silent

    form, verdict = _judge(gps, rows, filters, settings)
    held = there & (state.supervisor.health[:, slots] == supervisor.ISOLATED)
    kept = _judge(gps, rows & ~_both(held), filters, settings)[1] if held.any() else verdict
    status, accused = _minority(kept, there, held)

    off, variance = _against_fused(gps, filters)
    like = (off**2 <= chi_square.threshold(settings.false_alarm_probability, 1) * variance) | ~rows
    admissible = there & like[:, :n] & like[:, n:]
    supervision, decision = supervisor.step(
        state.supervisor, _spread(accused, slots), _spread(admissible, slots), _spread(there, slots), rules
    )
    used = decision.use[:, slots] & there
    trusted = rows & _both(used)
    epoch = SatelliteEpoch(
        gps=gps if np.array_equal(trusted, rows) else replace(gps, valid=trusted),
        statistic=form.statistic[:, None],
        threshold=verdict.threshold[:, None],
        dof=form.dof[:, None],
        alarm=verdict.alarm[:, None],
        health=decision.health,
        used=_spread(used, slots),
        notices=(*_announced(state.status, status), *_named(decision.just_isolated[:, slots], off, rows, slots)),
    )
    return SatelliteState(supervision, status), epoch


def _judge(gps: Aid, rows: Flags, filters: Filters, settings: Settings) -> tuple[Consistency, Isolation]:
    """The test of the valid ``rows (runs, 2n)`` and the search for the culprits; measurements in units of sigma."""
    unknown = _OPEN[settings.satellite_integrity]
    each, n = len(unknown) // 2, rows.shape[-1] // 2
    R = gps.R[0]
    sigma = np.sqrt(R)
    P = filters.P[:, REFERENCE].copy()
    P[:, unknown, unknown] += _WIDE * np.repeat([R[0, 0], R[0, n]], each)
    predicted = kalman.innovation(
        filters.x[:, REFERENCE], P, gps.y[:, 0] / sigma, gps.H[:, 0] / sigma[..., None], np.ones((1, 2 * n)), rows
    )
    form = raim.from_whitened(predicted.whitener, predicted.whitened, predicted.innovation, rows)
    numbers = np.count_nonzero(rows.reshape(-1, 2, n), axis=-1)
    form = replace(form, dof=np.maximum(numbers - each, 0).sum(axis=-1))
    margin = raim.margin(settings.wrong_isolation_probability)
    return form, raim.isolate(form, settings.false_alarm_probability, np.maximum(form.dof // 2, 1), margin)


def _minority(verdict: Isolation, there: Flags, held: Flags) -> tuple[Codes, Flags]:
    """Status (runs,) and who is accused (runs, n): by either row, and nobody where half of all would be out."""
    n = there.shape[-1]
    accused = verdict.excluded[:, :n] | verdict.excluded[:, n:]
    too_many = 2 * np.count_nonzero(accused | held, axis=-1) >= np.count_nonzero(there, axis=-1)
    status = np.where(accused.any(axis=-1) & too_many, CANNOT_ISOLATE, verdict.state)
    status = np.where(there.any(axis=-1), status, CONSISTENT)
    return status.astype(np.int8), accused & (status == EXCLUDED)[:, None]


def _against_fused(gps: Aid, filters: Filters) -> tuple[Array, Array]:
    """Each row's innovation against the fused prediction and its variance, (runs, 2n)."""
    H = gps.H[:, 0]
    off = gps.y[:, 0] - np.matvec(H, filters.x[:, FUSED])
    return off, gps.R[0] + np.vecdot(H @ filters.P[:, FUSED], H)


def _announced(before: Codes, now: Codes) -> list[Notice]:
    """What happened to integrity as a whole."""
    if np.array_equal(before, now):
        return []
    turned = {kind: (now == code) & (before != code) for code, kind in _ANNOUNCED.items()}
    turned["integrity.restored"] = (now <= EXCLUDED) & (before > EXCLUDED)
    return [Notice(kind, "gps", where, {}) for kind, where in turned.items() if where.any()]


def _named(isolated: Flags, off: Array, rows: Flags, slots: Ints) -> list[Notice]:
    """The numbers behind an isolation: how far range and rate are off the fused prediction."""
    shown, n = np.where(rows, off, np.nan), len(slots)
    return [
        Notice(
            "channel.named",
            f"gps.{SLOTS[slots[i]]}",
            isolated[:, i],
            {"range_off [m]": shown[:, i], "rate_off [m/s]": shown[:, n + i]},
        )
        for i in np.flatnonzero(isolated.any(axis=0)).tolist()
    ]


def _both(satellites: Flags) -> Flags:
    """(runs, n) satellites as (runs, 2n) rows."""
    return np.concatenate([satellites, satellites], axis=-1)


def _spread(satellites: Flags, slots: Ints) -> Flags:
    """(runs, n) over all slots."""
    wide = np.zeros((len(satellites), len(SLOTS)), bool)
    wide[:, slots] = satellites
    return wide


def report(say: Ledger, epoch: SatelliteEpoch, feeding: Flags, lines: Array) -> None:
    """The test, who is out, and who is used where GPS feeds the master, ``feeding (runs,)``; ``lines`` of sight."""
    tested = epoch.dof[:, 0] > 0
    statistic, threshold = (np.where(tested, v[:, 0], np.nan) for v in (epoch.statistic, epoch.threshold))
    say.test("integrity", "gps", statistic, threshold, epoch.dof[:, 0], epoch.alarm[:, 0])
    used = epoch.used & feeding[:, None]
    say.judge("gps.{satellite}", epoch.health, used)
    say["used.gps.{satellite}"] = used
    say.draw("satellite.{satellite}", LINE * lines)


def items(now: Now) -> dict[str, Health]:
    """With GPS out all satellites are, but for those with a fault."""
    if now.health["gps"] not in ("isolated", "off"):
        return {}
    return {f"satellite.{slot}": "isolated" for slot in SLOTS if not now.faulted & _channels(slot)}


def _channels(slot: str) -> set[str]:
    return {f"gps.{quantity}.{part}" for quantity in ("pseudorange", "delta_range") for part in (slot, "all")}
