"""The fault catalogue: a fault is a function of time laid over a channel.

Faults add up and can each be cleared. For one channel with several live faults the reading becomes

    dropout( stuck( (1 + scale) * delayed(reading) + bias + ramp + sine + noise + outliers + random walk ) )

``reading`` is always the clean sensor's, so clearing a fault restores it exactly. Whatever is random in a fault is
addressed by the fault's id (see :mod:`ftcore.noise`), so no other channel's noise moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ftcore import units
from ftcore.identifiers import Id
from ftcore.noise import NoiseSource
from ftcore.readings import Group, Readings

Array = NDArray[np.float64]

Kind = Literal["bias", "ramp", "sine", "scale-factor", "noise", "stuck", "dropout", "outliers", "random-walk", "delay"]

MAX_DELAY = 10.0
"""Longest delay fault [s]; readings this old are kept."""


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

    def base_unit(self, channel_unit: str) -> str | None:
        """Unit symbol known to :mod:`ftcore.units`, without the suffix."""
        return channel_unit if self.base == "channel" else self.base

    def unit(self, channel_unit: str) -> str | None:
        """Unit of the magnitude as a person reads it; None where there is no magnitude."""
        base = self.base_unit(channel_unit)
        return None if base is None else base + self.per


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


class FaultError(ValueError):
    """A fault that cannot be laid on its channel; ``field`` says which part of it is wrong."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


class Fault(BaseModel):
    """One fault: what, where, how large, from when to when.

    ``magnitude`` is in ``unit``, by default the channel's; what that means for each kind is in :data:`KINDS`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    id: Id | None = Field(default=None, description="given by the simulation if absent")
    channel: str = Field(description="<sensor>.<quantity>.<part>", max_length=80)
    kind: Kind
    magnitude: float = Field(default=0.0, ge=-1e9, le=1e9, description="in the unit of the kind and channel")
    unit: str | None = Field(default=None, max_length=20, description="unit of magnitude; the channel's if absent")
    start: float | None = Field(
        default=None, ge=0.0, le=1e7, description="onset; now if absent", json_schema_extra={"unit": "s"}
    )
    end: float | None = Field(
        default=None, ge=0.0, le=1e7, description="never if absent", json_schema_extra={"unit": "s"}
    )
    angular_frequency: float = Field(
        default=0.05, gt=0.0, le=1e3, description="of a sine", json_schema_extra={"unit": "rad/s"}
    )
    rate: float = Field(
        default=0.1,
        gt=0.0,
        le=1.0,
        description="probability of a spike in each sample",
        json_schema_extra={"unit": "1"},
    )

    @model_validator(mode="after")
    def _ends_after_it_starts(self) -> Fault:
        if self.end is not None and self.end <= (self.start or 0.0):
            raise ValueError(f"end is {self.end} s, which is not after the start at {self.start or 0.0} s")
        return self

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
        if base is None:
            raise FaultError("unit", f"a {fault.kind} fault has no magnitude, so it takes no unit")
        fitting = [unit + info.per for unit in units.compatible(base)]
        if fault.unit not in fitting:
            raise FaultError("unit", f"unit {fault.unit!r} does not fit here; one of {', '.join(fitting)} would")
    if base is not None and fault.magnitude == 0.0:
        raise FaultError("magnitude", f"a {fault.kind} fault of magnitude 0 changes nothing; give its size")
    if fault.kind in ("noise", "random-walk", "delay") and fault.magnitude < 0.0:
        raise FaultError("magnitude", f"a {fault.kind} fault needs a positive magnitude, not {fault.magnitude:g}")
    if fault.kind == "delay" and si_magnitude(fault, channel.unit) > MAX_DELAY:
        raise FaultError(
            "magnitude", f"a delay may be at most {MAX_DELAY:g} s, not {fault.magnitude:g} {fault.unit or 's'}"
        )


def si_magnitude(fault: Fault, channel_unit: str) -> float:
    """The fault's magnitude in SI (per second, per square root of a second where the kind says so)."""
    info = KINDS[fault.kind]
    base = info.base_unit(channel_unit)
    if base is None:
        return 0.0
    return units.to_si(fault.magnitude, base if fault.unit is None else fault.unit.removesuffix(info.per))


@dataclass(frozen=True)
class FaultMemory:
    """What faults remember between epochs; a value like every other state.

    Attributes:
        history: clean readings of the last :data:`MAX_DELAY` seconds, oldest first.
        held: fault id -> reading that a stuck channel holds, ``(runs, parts)``.
        wandered: fault id -> random-walk drift so far, ``(runs, 1)``.
    """

    history: tuple[Readings, ...] = ()
    held: Mapping[str, Array] | None = None
    wandered: Mapping[str, Array] | None = None


def apply(
    faults: Sequence[Fault],
    channels: Mapping[str, ChannelAddress],
    memory: FaultMemory,
    clean: Readings,
    noise: NoiseSource,
    epoch: int,
    period: float,
) -> tuple[FaultMemory, Readings]:
    """Lay the faults over one epoch of clean readings.

    Args:
        faults: all that are known, live or not; each with id and start.
        channels: addresses by channel name.
        memory: from the epoch before.
        clean: what healthy sensors say.
        noise: for random faults, addressed ``fault/<id>``.
        epoch: index of this epoch.
        period: seconds between epochs.

    Returns:
        The new memory and the readings the navigator gets; ``clean`` itself where nothing is live.
    """
    kept = math.ceil(MAX_DELAY / period) + 1
    history = (*memory.history[-(kept - 1) :], clean)
    by_group: dict[str, list[tuple[Fault, ChannelAddress]]] = {}
    for fault in faults:
        address = channels[fault.channel]
        if np.any(_live(fault, clean[address.group].times)):
            by_group.setdefault(address.group, []).append((fault, address))
    if not by_group:
        return FaultMemory(history), clean
    held: dict[str, Array] = {}
    wandered: dict[str, Array] = {}
    groups = dict(clean.groups)
    for name, members in by_group.items():
        groups[name] = _faulty_group(name, members, memory, history, clean, noise, epoch, period, held, wandered)
    return FaultMemory(history, held, wandered), Readings(clean.time, groups, clean.aiding)


