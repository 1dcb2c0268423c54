"""The two-propagator test of every aid: in both forms, and without the IMM."""

from __future__ import annotations

from typing import Final

import numpy as np

from ftcore.description import Chart, Test, Trace
from ftcore.detection.propagators import SubsystemTests
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger

_INNOVATION = (
    "GPS and BD2 alarm at 0.3 to 0.8 of the stated probability, CNS at 0.8 times 0.1, 1.7 times 0.01 and 6 times "
    "0.001, in clusters after turns: chi-square 3 holds for one matched model, and scale factors are in none (without "
    "them CNS alarms at 0.02 of 0.01)"
)
_STATE = "GPS and BD2 alarm at 0.1 to 0.3 of the stated probability, CNS as often as in the innovation form"
_ONE_MODEL = "alarms at 4 to 650 times the stated probability: one small Q, and no way out of a wrong reference"


def _test(name: str, label: str, dof: str, source: str, note: str, drives: bool = True) -> Test:
    return Test(
        name=name,
        label=label,
        subjects=("{aid}",),
        dof=dof,
        source=source,
        may_drive=drives,
        baseline=not drives,
        reference=("imu",),
        probability="approximate",
        probability_note=note,
    )


def _chart(id: str, title: str, group: str, *traces: Trace) -> Chart:
    return Chart(id=id, title=title, unit="1", group=group, scale="log", traces=traces)


def _plain(test: str, label: str) -> Chart:
    chart = chart_of_test(f"{test}-{{aid}}", f"{label}, {{aid}}", f"test.{test}.{{aid}}")
    q, threshold = chart.traces
    return chart.model_copy(update={"traces": (q.model_copy(update={"label": "q"}), threshold)})


_STEM: Final = "test.two-propagator.{aid}"
DECLARED: Final = Declared(
    tests=(
        _test(
            "two-propagator",
            "two-propagator test, innovation form",
            "readings of the aid, 3",
            "Yang 2016 (12)-(13), innovation form",
            _INNOVATION,
        ),
        _test(
            "two-propagator-state",
            "two-propagator test, state form",
            "directions learned, up to 3",
            "Yang 2016 (12)-(13), state form",
            _STATE,
        ),
        _test(
            "two-propagator-without-imm",
            "two-propagator test without IMM",
            "readings of the aid, 3",
            "Yang 2016 [20], innovation form",
            _ONE_MODEL,
            drives=False,
        ),
    ),
    signals=(Signals(f"{_STEM}.doubt", "two-propagator test, {aid}: lower threshold, doubt", "1", "test"),),
    charts=(
        _chart(
            "two-propagator-{aid}",
            "q of {aid}",
            "tests",
            Trace(signal=f"{_STEM}.statistic", label="q", role="statistic"),
            Trace(signal=f"{_STEM}.doubt", label="doubted from here", role="threshold"),
            Trace(signal=f"{_STEM}.threshold", label="rejected from here", role="threshold"),
        ),
        _chart(
            "imm-{aid}",
            "q of {aid}, with and without IMM",
            "with and without IMM",
            Trace(signal="test.two-propagator-without-imm.{aid}.statistic", label="without IMM", role="unprotected"),
            Trace(signal=f"{_STEM}.statistic", label="with IMM", role="statistic"),
            Trace(signal=f"{_STEM}.threshold", label="rejected from here", role="threshold"),
        ),
        _plain("two-propagator-state", "Two-propagator test, state form"),
        _plain("two-propagator-without-imm", "Two-propagator test without IMM"),
    ),
)


def report(
    say: Ledger, innovation: SubsystemTests, state: SubsystemTests, conventional: SubsystemTests, doubt: SubsystemTests
) -> None:
    """The three tests of every aid; ``doubt``: the one that weighs the aids."""
    for name, test in (
        ("two-propagator", innovation),
        ("two-propagator-state", state),
        ("two-propagator-without-imm", conventional),
    ):
        q = np.where(test.present, test.q, np.nan)
        say.test(name, "{aid}", q, test.reject, test.dof, test.alarm)
    say[f"{_STEM}.doubt"] = np.where(doubt.present, innovation.suspect, np.nan)
