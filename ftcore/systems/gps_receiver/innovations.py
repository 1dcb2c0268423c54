"""The filters' tests: their innovations against each other, and the combined filter against its own satellites."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Test, Wire
from ftcore.detection import chi_square
from ftcore.detection.raim import Consistency, Isolation
from ftcore.estimation.least_squares import Fix
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver import satellites
from ftcore.systems.gps_receiver.bank import COMBINED, FILTER, PLACE, Bank
from ftcore.systems.gps_receiver.snapshot import SETTINGS, named
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]

_STANDS_STILL: Final = (
    "the filter allows for a receiver that moves (position noise S_p), and the simulated one stands still; "
    "with S_p = 0 it is exact"
)
DECLARED: Final = Declared(
    tests=(
        Test(
            name="innovation",
            label="innovation test",
            subjects=("gps", "gps.{satellite}"),
            dof="satellites; a satellite: 1, and it alarms where the test of all names it",
            source="Chey 2004, section 3",
            probability="bounded",
            probability_note=f"alarms at 0.7 of the stated probability: {_STANDS_STILL}",
        ),
        Test(
            name="agreement",
            label="agreement of combined filter and snapshot",
            subjects=("gps",),
            dof="4: position and clock",
            source="FTLab: what resets the combined filter",
            may_drive=False,
            probability="bounded",
            probability_note=f"alarms at 0.3 to 0.6 of the stated probability: {_STANDS_STILL}",
        ),
    ),
    signals=(
        Signals(
            "residual.innovation.{satellite}", "{satellite}: innovation against all others, in sigmas", "1", "residual"
        ),
    ),
    charts=(
        chart_of_test("innovation", "Innovation test", "test.innovation.gps"),
        chart_of_test("agreement", "Agreement of combined filter and snapshot", "test.agreement.gps"),
        satellites.chart(
            "innovations", "Innovations of the satellites, in σ", "1", "residuals", "residual.innovation.{satellite}"
        ),
    ),
    blocks=(
        Block(
            id="innovation-test", label="Innovation test", kind="test", x=24, y=27, width=25, height=13,
            settings=SETTINGS,
        ),
    ),
    wires=(
        Wire(source="satellites", target="innovation-test"),
        Wire(source="innovation-test", target="combination"),
        Wire(source="innovation-test", target="filter"),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Agreement:
    """The combined filter's prediction against a snapshot of the satellites it takes, all (runs,)."""

    statistic: Array
    dof: NDArray[np.int64]
    limit: Array
    alarm: Flags


def agreement(prior: Bank, fixes: Fix, offset: Array, p_fa: float) -> Agreement:
    """d' (P_snapshot + P_prediction)^-1 d of position and clock, where the snapshot of its own satellites is sound."""
    i = COMBINED + 1
    x = fixes.x[:, i].copy()
    x[:, :3] += offset
    tested = prior.started & (fixes.dof[:, i] > 0)
    sound = fixes.statistic[:, i] < chi_square.threshold(p_fa, fixes.dof[:, i])
    d = x - prior.x[:, COMBINED, PLACE]
    W = fixes.covariance[:, i] + prior.P[:, COMBINED][:, PLACE[:, None], PLACE]
    statistic = np.vecdot(d, np.linalg.solve(W, d[..., None])[..., 0])
    dof, limit, alarm = chi_square.decide(statistic, np.where(tested & sound, len(PLACE), 0), p_fa)
    return Agreement(np.where(dof > 0, statistic, 0.0), dof, limit, alarm)


def report(
    say: Ledger, form: Consistency, verdict: Isolation, agreed: Agreement, columns: NDArray[np.intp], p_fa: float
) -> None:
    """The innovation test of the filter that decides for itself, and the agreement of the combined one."""
    judged = form.dof[:, FILTER] > 0
    say.test(
        "innovation",
        "gps",
        np.where(judged, form.statistic[:, FILTER], np.nan),
        verdict.threshold[:, FILTER],
        form.dof[:, FILTER],
        verdict.alarm[:, FILTER],
    )
    residual = np.where(judged[:, None], form.normalised[:, FILTER], np.nan)
    named(say, "innovation", residual, verdict.excluded[:, FILTER], columns, chi_square.threshold(p_fa, 1))
    say["residual.innovation.{satellite}", columns] = form.normalised[:, FILTER]
    tested = np.where(agreed.dof > 0, agreed.statistic, np.nan)
    say.test("agreement", "gps", tested, agreed.limit, agreed.dof, agreed.alarm)


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's block of the innovation test."""
    return {"innovation-test": satellites.verdict(now, "innovation")}
