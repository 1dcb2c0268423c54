"""A system describes itself: these are the words it does it with.

Everything the server and the browser know about a system is an instance of :class:`SystemDescription`. They draw forms,
charts, the block diagram and the 3-D scene from it and hold no knowledge of any single system.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ftcore.identifiers import Id, Name

Health = Literal["ok", "suspect", "isolated", "off", "faulted"]
"""``faulted`` is the operator's knowledge (a fault is live there); the others are the navigator's."""
Corner = Literal["zero", "limit", "end"]
"""A coordinate of a region's corner: 0, the chart's limit, or where the axis ends."""


class Described(BaseModel):
    """Base of all descriptions: immutable, no unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Channel(Described):
    """One place where a fault can be laid: a part of a reading group, or (part ``all``) the whole group."""

    name: Name = Field(description="<sensor>.<quantity>.<part>")
    label: str
    unit: str = Field(description="unit of a fault's magnitude on this channel, and of the reading shown to a person")
    sensor: str = Field(description="the subsystem or instrument this channel belongs to; a subject of events")
    group: str = Field(description="<sensor>.<quantity>, the reading group")
    parts: tuple[int, ...] = Field(description="columns of the group that a fault here touches")
    kinds: tuple[str, ...] = Field(description="fault kinds that make sense here")
    typical: float = Field(description="a magnitude worth trying first, in the channel's unit")


class Subsystem(Described):
    """Something that can be switched off and on, and that the supervisor may isolate."""

    name: Name
    label: str
    isolable: bool = True


Probability = Literal["exact", "bounded", "approximate"]
"""What a test's false-alarm probability is: the stated one, no more than it, or near it as far as a model holds."""


class Test(Described):
    """One kind of test and the subjects it looks at."""

    name: Name
    label: str
    subjects: tuple[str, ...]
    dof: str = Field(description="what its degrees of freedom are, in words")
    source: str = Field(description="paper and equation, or FTLab")
    may_drive: bool = True
    unit: str = "1"
    alarm_when: Literal["above", "below"] = "above"
    probability: Probability = Field(description="what its false-alarm probability is, for a subject as a whole")
    probability_note: str = Field(default="", description="how far it is off, and why; docs/probabilities.md measures")
    baseline: bool = Field(
        default=False,
        description="of an estimator shown for comparison only: what it notices is not found by the system",
    )
    reference: tuple[str, ...] = Field(
        default=(),
        description="sensors that the subject is tested against: a fault of theirs enters the statistic, so that an "
        "alarm is no false one, yet nothing is wrong with the subject",
    )

    @model_validator(mode="after")
    def _says_how_far(self) -> Self:
        if self.probability == "approximate" and not self.probability_note:
            raise ValueError(f"test {self.name}: an approximate probability says how far it is off")
        return self

    def whole_of(self, subject: str) -> str | None:
        """The subject of this test that another one is a part of (a gyro of all gyros); None for a whole."""
        wholes = (s for s in self.subjects if subject.startswith(s + "."))
        return next(wholes, None)

    def probability_of(self, subject: str) -> Probability:
        """What the false-alarm probability of one subject is. A part alarms only where the whole does: bounded."""
        if self.whole_of(subject) is not None and self.probability == "exact":
            return "bounded"
        return self.probability


class Signal(Described):
    """One recorded number per run and epoch."""

    name: Name
    label: str
    unit: str = Field(description="unit shown to a person; the recorded number is SI")
    group: str = Field(description="for choosing: error, sigma, test, parity, weight, navigation, ...")


class Trace(Described):
    """One line of a chart; in an ``xy`` chart a cloud of points, in ``sky`` and ``bars`` one marker or bar.

    ``sigma`` names the signal whose 3-fold is drawn as a band around zero.
    """

    signal: str
    label: str
    role: Literal["protected", "local", "unprotected", "statistic", "threshold", "component", "weight"] = "component"
    sigma: str | None = None
    across: str | None = Field(default=None, description="xy: signal along x; sky: azimuth, `signal` is the elevation")
    code: str | None = Field(default=None, description="xy: signal with the number of the region each point counts for")
    item: str | None = Field(
        default=None,
        description="scene item this is a picture of: its health marks the trace, its channel is what a click selects",
    )


class Region(Described):
    """A part of an ``xy`` chart: a polygon whose corners are told by zero, the chart's limit, and the axes' end."""

    label: str
    meaning: str = Field(default="", description="what it is to be there, in a few words")
    health: Health = Field(description="how it is shaded")
    corners: tuple[tuple[Corner, Corner], ...] = Field(min_length=3, description="(x, y) of each")


