"""Analytic redundancy: a UKF that flies along without the gyros under suspicion, to say which of them is wrong.

It runs only in an *episode*: from the epoch in which parity space declares more than one gyro (or cannot solve for the
rates) until everybody is trusted again. It starts some steps before that epoch, from states that were stored then, and
comes forward on the readings of the others and on air data (Kim 2005, section 4.2 and figure 2). Its rates are also
what is flown on while nobody is named, and when too few gyros are left.

Shapes lead with runs; in each epoch only the runs in an episode are computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Channel, Chart, Subsystem, Test, Trace, Wire
from ftcore.detection import chi_square
from ftcore.estimation import kalman, unscented
from ftcore.faults import ALL_KINDS
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.redundant_imu import fdi
from ftcore.systems.redundant_imu.aircraft import EPOCH, HEALTHY
from ftcore.systems.redundant_imu.forms import MOST_LEAD, Parameters, Settings
from ftcore.systems.redundant_imu.gyros import INSTRUMENTS
from ftcore.systems.redundant_imu.model import AIR_STATES, MODELLED, RATES, FlightModel, within
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

L = len(MODELLED)
AXES = 2 * INSTRUMENTS
RULE = unscented.Rule(redraw=False)
CLEAR = 5
"""Epochs in a row without a detection after which a doubt is dropped."""


AIR: Final = "air"
AIR_DATA: Final = {
    "speed": ("Airspeed", "m/s", 10.0),
    "alpha": ("Angle of attack", "deg", 3.0),
    "beta": ("Angle of sideslip", "deg", 3.0),
    "height": ("Height", "m", 30.0),
}
"""Quantity -> label, unit, fault worth trying first."""
DECLARED: Final = Declared(
    channels=tuple(
        Channel(
            name=f"{AIR}.{quantity}.value",
            label=label,
            unit=unit,
            sensor=AIR,
            group=f"{AIR}.{quantity}",
            parts=tuple(range(HEALTHY)),
            kinds=ALL_KINDS,
            typical=typical,
        )
        for quantity, (label, unit, typical) in AIR_DATA.items()
    ),
    subsystems=(Subsystem(name=AIR, label="Air data", isolable=False),),
    tests=(
        Test(
            name="ukf",
            label="UKF residual",
            subjects=("imu.gyro.{gyro}",),
            dof="2",
            source="Kim 2005 (48)-(49)",
            may_drive=False,
            reference=("air",),
            probability="approximate",
            probability_note="it runs after an alarm only, and its model of the aircraft is wrong by a few per cent: "
            "not measured",
        ),
    ),
    signals=(
        Signals("residual.ukf.{axis}", "UKF residual, gyro {axis}", "rad/s", "residual"),
        Signals("ukf.active", "UKF runs", "1", "decision"),
        Signals("isolation.open", "somebody is in doubt", "1", "decision"),
    ),
    charts=(
        fdi.chart("ukf", "UKF residuals (figure 7)", "1", "log"),
        Chart(
            id="residual-axes",
            title="UKF residuals by axis",
            unit="rad/s",
            group="tests",
            traces=(Trace(signal="residual.ukf.{axis}", label="gyro {axis}"),),
        ),
    ),
    blocks=(
        Block(id="air", label="Air data", kind="sensor", x=1, y=41, width=21, height=11, sensor=AIR, subsystem=AIR),
        Block(id="ukf", label="UKF", kind="filter", x=26, y=41, width=23, height=12, settings=("hybrid", "lead")),
    ),
    wires=(Wire(source="air", target="ukf", carries=AIR), Wire(source="ukf", target="supervisor")),
)  # fmt: skip


@dataclass(frozen=True)
class Moment:
    """What is stored of one epoch, so that a filter can start there.

    Attributes:
        x: ``(runs, 9)`` navigated states.
        power, u: ``(runs,)`` and ``(runs, 4)``, engine power at this epoch and controls from it to the next.
        y, valid: ``(runs, 10)`` readings of six gyro axes and of air data.
    """

    x: Array
    power: Array
    u: Array
    y: Array
    valid: Flags


@dataclass(frozen=True)
class Episode:
    """The filters, and what they are about.

    Attributes:
        active: ``(runs,)`` the filter runs.
        open: ``(runs,)`` it is not known yet which of the suspects is wrong, or whether any is.
        suspects: ``(runs, 3)`` declared by parity space when it started; the filter does not take their readings.
        quiet: ``(runs,)`` epochs in a row without a detection.
        x, P: ``(runs, 9)``, ``(runs, 9, 9)``; meaningless where not active.
        past: the last epochs, the latest last.
    """

    active: Flags
    open: Flags
    suspects: Flags
    quiet: Ints
    x: Array
    P: Array
    past: tuple[Moment, ...]


class AnalyticRedundancy:
    """The UKF and its bookkeeping.

    Args:
        model: of the aircraft.
        H: ``(6, 3)`` input axes.
        p: noise of gyros and air data, trust in the model.
    """

    def __init__(self, model: FlightModel, H: Array, p: Parameters) -> None:
        self._model = model
        self._axes = H.reshape(INSTRUMENTS, 2, 3)
        self._seen = np.zeros((AXES + len(AIR_STATES), L))
        self._seen[:AXES, RATES] = H
        self._seen[np.arange(AXES, len(self._seen)), AIR_STATES] = 1.0
        a, t, gyro = p.air_data, p.trust, p.gyros.noise
        angle = np.deg2rad(a.angle)
        self._gyro = np.full(2, gyro**2)
        self._R = np.square([*[gyro] * AXES, a.speed, angle, angle, a.height])
        self._Q = np.diag(
            np.square(EPOCH * np.array([t.speed, *[t.wind] * 2, *[t.attitude] * 2, *[t.rate] * 3, t.height]))
        )
        # As good as what is stored: air data as read, rates of two instruments, attitude after some gyro noise.
        self._P0 = np.diag(np.square([a.speed, angle, angle, 0.005, 0.005, gyro, gyro, gyro, a.height]))

    def initial(self, start: Moment) -> Episode:
        """Nobody under suspicion."""
        runs = len(start.x)
        return Episode(
            active=np.zeros(runs, bool),
            open=np.zeros(runs, bool),
            suspects=np.zeros((runs, INSTRUMENTS), bool),
            quiet=np.zeros(runs, np.int64),
            x=start.x,
            P=np.array(np.broadcast_to(self._P0, (runs, L, L))),
            past=(start,),
        )

    def advance(self, episode: Episode, now: Moment, begin: Flags, suspects: Flags, out: Flags, lead: int) -> Episode:
        """One epoch: filters that run go on, those that ``begin`` start ``lead`` epochs ago and catch up.

        Args:
            now: readings of this epoch (its states, power and controls are not used).
            begin: ``(runs,)``.
            suspects: ``(runs, 3)`` who is declared, for those that begin.
            out: ``(runs, 3)`` whose readings no filter takes: isolated, off, without a reading.
            lead: epochs.
        """
        going = episode.active & ~begin
        if not (going.any() or begin.any()):
            return episode
        accused = np.where(begin[:, None], suspects, episode.suspects)
        trusted = ~(accused | out)
        x, P = episode.x.copy(), episode.P.copy()
        moments = (*episode.past[-lead:], now)
        if begin.any():
            rows = np.flatnonzero(begin)
            x[rows], P[rows] = self._run(moments[0].x[rows], self._P0, moments, trusted, rows)
        if going.any():
            rows = np.flatnonzero(going)
            x[rows], P[rows] = self._run(x[rows], P[rows], moments[-2:], trusted, rows)
        return Episode(
            active=episode.active | begin,
            open=np.where(begin, suspects.any(axis=-1), episode.open),
            suspects=accused,
            quiet=np.where(begin, 0, episode.quiet),
            x=x,
            P=P,
            past=episode.past,
        )

    def settle(self, episode: Episode, detected: Flags, isolated: Flags, blind: Flags, now: Moment) -> Episode:
        """The end of an epoch: what is settled, which filters rest, and what is stored.

        A doubt is settled when one of the suspects is isolated, or dropped after `CLEAR` epochs without a detection.
        The filter rests when nobody is in doubt, nobody isolated and the rates can be solved for.

        Args:
            detected: ``(runs,)`` by parity space.
            isolated: ``(runs, 3)``.
            blind: ``(runs,)`` rates cannot be solved from the gyros there are.
            now: this epoch, to be stored.
        """
        quiet = np.where(detected, 0, episode.quiet + 1)
        decided = (episode.suspects & isolated).any(axis=-1)
        dropped = episode.open & ~decided & (quiet >= CLEAR)
        open_ = episode.open & ~decided & ~dropped
        active = episode.active & (open_ | isolated.any(axis=-1) | blind)
        keep = active & ~dropped
        return Episode(
            active=active,
            open=open_,
            suspects=episode.suspects & keep[:, None],
            quiet=quiet,
            x=episode.x,
            P=episode.P,
            past=(*episode.past[-(MOST_LEAD - 1) :], now),
        )

    def residuals(self, episode: Episode, m: Array) -> tuple[Array, Array]:
        """Residuals (48)-(49) of readings ``m (runs, 6)``, and their statistic for every gyro, ``(runs, 3)``.

        r' (H_i P H_i' + sigma^2 I)^-1 r, chi-square on 2 for a gyro whose readings the filter does not take.
        """
        runs = len(m)
        seen = kalman.innovation(
            episode.x[:, None, RATES],
            episode.P[:, None, RATES, RATES],
            m.reshape(runs, INSTRUMENTS, 2),
            self._axes,
            self._gyro,
        )
        return seen.innovation.reshape(runs, AXES), seen.statistic

    def _run(self, x: Array, P: Array, moments: Sequence[Moment], trusted: Flags, rows: Ints) -> tuple[Array, Array]:
        """From the first of the moments to the last, taking in the readings of all but the first."""
        gyros = np.repeat(trusted[rows], 2, axis=1)
        usable = np.concatenate([gyros, np.ones((len(rows), len(AIR_STATES)), bool)], axis=1)
        for before, after in pairwise(moments):
            power, u = before.power[rows], before.u[rows]
            predicted = unscented.predict(x, P, lambda X, p=power, u=u: self._model.fly(X, p, u), self._Q, RULE)  # type: ignore[misc]
            # The readings are linear in the states: (41)-(47) are then the Kalman update, without points.
            y, valid = after.y[rows], after.valid[rows] & usable
            done = kalman.update(predicted.x, predicted.P, y, self._seen, self._R, valid)
            x, P = within(done.x), done.P
        return x, P

    def test(self, episode: Episode, m: Array, left_out: Flags, there: Flags, settings: Settings) -> UkfTest:
        """The residuals of those whose readings the filter does not take, against their thresholds."""
        judged = episode.active[:, None] & left_out & there
        limit: Array = np.full(judged.shape, chi_square.threshold(settings.false_alarm_probability, 2))
        residual, statistic = np.full(m.shape, np.nan), np.zeros(judged.shape)
        if episode.active.any():
            vectors, squares = self.residuals(episode, m)
            residual = np.where(np.repeat(judged, 2, axis=-1), vectors, np.nan)
            statistic = np.where(judged, squares, 0.0)
        alarm = judged & (statistic >= limit)
        return UkfTest(residual, statistic, limit, np.where(judged, 2.0, 0.0), alarm)


@dataclass(frozen=True)
class UkfTest:
    """Residuals ``(runs, 6)``, NaN where nobody is judged, and the test on them ``(runs, 3)``, there of dof 0."""

    residual: Array
    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags


def report(say: Ledger, episode: Episode, ukf: UkfTest) -> None:
    """The test of those whose readings the filter does not take."""
    fdi.tell(say, "ukf", "imu.gyro.{gyro}", ukf.statistic, ukf.threshold, ukf.dof, ukf.alarm)
    say["residual.ukf.{axis}"] = ukf.residual
    say["ukf.active"], say["isolation.open"] = episode.active, episode.open
    say.values["left out"] = episode.suspects & episode.active[:, None]


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's blocks of air data and UKF."""
    lost = any(channel.startswith(f"{AIR}.") for channel in now.faulted)
    on = now.controls.enabled[AIR]
    air = BlockView(
        health="off" if not on else "faulted" if lost else "ok",
        text="off" if not on else "faulted" if lost else "speed, angles, height",
    )
    if now.said is None or not now.said["ukf.active"][0]:
        return {"air": air, "ukf": BlockView(health="off", text="rests" if now.controls.settings.hybrid else "off")}
    out = np.flatnonzero(now.said.values["left out"][0])
    tied = now.said["isolation.ambiguous"][0] > 0.0
    text = "without gyros " + ", ".join(str(k + 1) for k in out) if len(out) else "flies along"
    ukf = BlockView(health="suspect" if tied else "ok", text="cannot tell" if tied else text)
    return {"air": air, "ukf": ukf}
