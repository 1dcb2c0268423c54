"""What a part of a system says of itself: its names, and how a person sees them.

A name with a field in braces stands for its members: ``elevation.{satellite}`` is one signal of every satellite.
Signals, tests, charts and scene items are declared so, and become the lists of a system's description.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import product
from typing import Any, TypeVar

from ftcore.description import (
    Block,
    Channel,
    Chart,
    Described,
    SceneItem,
    Signal,
    Subsystem,
    SystemDescription,
    Test,
    Trace,
    Wire,
    with_probabilities,
)

OF_TEST = ("statistic", "threshold", "dof", "alarm")
"""What is recorded of every test and subject."""
_FIELD = re.compile(r"{(\w+)}")
T = TypeVar("T", bound=Described)


class DeclarationError(Exception):
    """Parts of a system declare what cannot be together; a defect of a part, or of who put them together."""


@dataclass(frozen=True)
class Signals:
    """A declared signal, or one of every member of the fields in braces.

    Attributes:
        name: with fields in braces.
        label: the same fields in braces, where the members' labels are put.
        unit: shown to a person; the number is SI.
        group: for choosing.
    """

    name: str
    label: str
    unit: str
    group: str


def channels_of(
    group: str,
    label: str,
    members: Mapping[str, str],
    *,
    sensor: str,
    unit: str,
    kinds: tuple[str, ...],
    typical: float,
) -> tuple[Channel, ...]:
    """Channels of a reading group, one a column.

    Args:
        group: ``<sensor>.<quantity>``.
        label: with ``{}`` for the member's.
        members: part of the name -> its label, in the order of the columns.
        sensor: whose they are, with ``{}`` for the member where each has its own.
    """
    return tuple(
        Channel(
            name=f"{group}.{member}",
            label=label.format(words),
            unit=unit,
            sensor=sensor.format(member),
            group=group,
            parts=(i,),
            kinds=kinds,
            typical=typical,
        )
        for i, (member, words) in enumerate(members.items())
    )


@dataclass(frozen=True)
class Declared:
    """What one part of a system declares, names with fields in braces. Parts are put together with ``+``.

    Attributes:
        members: field -> member -> its label. Parts that name the same field have the same members.
        roles: member -> how its traces are drawn, where that is not as a component.
        subjects: what has health and is used or not -> label.
        wholes: what only tests look at, and nobody isolates -> label.
        tests: with all their subjects.
    """

    members: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    channels: tuple[Channel, ...] = ()
    subsystems: tuple[Subsystem, ...] = ()
    subjects: Mapping[str, str] = field(default_factory=dict)
    wholes: Mapping[str, str] = field(default_factory=dict)
    signals: tuple[Signals, ...] = ()
    tests: tuple[Test, ...] = ()
    charts: tuple[Chart, ...] = ()
    blocks: tuple[Block, ...] = ()
    wires: tuple[Wire, ...] = ()
    scene: tuple[SceneItem, ...] = ()

    def __add__(self, other: Declared) -> Declared:
        """Both. Raises DeclarationError where they give one field other members."""
        for name in self.members.keys() & other.members.keys():
            if dict(self.members[name]) != dict(other.members[name]):
                raise DeclarationError(f"two parts give {{{name}}} other members")
        both: dict[str, Any] = {}
        for f in fields(self):
            a, b = getattr(self, f.name), getattr(other, f.name)
            both[f.name] = {**a, **b} if isinstance(a, Mapping) else a + b
        return Declared(**both)

    def each(self, pattern: str) -> list[tuple[str, dict[str, str]]]:
        """Every name that a pattern stands for, and the label of each of its members. Raises DeclarationError."""
        return [(pattern.format(**chosen), self._labels(chosen)) for chosen in self._choices(pattern)]

    def names(self, patterns: Iterable[str]) -> tuple[str, ...]:
        """All names that these patterns stand for."""
        return tuple(name for pattern in patterns for name, _ in self.each(pattern))

    def shape(self, pattern: str) -> tuple[int, ...]:
        """How many members each field of a pattern has."""
        return tuple(len(self.members[name]) for name in _FIELD.findall(pattern))

    def all_subjects(self) -> dict[str, str]:
        """Name of every subject -> its label."""
        return self._labelled(self.subjects)

    def _labelled(self, patterns: Mapping[str, str]) -> dict[str, str]:
        return {n: label.format(**labels) for p, label in patterns.items() for n, labels in self.each(p)}

    def all_tests(self) -> tuple[Test, ...]:
        """The tests with every subject named."""
        return tuple(test.model_copy(update={"subjects": self.names(test.subjects)}) for test in self.tests)

    def all_signals(self) -> tuple[Signal, ...]:
        """Every signal, those of the tests included. Raises DeclarationError for a name that is declared twice."""
        found: dict[str, Signal] = {}

        def add(name: str, label: str, unit: str, group: str) -> None:
            if name in found:
                raise DeclarationError(f"{name} is declared twice")
            found[name] = Signal(name=name, label=label, unit=unit, group=group)

        for signal in self.signals:
            for name, labels in self.each(signal.name):
                add(name, signal.label.format(**labels), signal.unit, signal.group)
        subjects = self.all_subjects() | self._labelled(self.wholes)
        for test in self.all_tests():
            for subject in test.subjects:
                for part in OF_TEST:
                    label = f"{test.label}, {subjects.get(subject, subject)}: {part}"
                    unit = test.unit if part in OF_TEST[:2] else "1"
                    add(f"test.{test.name}.{subject}.{part}", label, unit, "test")
        return tuple(found.values())

    def all_scene(self) -> tuple[SceneItem, ...]:
        """Every scene item."""
        return tuple(self._filled(item, chosen) for item in self.scene for chosen in self._choices(item.id))

    def all_charts(self) -> tuple[Chart, ...]:
        """Every chart, with a trace of every member."""
        drawn = []
        for pattern in self.charts:
            for chosen in self._choices(pattern.id):
                chart = self._filled(pattern, chosen)
                traces = tuple(t for p in chart.traces for t in self._traces(p, chosen))
                title = chart.title[:1].upper() + chart.title[1:]
                drawn.append(chart.model_copy(update={"title": title, "traces": traces}))
        return with_probabilities(tuple(drawn), self.all_tests())

    def _traces(self, pattern: Trace, of_chart: Mapping[str, str]) -> Iterable[Trace]:
        """A trace of every member, in its role; of several estimators only the protected one has its band."""
        for chosen in self._choices(pattern.signal):
            trace = self._filled(pattern, chosen)
            roles = [self.roles[m] for m in (*chosen.values(), *of_chart.values()) if m in self.roles]
            if roles and trace.role == "component":
                band = trace.sigma if roles[0] == "protected" else None
                trace = trace.model_copy(update={"role": roles[0], "sigma": band})
            yield trace

    def _choices(self, pattern: str) -> list[dict[str, str]]:
        """Every choice of members for the fields of a pattern: field -> member."""
        names = _FIELD.findall(pattern)
        for name in names:
            if name not in self.members:
                raise DeclarationError(f"{pattern}: nobody declares the members of {{{name}}}")
        return [dict(zip(names, chosen, strict=True)) for chosen in product(*(self.members[n] for n in names))]

    def _labels(self, chosen: Mapping[str, str]) -> dict[str, str]:
        return {name: self.members[name][member] for name, member in chosen.items()}

    def _filled(self, value: T, chosen: Mapping[str, str]) -> T:
        """The value with these members in the place of their fields: by label where a person reads it, or by name."""
        if not chosen:
            return value
        labels = self._labels(chosen)
        update: dict[str, Any] = {}
        for name, old in value:
            words = labels if name in ("label", "title") else chosen
            if isinstance(old, str):
                update[name] = _FIELD.sub(lambda m, words=words: words.get(m[1], m[0]), old)  # type: ignore[misc]
            elif isinstance(old, tuple) and old and isinstance(old[0], Described):
                update[name] = tuple(self._filled(part, chosen) for part in old)
        return value.model_copy(update=update)


def describe(declared: Declared, *, shown: tuple[str, ...] = (), **words: Any) -> SystemDescription:
    """A system's description from what its parts declare.

    Args:
        shown: ids of the charts that are open at first; these come first, in this order.
        words: the other fields of the description.

    Raises:
        DeclarationError: a name is declared twice, or is of fields that nobody declares; a chart is not there.
    """
    charts = {chart.id: chart for chart in declared.all_charts()}
    for id in shown:
        if id not in charts:
            raise DeclarationError(f"chart {id} is to be shown and is not declared")
    first = [charts.pop(id).model_copy(update={"shown": True}) for id in shown]
    return SystemDescription(
        channels=declared.channels,
        subsystems=declared.subsystems,
        tests=declared.all_tests(),
        signals=declared.all_signals(),
        charts=(*first, *charts.values()),
        blocks=declared.blocks,
        wires=declared.wires,
        scene=declared.all_scene(),
        **words,
    )
