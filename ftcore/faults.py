"""The fault catalogue: a fault is a function of time laid over a channel.

What faults do to the readings of an epoch is in :mod:`ftcore.injection`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from ftcore import units
from ftcore.display import card, line, quantity
from ftcore.identifiers import Id

Array = NDArray[np.float64]

Kind = Literal["bias", "ramp", "sine", "scale-factor", "noise", "stuck", "dropout", "outliers", "random-walk", "delay"]

MAX_DELAY = 10.0
"""Longest delay fault [s]; readings this old are kept."""


LARGEST = {
    "length": 1e7,
    "speed": 1e5,
    "acceleration": 500.0,
    "angle": 10.0,
    "angular rate": 20.0,
    "ratio": 1e3,
    "time": MAX_DELAY,
}
"""Largest magnitude by dimension [SI], as much as an aircraft's instruments say or more; time: of a delay."""
RANGE = {"length": 1e8, "speed": 1e5, "acceleration": 500.0, "angle": 10.0, "angular rate": 20.0}
"""Largest number that an instrument says, by dimension [SI]; outside of its range it gives no reading."""


@dataclass(frozen=True)
class KindInfo:
    """What a fault kind means to a person: the form is drawn from it.

    Attributes:
        base: unit of the magnitude: ``"channel"`` for the channel's own, a unit symbol, or None for no magnitude.
        per: suffix to the unit, for instance ``"/s"``.
        parameters: further fields of :class:`Fault` that this kind uses.
    """

    label: str
    sentence: str
    base: str | None
    per: str = ""
    parameters: tuple[str, ...] = ()

    def uses(self, name: str) -> bool:
        """Whether a field of :class:`Fault` means anything to this kind."""
        if name in ("magnitude", "unit"):
            return self.base is not None
        return name not in OPTIONAL or name in self.parameters

    def base_unit(self, channel_unit: str) -> str | None:
        """Unit symbol known to :mod:`ftcore.units`, without the suffix."""
        return channel_unit if self.base == "channel" else self.base

    def unit(self, channel_unit: str) -> str | None:
        """Unit of the magnitude as a person reads it; None where there is no magnitude."""
        base = self.base_unit(channel_unit)
        return None if base is None else base + self.per


OPTIONAL = ("angular_frequency", "rate")
"""Fields of a fault that only some kinds use, besides the magnitude and its unit."""

KINDS: dict[Kind, KindInfo] = {
    "bias": KindInfo("bias", "a constant is added", "channel"),
    "ramp": KindInfo("ramp", "a drift that grows by the magnitude every second", "channel", "/s"),
    "sine": KindInfo(
        "sine", "magnitude x sin(angular frequency x time since onset) is added", "channel", "", ("angular_frequency",)
    ),
    "scale-factor": KindInfo("scale factor", "the reading is multiplied by 1 + magnitude", "1"),
    "noise": KindInfo("noise increase", "white noise of this 1-sigma is added to every sample", "channel"),
    "stuck": KindInfo("stuck", "the last good value is held", None),
    "dropout": KindInfo("dropout", "there is no reading", None),
    "outliers": KindInfo("outliers", "spikes of this size and random sign", "channel", "", ("rate",)),
    "random-walk": KindInfo(
        "random-walk drift", "a drift that wanders by this 1-sigma in a second", "channel", "/sqrt(s)"
    ),
    "delay": KindInfo("delay", "the reading comes this late", "s"),
}

ADDITIVE: tuple[Kind, ...] = ("bias", "ramp", "sine", "noise", "outliers", "random-walk")
ALL_KINDS: tuple[Kind, ...] = tuple(KINDS)


def unused(kind: Kind, name: str) -> str:
    """What to say of a field that a kind has no use for."""
    if name == "unit":
        return f"a {kind} fault has no magnitude, so it takes no unit; leave it out"
    more = [field for field in ("magnitude", *OPTIONAL) if KINDS[kind].uses(field)]
    return f"a {kind} fault has no {name}; leave it out" + (f": it takes {', '.join(more)}" if more else "")


