"""When a fault was live, a test in alarm and a subject isolated: stretches of time, from the events of one run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from ftcore.description import SystemDescription
from ftcore.display import quantity
from ftcore.events import Event
from ftcore.faults import KINDS

Kind = Literal["fault", "alarm", "isolated"]
KINDS_OF_MARKS: tuple[Kind, ...] = ("fault", "alarm", "isolated")


@dataclass(frozen=True)
class Stretch:
    """Something that was so from ``start`` to ``end`` [s]; None: to the end of the flight."""

    kind: Kind
    label: str
    start: float
    end: float | None


def stretches(events: Iterable[Event], run: int, description: SystemDescription) -> list[Stretch]:
    """All stretches of a run, by its number; what the operator did counts for every run."""
    labels = {channel.name: channel.label for channel in description.channels}
    tests = {test.name: test.label for test in description.tests}
    subsystems = {subsystem.name: subsystem.label for subsystem in description.subsystems}
    done: list[Stretch] = []
    live: dict[tuple[str, str], Stretch] = {}

    def finish(key: tuple[str, str], time: float) -> None:
        stretch = live.pop(key, None)
        if stretch is not None and time > stretch.start:
            done.append(replace(stretch, end=time if stretch.end is None else min(time, stretch.end)))

    for event in events:
        kind, subject, detail, time = event.kind, event.subject, event.detail, event.time
        if event.run not in (-1, run):
            continue
        who = subsystems.get(subject, subject)
        if kind in ("fault.injected", "fault.changed"):
            size = "" if detail["unit"] is None else f" {quantity(detail['magnitude'], detail['unit'])}"
            label = f"{labels.get(detail['channel'], detail['channel'])}: {KINDS[detail['kind']].label}{size}"
            live["fault", str(detail["id"])] = Stretch("fault", label, detail["start"], detail["end"])
        elif kind == "fault.cleared":
            finish(("fault", str(detail["id"])), time)
        elif kind == "test.alarmed":
            test = str(detail["test"])
            live[test, subject] = Stretch("alarm", f"{tests.get(test, test)}: {who}", time, None)
        elif kind == "test.cleared":
            finish((str(detail["test"]), subject), time)
        elif kind == "subsystem.isolated":
            live["isolated", subject] = Stretch("isolated", f"{who} isolated", time, None)
        elif kind in ("subsystem.readmitted", "subsystem.switched"):
            finish(("isolated", subject), time)
    return sorted([*done, *live.values()], key=lambda s: s.start)
