"""A score as a person reads it: the strip in lines, and everything as HTML."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ftcore.display import card, counted, quantity, table
from ftcore.score import intervals

if TYPE_CHECKING:
    from ftcore.score.models import Headline, Score, TestScore


def lines(score: Score) -> Iterator[str]:
    """A line for the whole, then one per item of the strip and one per fault."""
    yield f"<Score of {counted(score.runs, 'run')}, {score.time:g} s>"
    for item in score.headline:
        yield f"  {item.label}: {' '.join(part for part in _told(item) if part)}"
    for fault in score.faults:
        yield f"  {fault.label}: {fault.words}"


def _told(item: Headline) -> tuple[str, str, str]:
    against = f"({item.compare_label}: {quantity(item.compare, item.unit)})" if item.compare_label else ""
    return quantity(item.value, item.unit), item.note, against


def html(score: Score) -> str:
    """The strip, faults, tests and isolations of the sound, and the estimators' errors."""
    tests = [
        (t.name, t.subject, str(t.alarms), str(t.epochs), _percent(t), str(t.stretches), t.runs.words)
        for t in score.tests
        if t.epochs
    ]
    estimators = []
    for name, e in score.estimators.items():
        errors = [(getattr(e, quantity_), unit) for quantity_, unit in _ERRORS.items()]
        cells = [f"{quantity(error.rms, unit)}, at most {quantity(error.worst, unit)}" for error, unit in errors]
        estimators.append((name, *cells, quantity(e.nees, f"of {e.nees_dof}") if e.nees_dof else "–"))
    return card(
        f"Score of {counted(score.runs, 'run')}",
        f"{score.time:g} s flown; what a fault explains counts as recovering for {score.recovery:g} s after it",
        table("", ("", "", "", "compared with"), [(item.label, *_told(item)) for item in score.headline]),
        table("Faults", ("fault", "what came of it"), [(f.label, f.words) for f in score.faults]),
        table(
            "False alarms: while nothing was wrong with the subject",
            ("test", "subject", "alarms", "of tests", "rate, with interval (tests as independent)", "stretches", "in"),
            tests,
        ),
        table("False isolations", ("subject", ""), [(i.label, i.words) for i in score.isolations if i.count]),
        table("Errors after settling: root mean square, and worst", ("estimator", *_ERRORS, "NEES"), estimators),
    )


def _percent(test: TestScore) -> str:
    if test.false_alarm_rate is None or test.low is None or test.high is None:
        return "–"
    return f"{intervals.percent(test.false_alarm_rate)} % ({intervals.between(test.low, test.high)})"


_ERRORS = {"position": "m", "velocity": "m/s", "attitude": "rad"}