def _live(fault: Fault, times: Array) -> NDArray[np.bool_]:
    """At which sample times the fault is live. Times are those of the samples, so an onset inside an epoch is exact."""
    assert fault.start is not None
    live: NDArray[np.bool_] = np.asarray(times >= fault.start - 1e-9)
    if fault.end is not None:
        live = live & (times < fault.end - 1e-9)
    return live


def _faulty_group(
    name: str,
    members: Sequence[tuple[Fault, ChannelAddress]],
    memory: FaultMemory,
    history: tuple[Readings, ...],
    clean: Readings,
    noise: NoiseSource,
    epoch: int,
    period: float,
    held: dict[str, Array],
    wandered: dict[str, Array],
) -> Group:
    group = clean[name]
    sampled = group.values.ndim == 3
    times = np.atleast_1d(group.times)
    reading = np.array(group.values if sampled else group.values[..., None])
    valid = np.array(group.valid)
    runs, _, samples = reading.shape
    gain = np.ones((1, reading.shape[1], samples))
    added = np.zeros_like(reading)
    stuck: list[tuple[Fault, ChannelAddress]] = []
    for fault, address in members:
        assert fault.start is not None
        columns = list(address.parts)
        size = si_magnitude(fault, address.unit)
        live = _live(fault, times)
        since = times - fault.start
        shape = (len(columns), samples)
        if fault.kind == "bias":
            added[:, columns] += size * live
        elif fault.kind == "ramp":
            added[:, columns] += size * since * live
        elif fault.kind == "sine":
            added[:, columns] += size * np.sin(fault.angular_frequency * since) * live
        elif fault.kind == "scale-factor":
            gain[:, columns] += size * live
        elif fault.kind == "noise":
            added[:, columns] += size * noise.normal(f"fault/{fault.id}", epoch, shape) * live
        elif fault.kind == "outliers":
            spike = noise.uniform(f"fault/{fault.id}/when", epoch, shape) < fault.rate
            sign = np.sign(noise.normal(f"fault/{fault.id}/sign", epoch, shape))
            added[:, columns] += size * sign * spike * live
        elif fault.kind == "random-walk":
            so_far = (memory.wandered or {}).get(str(fault.id), np.zeros((runs, 1)))
            steps = noise.normal(f"fault/{fault.id}", epoch, (samples,)) * (size * math.sqrt(period / samples)) * live
            walk = so_far + np.cumsum(steps, axis=1)
            wandered[str(fault.id)] = walk[:, -1:]
            added[:, columns] += (walk * live)[:, None, :]
        elif fault.kind == "delay":
            late = _delayed(history, name, columns, times - size)
            reading[:, columns] = np.where(live, late, reading[:, columns])
        elif fault.kind == "stuck":
            stuck.append((fault, address))
        elif fault.kind == "dropout":
            valid[:, columns] &= not bool(live.any())
    reading = gain * reading + added
    for fault, address in stuck:
        columns = list(address.parts)
        value = (memory.held or {}).get(str(fault.id))
        if value is None:
            value = _last_good(history, name, columns)
        held[str(fault.id)] = value
        reading[:, columns] = np.where(_live(fault, times), value[..., None], reading[:, columns])
    return Group(reading if sampled else reading[..., 0], valid, group.times)


def _last_good(history: tuple[Readings, ...], name: str, columns: list[int]) -> Array:
    """Last sample before this epoch, or the first one of this epoch at the very beginning."""
    before = history[-2][name].values if len(history) > 1 else None
    values = history[-1][name].values if before is None else before
    if values.ndim == 3:
        values = values[..., 0 if before is None else -1]
    good: Array = values[:, columns]
    return good


def _delayed(history: tuple[Readings, ...], name: str, columns: list[int], wanted: Array) -> Array:
    """Past clean readings at the ``wanted`` times, linear between samples, the oldest known before that."""
    times = np.concatenate([np.atleast_1d(past[name].times) for past in history])
    values = np.concatenate([v if (v := past[name].values).ndim == 3 else v[..., None] for past in history], axis=2)[
        :, columns
    ]
    after = np.clip(np.searchsorted(times, wanted), 1, max(1, len(times) - 1)) if len(times) > 1 else np.zeros(1, int)
    if len(times) == 1:
        return np.broadcast_to(values, (*values.shape[:2], len(wanted)))
    share = np.clip((wanted - times[after - 1]) / (times[after] - times[after - 1]), 0.0, 1.0)
    late: Array = (1.0 - share) * values[..., after - 1] + share * values[..., after]
    return late


def form_schema(kinds: Iterable[str], channel_unit: str) -> dict[str, Any]:
    """What the fault form needs for one channel: per kind its label, sentence, unit and further fields."""
    schema: dict[str, Any] = {}
    for kind in kinds:
        info = KINDS[kind]  # type: ignore[index]
        schema[kind] = {
            "label": info.label,
            "sentence": info.sentence,
            "unit": info.unit(channel_unit),
            "parameters": list(info.parameters),
        }
    return schema