class FaultError(ValueError):
    """A fault that cannot be laid on its channel; ``field`` says which part of it is wrong."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


ANGULAR_FREQUENCY = 0.05
"""Of a sine, by default [rad/s]."""
RATE = 0.1
"""Of outliers, by default: probability of a spike in each sample."""


def _none(value: float | str | None) -> bool:
    """Whether a document need not say it: no magnitude, no unit of its own."""
    return not value


class Fault(BaseModel):
    """One fault: what, where, how large, from when to when.

    ``magnitude`` is in ``unit``, by default the channel's; what that means for each kind is in :data:`KINDS`. Documents
    leave out what is as by default, and so whatever a kind has no use for.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    id: Id | None = Field(default=None, description="given by the simulation if absent")
    channel: str = Field(description="<sensor>.<quantity>.<part>", max_length=80)
    kind: Kind
    magnitude: float = Field(
        default=0.0, ge=-1e9, le=1e9, exclude_if=_none, description="in the unit of the kind and channel"
    )
    unit: str | None = Field(
        default=None, max_length=20, exclude_if=_none, description="unit of magnitude; the channel's if absent"
    )
    start: float | None = Field(
        default=None, ge=0.0, le=1e7, description="onset; now if absent", json_schema_extra={"unit": "s"}
    )
    end: float | None = Field(
        default=None, ge=0.0, le=1e7, description="never if absent", json_schema_extra={"unit": "s"}
    )
    angular_frequency: float = Field(
        default=ANGULAR_FREQUENCY,
        gt=0.0,
        le=1e3,
        exclude_if=lambda value: value == ANGULAR_FREQUENCY,
        description="of a sine",
        json_schema_extra={"unit": "rad/s"},
    )
    rate: float = Field(
        default=RATE,
        gt=0.0,
        le=1.0,
        exclude_if=lambda value: value == RATE,
        description="probability of a spike in each sample",
        json_schema_extra={"unit": "1"},
    )

    @model_validator(mode="after")
    def _ends_after_it_starts(self) -> Fault:
        if self.end is not None and self.end <= (self.start or 0.0):
            raise ValueError(f"end is {self.end} s, which is not after the start at {self.start or 0.0} s")
        return self

    defaults_say_nothing: ClassVar[bool] = True
    """Whether a field that its kind has no use for may be given as it is by default; older documents have them all."""

    @model_validator(mode="after")
    def _has_no_field_that_its_kind_ignores(self) -> Fault:
        for name in self.ignored:
            value = getattr(self, name)
            if not self.defaults_say_nothing or value != type(self).model_fields[name].default:
                why = {"error": ValueError(unused(self.kind, name))}
                raise ValidationError.from_exception_data(
                    type(self).__name__, [{"type": "value_error", "loc": (name,), "input": value, "ctx": why}]
                )
        return self

    @property
    def ignored(self) -> list[str]:
        """Fields that were given, though this kind has no use for them."""
        return [name for name in type(self).model_fields if name in self.model_fields_set and not self.uses(name)]

    def uses(self, name: str) -> bool:
        """Whether a field means anything to this fault's kind."""
        return KINDS[self.kind].uses(name)

    def words(self, unit: str | None = None) -> str:
        """Kind, magnitude, start and end in words.

        Args:
            unit: of the magnitude, where the fault itself leaves it to its channel.

        >>> Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=100, start=50).words("m")
        'bias 100 m from 50 s'
        """
        parts = [KINDS[self.kind].label]
        if self.uses("magnitude"):
            parts.append(quantity(self.magnitude, self.unit or unit or "(unit of the channel)"))
        parts.append("from now" if self.start is None else f"from {self.start:g} s")
        parts += [f"to {self.end:g} s"] if self.end is not None else []
        for name, value, symbol in (("angular_frequency", self.angular_frequency, "rad/s"), ("rate", self.rate, "")):
            parts += [f"at {quantity(value, symbol)}"] if self.uses(name) else []
        return " ".join(parts)

    def __repr__(self) -> str:
        """Id, channel and what is wrong, in one line."""
        return f"<Fault {self.id or 'without an id yet'}: {self.channel} {self.words()}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        return card(f"Fault {self.id or ''}".rstrip(), self.channel, line(self.words()))

    def active(self, time: float) -> bool:
        """Whether the fault is live at ``time`` [s]."""
        assert self.start is not None
        return self.start <= time and (self.end is None or time < self.end)


@dataclass(frozen=True)
class ChannelAddress:
    """Where a channel lives in the readings: group, columns, unit and what it takes."""

    name: str
    group: str
    parts: tuple[int, ...]
    unit: str
    kinds: tuple[str, ...]
    sensor: str


