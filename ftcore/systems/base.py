"""What a system is made of, and the values that pass between its parts.

A system is a *plant* (world and sensors: knows truth), a *navigator* (estimation and detection: sees readings only) and
a *reporter* (turns both into recorded numbers, where truth is used to score). They are pure: a step takes a state and
returns a new one. The simulation knows systems only through the protocols of this module.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from ftcore.description import Indicator, SystemDescription, View
from ftcore.faults import ChannelAddress
from ftcore.noise import NoiseSource
from ftcore.parts.ledger import Ledger
from ftcore.readings import Readings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

HEALTH = ("ok", "suspect", "isolated", "off")
"""Codes 0 to 3 of :attr:`Output.health`."""


class Form(BaseModel):
    """Base of every system's parameters and settings: immutable, strict about fields and numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def strictly(cls, values: Mapping[str, Any]) -> Self:
        """The form from JSON-like values, without guessing: a number is no text. Raises pydantic's ValidationError."""
        return cls.model_validate_json(json.dumps(dict(values)), strict=True)

    @property
    def longest(self) -> float:
        """Longest flight on these parameters [s]."""
        return 36000.0

    def without_effect(self, parameters: Any, settled: bool = True) -> Mapping[str, str]:
        """Settings of this form that change nothing with these parameters and the other settings, and why.

        Nothing means no reading, no statistic, no estimate and no event, whatever happens. The reason names what would
        bring the setting to bear. A setting whose statistic is shown while another one drives is not among them.

        Args:
            parameters: of the flight.
            settled: nobody is suspected or isolated. One that is may come back by settings that put nobody out.
        """
        return {}

    def refuse(self, where: tuple[str | int, ...], why: str) -> NoReturn:
        """Raise pydantic's ValidationError at a place below this form."""
        raise invalid(type(self).__name__, where, why)

    def differing(self, names: tuple[str, ...]) -> list[str]:
        """Which of these fields have another value than by default."""
        return [name for name in names if getattr(self, name) != type(self).model_fields[name].get_default()]


def no_effect(name: str, why: str) -> str:
    """The sentence that refuses a setting of :meth:`Form.without_effect`."""
    return f"{name} changes nothing here: {why}"


def invalid(title: str, where: tuple[str | int, ...], why: str) -> ValidationError:
    """Pydantic's error of one finding, at a place below what is validated."""
    found: Any = {"type": "value_error", "loc": where, "input": None, "ctx": {"error": ValueError(why)}}
    return ValidationError.from_exception_data(title, [found])


@dataclass(frozen=True)
class Controls:
    """What the operator has set: which subsystems are switched on, and the system's settings."""

    enabled: Mapping[str, bool]
    settings: Any


@dataclass(frozen=True)
class Notice:
    """Something worth an event that cannot be read off alarms and health: in which runs, and the numbers behind it."""

    kind: str
    subject: str
    where: Flags
    numbers: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Remark:
    """Something a person has to know of what flies before it does: one sentence, and the numbers in it.

    ``kind`` is one of :data:`ftcore.events.KINDS`; it becomes an event at t = 0.
    """

    kind: str
    subject: str
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LeftOut:
    """Readings that there are but that a navigator does not look at: ``where (runs or 1, parts)``, and why."""

    where: Flags
    because: str


@dataclass(frozen=True)
class Output:
    """What a navigator says at one epoch.

    Attributes:
        statistic, threshold, dof, alarm: ``(runs, tests)``, in the order of :attr:`Assembly.tests`.
        health: ``(runs, subjects)`` codes of :data:`HEALTH`, in the order of :attr:`Assembly.subjects`.
        used: ``(runs, subjects)``, whether the master uses the subject in this epoch.
        notices: further events.
        detail: what the reporter needs; a value of the system's own type.
        command: what the plant is told for the next epoch; None where nothing is flown.
        left_out: reading group -> what of it was not looked at, neither by a filter nor by a test.
        said: all of it by name, where the system writes a ledger.
    """

    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags
    health: NDArray[np.int8]
    used: Flags
    notices: Sequence[Notice]
    detail: Any
    command: Any = None
    left_out: Mapping[str, LeftOut] = field(default_factory=dict)
    said: Ledger | None = None


