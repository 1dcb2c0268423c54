"""The altimeter as an aid that can fail: its test, its isolation and its way back.

It is judged before it damps the strapdown, by its innovation against the *witness*: one more filter of the bank,
outside the two local filters. The witness takes GPS and Doppler where they are trusted, and the altimeter as a
measurement,

    h_INS - h_baro = dh - E_po - E_hsf h_baro - noise,

which the local filters must not do: a shared row would correlate them. To the witness the damping that follows is
a known correction of the strapdown in metres, not noise. So its innovations are white and exactly chi-square on one
degree of freedom. After a minute it knows dh - E_po - E_hsf h to a fraction of a metre, though neither dh nor E_po to
better than several. A slow fault of GPS moves dh and E_po together and does not speak against the altimeter.

A suspected or isolated reading is withheld: the vertical channel is not damped in that epoch, and the witness does not
take the reading. An isolated altimeter comes back after the hold-off if it agrees with the bias that was learned of it.
The bias may have changed by what this admission could not have seen, so its variance is increased by as much.

An altimeter that has another bias than before (when a fault ends that was too slow to be seen) would stay out for good.
Therefore, after `STEADY` epochs in which it differed from the prediction by a constant, it is taken back with that
constant added to its bias.

Source: FTLab's own; the altimeter's error model is Zhang 1992's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Channel, Chart, Subsystem, Test, Trace
from ftcore.detection import chi_square, supervisor
from ftcore.estimation.federated import Estimate
from ftcore.estimation.ins_error import ALTIMETER_BIAS, ALTIMETER_SCALE
from ftcore.faults import ALL_KINDS
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.forms import Settings
from ftcore.systems.sins_gps_doppler.strapdowns import Damping

Array = NDArray[np.float64]

DECLARED: Final = Declared(
    channels=(
        Channel(
            name="altimeter.height.up",
            label="Altimeter height",
            unit="m",
            sensor="altimeter",
            group="altimeter.height",
            parts=(0,),
            kinds=ALL_KINDS,
            typical=100.0,
        ),
    ),
    subsystems=(Subsystem(name="altimeter", label="Altimeter"),),
    subjects={"altimeter": "altimeter"},
    signals=(
        Signals("used.altimeter", "altimeter used", "1", "decision"),
        Signals("discrepancy.altimeter", "altimeter: reading minus its prediction", "m", "output"),
    ),
    tests=(
        Test(
            name="altimeter",
            label="altimeter test",
            subjects=("altimeter",),
            dof="1",
            source="FTLab: innovation before it damps the strapdown",
            probability="exact",
        ),
    ),
    charts=(
        chart_of_test("altimeter-altimeter", "Altimeter test, altimeter", "test.altimeter.altimeter"),
        Chart(
            id="altimeter-discrepancy",
            title="Altimeter: reading minus its prediction",
            unit="m",
            group="outputs",
            traces=(Trace(signal="discrepancy.altimeter", label="altimeter"),),
        ),
    ),
)
STEADY = 40
"""Epochs for which an isolated altimeter has to differ by a constant before that is taken for its bias."""
P_STEADY = 1e-3
"""Tail probability of the test for a constant."""


@dataclass(frozen=True)
class AltimeterState:
    """What is carried from epoch to epoch.

    Attributes:
        supervisor: of the altimeter, one subject.
        lately: its latest innovations in units of their standard deviation ``(runs, STEADY)``, newest last; NaN before
            the flight and where a reading was missing.
        out: ``(runs,)`` epochs for which it has been isolated.
    """

    supervisor: supervisor.State
    lately: Array
    out: NDArray[np.int64]


@dataclass(frozen=True)
class AltimeterEpoch:
    """What is said of the altimeter in one epoch.

    Attributes:
        statistic, threshold, dof, alarm: ``(runs, 1)``; dof 0 without a reading.
        decision: of the supervisor, ``(runs, 1)``.
        innovation: ``(runs,)`` strapdown minus reading minus what was predicted of that [m]; NaN without a reading.
        opened: ``(runs,)`` variance by which its bias is re-opened [m^2]; 0 if it is not back.
        shift: ``(runs,)`` by how much the bias was found to have changed [m].
        age: ``(runs,)`` epochs since the most likely onset of a fault, 0 for this epoch; where it is isolated now.
    """

    statistic: Array
    threshold: Array
    dof: NDArray[np.int64]
    alarm: Flags
    decision: supervisor.Decision
    innovation: Array
    opened: Array
    shift: Array
    age: NDArray[np.int64]

    @property
    def used(self) -> Flags:
        """``(runs,)`` whether a reading, if there is one, is taken."""
        return self.decision.use[:, 0]


def start(runs: int) -> AltimeterState:
    """Trusted, nothing seen."""
    return AltimeterState(supervisor.start(runs, 1), np.full((runs, STEADY), np.nan), np.zeros(runs, np.int64))


def row(damping: Damping, states: int) -> Array:
    """The measurement row of ``above``, ``(runs, states)``: dh - E_po - E_hsf h.

    h is the altimeter's own height, not the strapdown's: that one wanders by 100 m while it is being damped, and with
    it bias and scale factor would look separable in level flight, which they are not.
    """
    a = np.zeros((len(damping.height), states))
    a[:, 2] = 1.0
    a[:, ALTIMETER_BIAS] = -1.0
    a[:, ALTIMETER_SCALE] = -damping.height
    return a


def judge(
    state: AltimeterState,
    witness: Estimate,
    damping: Damping,
    variance: float,
    enabled: bool,
    settings: Settings,
    rules: supervisor.Rules,
) -> tuple[AltimeterState, AltimeterEpoch]:
    """One epoch, before the reading is used; ``witness`` as predicted, ``variance`` of the reading's noise [m^2]."""
    a = row(damping, witness.x.shape[-1])
    S = np.vecdot(np.matvec(witness.P, a), a) + variance
    nu = damping.above[:, 0] - np.vecdot(a, witness.x)
    there = damping.present
    statistic = np.where(there, nu**2 / S, 0.0)
    dof = there.astype(np.int64)
    limit = chi_square.threshold(settings.false_alarm_probability, dof)
    agrees = there & (statistic <= limit)
    alarm = there & ~agrees

    lately = np.concatenate([state.lately[:, 1:], np.where(there, nu / np.sqrt(S), np.nan)[:, None]], axis=1)
    out = np.where(state.supervisor.health[:, 0] == supervisor.ISOLATED, state.out + 1, 0)
    constant = out >= STEADY
    if constant.any():
        constant = constant & _is_constant(lately)
    watched = state.supervisor
    if constant.any():
        passed = np.where(constant[:, None], rules.hold_off - 1, watched.streak)
        watched = replace(watched, streak=passed)
    driven = alarm & (settings.altimeter_driving_test != "none")
    supervision, decision = supervisor.step(
        watched, driven[:, None], (agrees | constant)[:, None], np.array([[enabled]]), rules
    )
    back = decision.just_readmitted[:, 0]
    shift = np.zeros(len(nu))
    if back.any():
        shift = np.where(back & constant & ~agrees, np.nan_to_num(lately).mean(axis=-1) * np.sqrt(S), 0.0)
    epoch = AltimeterEpoch(
        statistic=statistic[:, None],
        threshold=limit[:, None],
        dof=dof[:, None],
        alarm=alarm[:, None],
        decision=decision,
        innovation=np.where(there, nu, np.nan),
        opened=np.where(back, limit * S, 0.0),
        shift=shift,
        age=_since_onset(lately) if decision.just_isolated.any() else np.zeros(len(nu), np.int64),
    )
    return AltimeterState(supervision, lately, out), epoch


