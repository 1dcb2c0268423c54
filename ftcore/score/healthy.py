"""What happened to the sound: false alarms per test and subject, false isolations per subject.

Counted over the whole flight, whenever nothing that concerns the subject is there (:mod:`ftcore.score.blame`).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from ftcore.description import SystemDescription
from ftcore.description import Test as DeclaredTest
from ftcore.recording import Recording
from ftcore.score import intervals
from ftcore.score.blame import Judge
from ftcore.score.history import Spells
from ftcore.score.models import IsolationScore, TestScore, WrongIsolation
from ftcore.score.names import called
from ftcore.score.shares import number, share

Flags = NDArray[np.bool_]

LISTED = 20
"""False isolations of a subject that are told one by one."""
CHANCE = 0.01
"""Probability of calling alarms clustered although epochs are independent."""


def false_alarms(recording: Recording, description: SystemDescription, judge: Judge) -> list[TestScore]:
    """Every test on every subject that has a column in the recording."""
    return [
        _of_test(test, subject, recording, judge)
        for test in description.tests
        for subject in test.subjects
        if f"test.{test.name}.{subject}.alarm" in recording.column
    ]


def _of_test(test: DeclaredTest, subject: str, recording: Recording, judge: Judge) -> TestScore:
    prefix = f"test.{test.name}.{subject}"
    tested = ~np.isnan(recording.rows[:, :, recording.column[f"{prefix}.statistic"]])
    alarm = (recording.rows[:, :, recording.column[f"{prefix}.alarm"]] > 0.5) & tested
    own, reaching = judge.explaining(subject), judge.reaching(test.name, subject)
    reached = np.zeros_like(tested)
    sound = tested
    if own or reaching:
        ours = judge.there(own, subject, recording.time)
        others = judge.there(reaching, subject, recording.time)
        sound, reached = tested & ~ours & ~others, tested & ~ours & others
    false = alarm & sound
    alarms, epochs = int(false.sum()), int(sound.sum())
    begins = false.copy()
    begins[1:] &= ~false[:-1]
    stretches = int(begins.sum())
    runs = share(int(false.any(axis=0).sum()), int(sound.any(axis=0).sum()), "runs with such a test")
    rate = low = high = None
    clustered = False
    if epochs:
        rate = alarms / epochs
        low, high = intervals.of_share(alarms, epochs)
        clustered = alarms > 1 and float(binom.sf(alarms - stretches - 1, alarms, rate)) < CHANCE
    score = TestScore(
        name=test.name,
        subject=subject,
        alarms=alarms,
        epochs=epochs,
        false_alarm_rate=rate,
        low=low,
        high=high,
        stretches=stretches,
        clustered=clustered,
        runs=runs,
        reached_alarms=int((alarm & reached).sum()),
        reached_epochs=int(reached.sum()),
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


def false_isolations(recording: Recording, description: SystemDescription, judge: Judge) -> list[IsolationScore]:
    """Every subject that was in use, or was ever isolated."""
    used = [name.removeprefix("used.") for name in recording.column if name.startswith("used.")]
    names = dict.fromkeys([*used, *(s.name for s in description.subsystems if s.isolable), *judge.history.isolated])
    found = [_of_subject(name, recording, description, judge) for name in names]
    return [score for score in found if score.count or score.hours]


def _of_subject(subject: str, recording: Recording, description: SystemDescription, judge: Judge) -> IsolationScore:
    exposed = _in_use(subject, recording)
    own = judge.explaining(subject)
    if own:
        exposed = exposed & ~judge.there(own, subject, recording.time)
    spells = judge.history.isolated.get(subject, Spells.none())
    wrong, calm = judge.wrong(subject), judge.calm(subject)
    first = [
        WrongIsolation(time=float(spells.since[i]), run=int(spells.run[i]), calm=bool(calm[i]))
        for i in np.flatnonzero(wrong)[:LISTED]
    ]
    count = int(wrong.sum())
    hit = np.unique(spells.run[wrong])
    in_use = np.union1d(np.flatnonzero(exposed.any(axis=0)), hit)
    hours = float((exposed * _lasting(recording)[:, None]).sum()) / 3600.0
    per_hour = low = high = None
    if hours:
        per_hour = count / hours
        low, high = intervals.of_rate(count, hours)
    score = IsolationScore(
        subject=subject,
        label=called(description, subject),
        count=count,
        calm=int((wrong & calm).sum()),
        runs=share(len(hit), len(in_use), "runs in which it was in use"),
        hours=hours,
        per_hour=per_hour,
        low=low,
        high=high,
        first=first,
        words="",
    )
    return score.model_copy(update={"words": of_isolation(score)})


def _in_use(subject: str, recording: Recording) -> Flags:
    """Where the master uses a subject ``(epochs, runs)``; all along where that is not recorded."""
    column = recording.column.get(f"used.{subject}")
    if column is None:
        return np.ones(recording.rows.shape[:2], bool)
    used: Flags = recording.rows[:, :, column] > 0.5
    return used


def _lasting(recording: Recording) -> NDArray[np.float64]:
    """Seconds that each recorded epoch stands for; more than one period where a bounded recording was thinned."""
    return np.diff(recording.time, prepend=0.0)


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