class Chart(Described):
    """One chart.

    ``kind``: ``time`` (lines over the common time axis), ``xy`` (a signal over another, one point an epoch), ``sky``
    (polar: azimuth and elevation), ``bars`` (a bar a trace; a trace in the role of a threshold is a line at plus and
    minus its value). All but ``time`` show the moment of the cursor, ``xy`` with all epochs before it.
    """

    id: str
    title: str
    unit: str
    group: str = Field(description="chart family, for the chooser: errors, tests, parity, weights, ...")
    kind: Literal["time", "xy", "sky", "bars"] = "time"
    scale: Literal["linear", "log"] = "linear"
    stacked: bool = Field(default=False, description="time: areas on top of each other, for shares that sum to one")
    levels: tuple[str, ...] = Field(default=(), description="time: the values are the numbers of these words")
    across: str = Field(default="", description="xy: what is along x, in the chart's unit")
    upward: str = Field(default="", description="xy: what is along y, in the chart's unit")
    limit: str | None = Field(default=None, description="xy: signal at whose value a line crosses either axis")
    regions: tuple[Region, ...] = Field(default=(), description="xy: regions, in the order of the traces' codes")
    traces: tuple[Trace, ...]
    shown: bool = Field(default=False, description="shown when the page opens")

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Self:
        lines = [trace for trace in self.traces if trace.role != "threshold"]
        if self.kind in ("xy", "sky") and not all(trace.across for trace in lines):
            raise ValueError(f"chart {self.id}: every trace of kind {self.kind} needs `across`")
        if self.kind != "time" and (self.stacked or self.levels or self.scale == "log"):
            raise ValueError(f"chart {self.id}: stacked, levels and a logarithmic scale are for charts over time")
        if self.kind != "xy" and (self.regions or self.limit):
            raise ValueError(f"chart {self.id}: regions and their limit are for kind xy")
        if self.regions and not self.limit:
            raise ValueError(f"chart {self.id}: regions need a limit")
        return self

    def signals(self) -> tuple[str, ...]:
        """Names of all signals that are needed to draw it, each once."""
        named = [n for t in self.traces for n in (t.signal, t.sigma, t.across, t.code) if n is not None]
        return tuple(dict.fromkeys([*named, *([self.limit] if self.limit else [])]))


class Block(Described):
    """One block of the diagram, placed on a grid of 100 x 68 units.

    ``channels`` and ``subsystem`` say what a click on it can do; ``settings`` names settings it offers.
    """

    id: str
    label: str
    kind: Literal["sensor", "filter", "test", "supervisor", "master", "computer"]
    x: float
    y: float
    width: float = 26.0
    height: float = 12.0
    sensor: str | None = Field(default=None, description="channels whose name starts with this can be faulted here")
    subsystem: str | None = Field(default=None, description="can be switched here")
    settings: tuple[str, ...] = ()


class Wire(Described):
    """A connection between two blocks. ``carries`` names the subsystem whose exclusion opens it."""

    source: str
    target: str
    carries: str | None = None


class SceneItem(Described):
    """One thing in the 3-D scene; its state (vector, health) comes with each epoch's :class:`View`.

    ``kind``: ``axis`` (arrow from the origin), ``spin`` (thin arrow), ``plane`` (square patch by its normal),
    ``vector`` (free arrow), ``line-of-sight`` (line with a ball at its end), ``aircraft`` (attitude of the body frame),
    ``path`` (way of a point), ``ball`` (see-through, as large as its vector is long).

    ``frame``: ``body`` turns with the aircraft, ``level`` stands on the ground, ``own`` is a space of its own such as
    parity space. Items of different spaces belong into different pictures, of which one is shown at a time.
    """

    id: str
    label: str
    kind: Literal["axis", "spin", "plane", "vector", "line-of-sight", "aircraft", "path", "ball"]
    frame: Literal["body", "level", "own"] = "body"
    picture: str = Field(default="", max_length=40, description="the picture it is in, as a person is offered it")
    family: str = Field(description="legend entry; also the colour family, e.g. 'instrument 1'")
    vector: tuple[float, float, float] | None = Field(default=None, description="fixed direction, if it never changes")
    channel: str | None = Field(default=None, description="channel that a click here would fault")
    subject: str | None = Field(default=None, description="whose health colours it")
    trail: tuple[str, str, str] | None = Field(
        default=None, description="path: signals of the point's coordinates, so that the whole way is known"
    )
    unit_length: float = Field(
        default=1.0, gt=0.0, description="path: how much of the trail's signals is one unit [SI]"
    )


