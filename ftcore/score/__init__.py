"""Score: a flight against the truth, judged in time.

Per fault: when which test noticed, when the culprit was named, who was wronged meanwhile, when it was trusted again,
what it cost. Per test: alarms while nothing was wrong with its subject. Per subject: isolations of the sound. Per
estimator: errors and consistency. What concerns whom, and until when after a fault, is written once, in
:mod:`ftcore.score.blame`.

Delays are medians over the runs in which it happened, and count from the first epoch in which the fault acted; shares
are of the runs in which it acted. A fault that never acted is listed with the reason, and is neither found nor missed.
Every share and rate has its exact 95 % interval. Those of false alarms take tests as independent; where alarms come in
clusters it is said, and the share of runs with an alarm, which are independent, stands beside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ftcore.description import SystemDescription
from ftcore.events import Event
from ftcore.faults import Acted, ChannelAddress, Fault
from ftcore.recording import Recording
from ftcore.score.blame import judge
from ftcore.score.errors import of_estimator
from ftcore.score.headline import strip
from ftcore.score.healthy import false_alarms, false_isolations, of_alarms
from ftcore.score.history import read
from ftcore.score.models import (
    ErrorScore,
    EstimatorScore,
    FaultScore,
    Headline,
    IsolationScore,
    Outcome,
    Score,
    Share,
    TestScore,
    WrongIsolation,
)
from ftcore.score.per_fault import tell

__all__ = [
    "ErrorScore",
    "EstimatorScore",
    "FaultScore",
    "Headline",
    "IsolationScore",
    "Outcome",
    "Score",
    "Share",
    "TestScore",
    "WrongIsolation",
    "compute",
    "of_alarms",
]


def compute(
    recording: Recording,
    events: Sequence[Event],
    faults: Sequence[Fault],
    description: SystemDescription,
    channels: Mapping[str, ChannelAddress],
    acted: Mapping[str, Acted],
    silent: Mapping[str, str | None] | None = None,
    first_run: int = 0,
) -> Score:
    """Score a recording. Pure; needs nothing of the system but its description.

    Args:
        recording: of the flight so far.
        events: all of it, in order of time.
        faults: all that were laid; those that start later are not told.
        description: of the system.
        channels: addresses by channel name.
        acted: fault id -> when it acted in each run; one that is missing has never acted.
        silent: fault id -> why it did not act, for those that did not.
        first_run: number of the first run, by which events name it.
    """
    runs = recording.rows.shape[1]
    now = float(recording.time[-1]) if len(recording) else 0.0
    begun = [f for f in faults if f.start is not None and f.start <= now]
    judged = judge(begun, acted, channels, description, read(events, first_run), runs)
    because = silent or {}
    told = [
        tell(cause, judged, recording, description, channels, because.get(str(cause.fault.id)))
        for cause in judged.causes
    ]
    tests = false_alarms(recording, description, judged)
    isolations = false_isolations(recording, description, judged)
    estimators = {name: of_estimator(name, recording) for name in description.estimators}
    return Score(
        runs=runs,
        time=now,
        recovery=description.recovery,
        faults=[t.score for t in told],
        tests=tests,
        isolations=isolations,
        estimators=estimators,
        headline=strip(recording, description, told, tests, isolations, estimators),
    )