Visible = Callable[[str, float, float], bool]
"""Whether a channel may have a reading at some time from one moment to another [s]: (channel, from, to)."""


class Plant(Protocol):
    """World and sensors."""

    def initial(self) -> Any:
        """State before the first epoch."""

    def step(self, state: Any, epoch: int, command: Any) -> tuple[Any, Any, Readings]:
        """One epoch: new state, truth, clean readings."""


class Navigator(Protocol):
    """Estimation and detection."""

    def initial(self, controls: Controls) -> Any:
        """State before the first epoch."""

    def step(self, state: Any, readings: Readings, controls: Controls) -> tuple[Any, Output]:
        """One epoch: new state and what it says."""


class Reporter(Protocol):
    """Truth and output to numbers and pictures."""

    def row(self, truth: Any, output: Output) -> Array:
        """``(runs, signals)`` in the order of the description's signals, SI."""

    def view(self, time: float, truth: Any, output: Output | None, controls: Controls, faulted: frozenset[str]) -> View:
        """Diagram and scene of run 0; ``faulted`` holds the names of channels with a live fault."""


@dataclass(frozen=True)
class Assembly:
    """A system put together for one experiment.

    Attributes:
        tests: (name, subject) of every test column.
        subjects: names behind the health columns.
        period: seconds between epochs where the experiment decides it (a receiver's log); the description's if None.
        epochs: how many there are where the world ends (a log); no end if None.
        absent: channels of the description that this experiment has not, and why, in words that say what would bring
            them.
        visible: where it is known for times to come. False only where there will be no reading for certain; None: it is
            not known, or every channel always has one.
        foresees: whether the first epoch can be looked at before it is flown; not where a step is more than arithmetic.
        remarks: what a person has to know before it flies.
    """

    plant: Plant
    navigator: Navigator
    reporter: Reporter
    tests: tuple[tuple[str, str], ...]
    subjects: tuple[str, ...]
    period: float | None = None
    epochs: int | None = None
    absent: Mapping[str, str] = field(default_factory=dict)
    visible: Visible | None = None
    foresees: bool = True
    remarks: Sequence[Remark] = ()


class System(Protocol):
    """One of FTLab's systems, before it is put together."""

    @property
    def description(self) -> SystemDescription:
        """What it says of itself."""

    @property
    def Parameters(self) -> type[Form]:
        """What is fixed at the start."""

    @property
    def Settings(self) -> type[Form]:
        """What can be changed in flight."""

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds."""


@runtime_checkable
class Indicated(Protocol):
    """What a system may do besides: say figures that follow from its parameters and settings before anything flies."""

    def indicators(self, parameters: Any, settings: Any) -> tuple[Indicator, ...]:
        """The figures, in the order to be shown; quick enough to be asked at every change of a field."""


NOISE_FLOOR: Final = (0.01, 1.0, 100.0)
"""Least, usual and largest noise floor that is assumed of a receiver's log: pseudorange 1-sigma [m]."""


@runtime_checkable
class FliesLogs(Protocol):
    """What a system may do besides: fly what a real receiver has recorded."""

    def log_scenario(
        self,
        observation: str,
        navigation: str,
        antenna: tuple[float, float, float] | None,
        max_epochs: int,
        noise_floor: float | None,
    ) -> dict[str, Any]:
        """Scenario document for a pair of RINEX files; a ValueError of one sentence where they cannot be used."""


def addresses(description: SystemDescription) -> dict[str, ChannelAddress]:
    """Channel name -> where it lives in the readings."""
    return {c.name: ChannelAddress(c.name, c.group, c.parts, c.unit, c.kinds, c.sensor) for c in description.channels}