class Band(Described):
    """A part of an indicator's map, and what is so there."""

    start: float
    end: float
    label: str


class IndicatorMap(Described):
    """Where along a line something is so: drawn as a strip from ``low`` to ``high`` with bands, all in ``unit``."""

    label: str = Field(description="what the line runs along")
    unit: str
    low: float
    high: float
    bands: tuple[Band, ...] = Field(description="in rising order; they may overlap, and there may be none")


class Indicator(Described):
    """A figure that follows from a system's parameters and settings before anything flies."""

    id: str
    label: str
    value: float | None = Field(description="in `unit`, as a person is shown it; null where there is none")
    unit: str = Field(description="unit of value and ideal; 1: none")
    ideal: float | None = Field(default=None, description="the best value that can be, where there is one")
    better: Literal["higher", "lower"] | None = Field(default=None, description="which way is better, if either")
    field: str | None = Field(default=None, description="dotted path of the parameter it follows from first of all")
    note: str = Field(default="", description="one sentence: what it says, and where it comes from")
    map: IndicatorMap | None = None


class SystemDescription(Described):
    """Everything there is to know about a system without running it."""

    id: Id
    title: str
    summary: str
    source: str = Field(description="the paper it comes from")
    epoch: float = Field(description="seconds between epochs", json_schema_extra={"unit": "s"})
    channels: tuple[Channel, ...]
    subsystems: tuple[Subsystem, ...]
    estimators: dict[str, str] = Field(description="name -> label")
    tests: tuple[Test, ...]
    signals: tuple[Signal, ...]
    charts: tuple[Chart, ...]
    blocks: tuple[Block, ...]
    wires: tuple[Wire, ...]
    scene: tuple[SceneItem, ...]
    settings_schema: dict[str, Any] = Field(description="JSON Schema of what can be changed while it flies")
    parameters_schema: dict[str, Any] = Field(description="JSON Schema of what is fixed when it starts")
    score_headline: tuple[str, ...] = Field(
        default=(), description="signals whose worst absolute value the score strip shows: protected, then unprotected"
    )
    score_label: str = Field(default="Worst error", description="what the score strip calls it")
    recovery: float = Field(
        default=30.0,
        ge=0.0,
        description="how long after a fault's end, or its culprit's re-admission, its traces may be in the filters: so "
        "long alarms and isolations that it explains are not counted as false",
        json_schema_extra={"unit": "s"},
    )


def with_probabilities(charts: tuple[Chart, ...], tests: tuple[Test, ...]) -> tuple[Chart, ...]:
    """The charts, with what each test's probability is in the label of its threshold."""
    kinds = {f"test.{t.name}.{s}.threshold": t.probability_of(s) for t in tests for s in t.subjects}

    def labelled(trace: Trace) -> Trace:
        kind = kinds.get(trace.signal)
        return trace if kind is None else trace.model_copy(update={"label": f"{trace.label} ({kind})"})

    return tuple(c.model_copy(update={"traces": tuple(labelled(t) for t in c.traces)}) for c in charts)


def drawable(charts: Iterable[Chart], recorded: Container[str]) -> tuple[Chart, ...]:
    """What can be drawn of the charts from the signals that are recorded: a chart without any line is left out."""
    found = []
    for chart in charts:
        kept = [
            trace.model_copy(update={"sigma": trace.sigma if trace.sigma in recorded else None})
            for trace in chart.traces
            if all(name in recorded for name in (trace.signal, trace.across, trace.code) if name is not None)
        ]
        if chart.limit is not None and chart.limit not in recorded:
            continue
        if any(trace.role != "threshold" for trace in kept):
            found.append(chart.model_copy(update={"traces": tuple(kept)}))
    return tuple(found)


class BlockView(Described):
    """State of one block at one epoch."""

    health: Health
    text: str


class ItemView(Described):
    """State of one scene item at one epoch: where it points (length in scene units) and how it fares."""

    vector: tuple[float, float, float] | None = None
    rotation: tuple[float, float, float, float] | None = Field(
        default=None, description="quaternion w, x, y, z: body to level"
    )
    health: Health = "ok"
    visible: bool = True


class View(Described):
    """What the diagram and the scene show at one epoch (of run 0)."""

    time: float
    blocks: dict[str, BlockView]
    items: dict[str, ItemView]
