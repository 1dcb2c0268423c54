"""The score from its rows: the one function that everything shown comes from."""

from __future__ import annotations

from collections.abc import Sequence

from ftcore.score.errors import of_estimator
from ftcore.score.headline import strip
from ftcore.score.healthy import false_alarms, false_isolations
from ftcore.score.models import Score
from ftcore.score.per_fault import tell
from ftcore.score.rows import Rows, merged


def summarise(rows: Rows) -> Score:
    """Medians, shares, rates, intervals and words of some rows. Pure."""
    description = rows.description
    told = [tell(facts, rows.of_fault(facts.id), description) for facts in rows.facts]
    tests = false_alarms(rows.flights, description)
    isolations = false_isolations(rows)
    estimators = {name: of_estimator(name, rows.flights) for name in description.estimators}
    score = Score(
        runs=len(rows.runs),
        time=rows.time,
        recovery=description.recovery,
        faults=[t.score for t in told],
        tests=tests,
        isolations=isolations,
        estimators=estimators,
        headline=strip(rows, told, tests, isolations, estimators),
    )
    score._rows = rows
    return score


def merge(scores: Sequence[Score]) -> Score:
    """The score of all runs of several scores, as if they had been scored together: the same to the bit.

    The scores are of the same scenario, seed and commands, flown equally far, and of different runs
    (``Simulation(first_run=...)``). Runs that fly in batches of other sizes agree to rounding.

    Raises:
        ValueError: no scores, a run that is in two of them, flights that differ in more than the run, or scores without
            rows.

    >>> from ftcore import Scenario, Simulation
    >>> zhang = Scenario.load("zhang-1992-visible")
    >>> parts = [Simulation(zhang, runs=2, first_run=k).advance(until=3.0).score() for k in (0, 2)]
    >>> merge(parts).rows.runs
    array([0, 1, 2, 3])
    """
    return summarise(merged([score.rows for score in scores]))