def check(fault: Fault, channels: Mapping[str, ChannelAddress]) -> None:
    """Refuse a fault that its channel cannot take.

    Raises:
        FaultError: unknown channel, kind that makes no sense there, incompatible unit, missing or excessive magnitude.
    """
    channel = channels.get(fault.channel)
    if channel is None:
        prefix = fault.channel.rsplit(".", 1)[0]
        near = [name for name in channels if name.startswith(prefix)] or list(channels)
        raise FaultError("channel", f"no channel {fault.channel!r}; for instance {', '.join(near[:8])}")
    if fault.kind not in channel.kinds:
        raise FaultError("kind", f"{fault.channel} does not take {fault.kind!r}; it takes {', '.join(channel.kinds)}")
    info = KINDS[fault.kind]
    base = info.base_unit(channel.unit)
    if fault.unit is not None:
        fitting = [unit + info.per for unit in units.compatible(str(base))]
        if fault.unit not in fitting:
            raise FaultError("unit", f"unit {fault.unit!r} does not fit here; one of {', '.join(fitting)} would")
    if base is not None and fault.magnitude == 0.0:
        raise FaultError("magnitude", f"a {fault.kind} fault of magnitude 0 changes nothing; give its size")
    if fault.kind in ("noise", "random-walk", "delay") and fault.magnitude < 0.0:
        raise FaultError("magnitude", f"a {fault.kind} fault needs a positive magnitude, not {fault.magnitude:g}")
    most = largest(fault.kind, channel.unit, fault.unit)
    if most is not None and abs(fault.magnitude) > most * (1.0 + 1e-9):
        unit = fault.unit or info.unit(channel.unit)
        what = "delay" if fault.kind == "delay" else f"{fault.kind} here"
        unit = "" if unit in (None, "1") else f" {unit}"
        raise FaultError("magnitude", f"a {what} may be at most {most:.6g}{unit}, not {fault.magnitude:.9g}{unit}")


def largest(kind: Kind, channel_unit: str, unit: str | None = None) -> float | None:
    """Largest magnitude of a kind on a channel, in ``unit`` or in the channel's; None where there is no magnitude."""
    info = KINDS[kind]
    base = info.base_unit(channel_unit)
    if base is None:
        return None
    return units.from_si(LARGEST[units.dimension(base)], base if unit is None else unit.removesuffix(info.per))


def in_range(values: Array, channel_unit: str) -> NDArray[np.bool_]:
    """Which numbers [SI] an instrument can say at all; see :data:`RANGE`."""
    within: NDArray[np.bool_] = np.abs(values) <= RANGE.get(units.dimension(channel_unit), np.inf)
    return within


def si_magnitude(fault: Fault, channel_unit: str) -> float:
    """The fault's magnitude in SI (per second, per square root of a second where the kind says so)."""
    info = KINDS[fault.kind]
    base = info.base_unit(channel_unit)
    if base is None:
        return 0.0
    return units.to_si(fault.magnitude, base if fault.unit is None else fault.unit.removesuffix(info.per))


PAUSE = 2.0
"""Seconds without effect beyond which a pause of a fault is remembered; a sine's zeros are shorter."""


@dataclass(frozen=True)
class Acted:
    """In which epochs a fault changed what the navigator was given, a bit at least; a value.

    Attributes:
        first, last: ``(runs,)`` time of the first and of the last such epoch [s]; NaN where there was none.
        epochs: ``(runs,)`` how many there were.
        now: ``(runs,)`` whether the last epoch flown was one.
        pauses: when it did not act for longer than :data:`PAUSE` in between: last epoch before and first one after,
            ``(runs,)`` each, NaN in runs without that pause.
    """

    first: Array
    last: Array
    epochs: NDArray[np.int64]
    now: NDArray[np.bool_]
    pauses: tuple[tuple[Array, Array], ...] = ()

    @classmethod
    def never(cls, runs: int) -> Acted:
        """Of a fault that has changed nothing so far."""
        nowhere = np.full(runs, np.nan)
        return cls(nowhere, nowhere, np.zeros(runs, np.int64), np.zeros(runs, bool))

    def after(self, time: float, now: NDArray[np.bool_]) -> Acted:
        """The same one epoch later, at ``time`` [s], in which the fault acted in the runs of ``now (runs,)``."""
        resumed = now & (time - self.last > PAUSE)
        pauses = self.pauses
        if resumed.any():
            pauses = (*pauses, (np.where(resumed, self.last, np.nan), np.where(resumed, time, np.nan)))
        return Acted(
            np.where(now & (self.epochs == 0), time, self.first),
            np.where(now, time, self.last),
            self.epochs + now,
            now,
            pauses,
        )


def form_schema(kinds: Iterable[str], channel_unit: str) -> dict[str, Any]:
    """What the fault form needs for one channel: per kind its label, sentence, unit and further fields."""
    schema: dict[str, Any] = {}
    for kind in kinds:
        info = KINDS[kind]  # type: ignore[index]
        schema[kind] = {
            "label": info.label,
            "sentence": info.sentence,
            "unit": info.unit(channel_unit),
            "largest": largest(kind, channel_unit),  # type: ignore[arg-type]
            "parameters": list(info.parameters),
        }
    return schema