def _is_constant(lately: Array) -> Flags:
    """Whether innovations ``(runs, STEADY)`` scatter about their mean as by chance; never if one is missing."""
    spread = np.square(lately - lately.mean(axis=-1, keepdims=True)).sum(axis=-1)
    return np.asarray(spread < chi_square.threshold(P_STEADY, STEADY - 1))  # NaN makes it False


def _since_onset(lately: Array) -> NDArray[np.int64]:
    """Epochs since the most likely onset of a step in white innovations ``(runs, STEADY)``: the largest likelihood
    ratio, sum^2 / count, of all sums that end now. Source: as :mod:`ftcore.detection.likelihood_ratio`."""
    newest_first = lately[:, ::-1]
    count = np.cumsum(~np.isnan(newest_first), axis=-1)
    ratio = np.square(np.cumsum(np.nan_to_num(newest_first), axis=-1)) / np.maximum(count, 1)
    return np.asarray(ratio.argmax(axis=-1))


def report(say: Ledger, epoch: AltimeterEpoch, present: Flags) -> None:
    """The test, the decision, and what the reading says; ``present (runs,)``: there is one."""
    tested = epoch.dof[:, 0] > 0
    statistic, threshold = (np.where(tested, v[:, 0], np.nan) for v in (epoch.statistic, epoch.threshold))
    say.test("altimeter", "altimeter", statistic, threshold, epoch.dof[:, 0], epoch.alarm[:, 0])
    used = epoch.used & present
    say.judge("altimeter", epoch.decision.health[:, 0], used)
    say["used.altimeter"] = used
    say["discrepancy.altimeter"] = -epoch.innovation
