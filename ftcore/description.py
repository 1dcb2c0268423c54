"""A system describes itself: these are the words it does it with.

Everything the server and the browser know about a system is an instance of :class:`SystemDescription`. They draw forms,
charts, the block diagram and the 3-D scene from it and hold no knowledge of any single system.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Health = Literal["ok", "suspect", "isolated", "off", "faulted"]
"""``faulted`` is the operator's knowledge (a fault is live there); the others are the navigator's."""


class Described(BaseModel):
    """Base of all descriptions: immutable, no unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Channel(Described):
    """One place where a fault can be laid: a part of a reading group, or (part ``all``) the whole group."""

    name: str = Field(description="<sensor>.<quantity>.<part>")
    label: str
    unit: str = Field(description="unit of a fault's magnitude on this channel, and of the reading shown to a person")
    sensor: str = Field(description="the subsystem or instrument this channel belongs to; a subject of events")
    group: str = Field(description="<sensor>.<quantity>, the reading group")
    parts: tuple[int, ...] = Field(description="columns of the group that a fault here touches")
    kinds: tuple[str, ...] = Field(description="fault kinds that make sense here")
    typical: float = Field(description="a magnitude worth trying first, in the channel's unit")


class Subsystem(Described):
    """Something that can be switched off and on, and that the supervisor may isolate."""

    name: str
    label: str
    isolable: bool = True


class Test(Described):
    """One kind of test and the subjects it looks at."""

    name: str
    label: str
    subjects: tuple[str, ...]
    dof: str = Field(description="what its degrees of freedom are, in words")
    source: str = Field(description="paper and equation, or FTLab")
    may_drive: bool = True
    unit: str = "1"
    alarm_when: Literal["above", "below"] = "above"


class Signal(Described):
    """One recorded number per run and epoch."""

    name: str
    label: str
    unit: str = Field(description="unit shown to a person; the recorded number is SI")
    group: str = Field(description="for choosing: error, sigma, test, parity, weight, navigation, ...")


class Trace(Described):
    """One line of a chart. ``sigma`` names the signal whose 3-fold is drawn as a band around zero."""

    signal: str
    label: str
    role: Literal["protected", "local", "unprotected", "statistic", "threshold", "component", "weight"] = "component"
    sigma: str | None = None


class Chart(Described):
    """One chart: traces that share an axis."""

    id: str
    title: str
    unit: str
    group: str = Field(description="chart family, for the chooser: errors, tests, parity, weights, ...")
    scale: Literal["linear", "log"] = "linear"
    stacked: bool = False
    traces: tuple[Trace, ...]
    shown: bool = Field(default=False, description="shown when the page opens")


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
    ``vector`` (free arrow), ``line-of-sight`` (line with a ball at its end), ``aircraft`` (attitude of the body frame).
    """

    id: str
    label: str
    kind: Literal["axis", "spin", "plane", "vector", "line-of-sight", "aircraft", "path"]
    frame: Literal["body", "level"] = "body"
    family: str = Field(description="legend entry; also the colour family, e.g. 'instrument 1'")
    vector: tuple[float, float, float] | None = Field(default=None, description="fixed direction, if it never changes")
    channel: str | None = Field(default=None, description="channel that a click here would fault")


class SystemDescription(Described):
    """Everything there is to know about a system without running it."""

    id: str
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
