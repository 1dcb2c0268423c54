"""What happened to the sound, from the rows of the runs: false alarms per test and subject, false isolations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.stats import binom

from ftcore.description import SystemDescription
from ftcore.score import intervals
from ftcore.score.models import IsolationScore, TestScore, WrongIsolation
from ftcore.score.names import called
from ftcore.score.rows import Rows
from ftcore.score.shares import number, share
from ftcore.score.tables import Table

LISTED = 20
"""False isolations of a subject that are told one by one."""
CHANCE = 0.01
"""Probability of calling alarms clustered although epochs are independent."""


def false_alarms(flights: Table, description: SystemDescription) -> list[TestScore]:
    """Every test on every subject that has columns."""
    return [
        _of_test(test.name, subject, flights)
        for test in description.tests
        for subject in test.subjects
        if f"alarms.{test.name}.{subject}" in flights.columns
    ]


def _of_test(test: str, subject: str, flights: Table) -> TestScore:
    def count(what: str) -> int:
        return int(flights[f"{what}.{test}.{subject}"].sum())

    alarms, epochs, stretches = count("alarms"), count("tests"), count("stretches")
    with_alarm = int(np.count_nonzero(flights[f"alarms.{test}.{subject}"]))
    with_test = int(np.count_nonzero(flights[f"tests.{test}.{subject}"]))
    rate = low = high = None
    clustered = False
    if epochs:
        rate = alarms / epochs
        low, high = intervals.of_share(alarms, epochs)
        clustered = alarms > 1 and float(binom.sf(alarms - stretches - 1, alarms, rate)) < CHANCE
    score = TestScore(
        name=test,
        subject=subject,
        alarms=alarms,
        epochs=epochs,
        false_alarm_rate=rate,
        low=low,
        high=high,
        stretches=stretches,
        clustered=clustered,
        runs=share(with_alarm, with_test, "runs with such a test"),
        reached_alarms=count("reached_alarms"),
        reached_epochs=count("reached_tests"),
        words="",
    )
    return score.model_copy(update={"words": of_alarms([score])})


def of_alarms(scores: Iterable[TestScore]) -> str:
    """False alarms of one or several tests in words: count, denominator, rate, interval, and what it rests on."""
    scores = list(scores)
    alarms, epochs = sum(s.alarms for s in scores), sum(s.epochs for s in scores)
    reached, of = sum(s.reached_alarms for s in scores), sum(s.reached_epochs for s in scores)
    if not epochs:
        text = "no test so far of a sensor that nothing is wrong with"
    else:
        low, high = intervals.of_share(alarms, epochs)
        text = (
            f"{number(alarms, 'alarm', 'alarms')} in {number(epochs, 'test', 'tests')} of sensors that nothing was "
            f"wrong with, before, between and after faults: {intervals.percent(alarms / epochs)} % "
            f"({intervals.between(low, high)}, tests taken as independent)"
        )
        if any(s.clustered for s in scores):
            stretches = sum(s.stretches for s in scores)
            text += f"; they came in {number(stretches, 'stretch', 'stretches')}: the true interval is wider"
        runs = max((s.runs for s in scores), key=lambda r: r.of)
        if runs.of > 1 and len(scores) == 1:
            text += f"; in {runs.words}"
    if of:
        text += (
            f"; besides, {number(reached, 'alarm', 'alarms')} in {number(of, 'test', 'tests')} of sound sensors that "
            "share their equations with a faulty one"
        )
    return text


def false_isolations(rows: Rows) -> list[IsolationScore]:
    """Every subject that was in use, or was ever isolated."""
    flights, description = rows.flights, rows.description
    used = {signal.name.removeprefix("used.") for signal in description.signals if signal.name.startswith("used.")}
    listed = used | {subsystem.name for subsystem in description.subsystems if subsystem.isolable}
    found = []
    for name in flights:
        subject = name.removeprefix("in_use.")
        if subject != name and (subject in listed or flights[f"isolations.{subject}"].any()):
            found.append(_of_subject(subject, rows))
    return [score for score in found if score.count or score.hours]


def _of_subject(subject: str, rows: Rows) -> IsolationScore:
    flights = rows.flights
    times, hours = flights[f"wrong_isolations.{subject}"], float(flights[f"in_use.{subject}"].sum()) / 3600.0
    count, hit = int(times.sum()), int(np.count_nonzero(times))
    wrong = rows.wrong.take(rows.wrong["subject"] == subject)
    in_use = int(np.count_nonzero((flights[f"in_use.{subject}"] > 0.0) | (times > 0)))
    first = [
        WrongIsolation(time=float(time), run=int(run), calm=bool(calm))
        for time, run, calm in zip(*(wrong[name][:LISTED] for name in ("time", "run", "calm")), strict=True)
    ]
    per_hour = low = high = None
    if hours:
        per_hour = count / hours
        low, high = intervals.of_rate(count, hours)
    score = IsolationScore(
        subject=subject,
        label=called(rows.description, subject),
        count=count,
        calm=int(flights[f"calm_isolations.{subject}"].sum()),
        runs=share(hit, in_use, "runs in which it was in use"),
        hours=hours,
        per_hour=per_hour,
        low=low,
        high=high,
        first=first,
        words="",
    )
    return score.model_copy(update={"words": of_isolation(score)})


def of_isolation(score: IsolationScore) -> str:
    """False isolations of a subject in words."""
    exposure = f"{score.hours:.3g} h in use with nothing wrong about it"
    if score.per_hour is None or score.low is None or score.high is None:
        return f"isolated {number(score.count, 'time', 'times')} wrongly"
    rate, low, high = (intervals.figure(x) for x in (score.per_hour, score.low, score.high))
    text = (
        f"isolated {number(score.count, 'time', 'times')} wrongly in {exposure}: {rate} an hour (95 %: {low} to {high})"
    )
    if score.runs.of > 1:
        text += f"; in {score.runs.words}"
    if score.count:
        text += f"; {score.calm} of {score.count} when nothing at all was wrong"
    return text
