"""Faults laid over the clean readings of an epoch, and what each of them changed.

Faults add up and can each be cleared. For one channel with several live faults the reading becomes

    dropout( stuck( (1 + scale) * delayed(reading) + bias + ramp + sine + noise + outliers + random walk ) )

What lies outside of an instrument's range is no reading. ``reading`` is always the clean sensor's, so clearing a fault
restores it exactly. Whatever is random in a fault is addressed by the fault's id (see :mod:`ftcore.noise`), so no other
channel's noise moves.

A fault *acts* in an epoch if the readings would have been others, by a bit at least, without it. Two that do the same
are not both idle: of several dropouts the first one acts, of several stuck faults the last one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ftcore.faults import MAX_DELAY, ChannelAddress, Fault, in_range, si_magnitude
from ftcore.noise import NoiseSource
from ftcore.readings import Group, Readings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


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


@dataclass(frozen=True)
class Effect:
    """What one live fault did to the readings of one epoch.

    Attributes:
        changed: ``(runs, parts of the channel)``, which readings are others because of it.
        because: why it changed nothing in the first run, one clause; None where it changed something.
    """

    changed: Flags
    because: str | None


def apply(
    faults: Sequence[Fault],
    channels: Mapping[str, ChannelAddress],
    memory: FaultMemory,
    clean: Readings,
    noise: NoiseSource,
    epoch: int,
    period: float,
) -> tuple[FaultMemory, Readings, dict[str, Effect]]:
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
        The new memory; the readings the navigator gets, ``clean`` itself where nothing is live; and the effect of every
        fault that is live at one of its channel's samples at least, by id.
    """
    kept = math.ceil(MAX_DELAY / period) + 1
    history = (*memory.history[-(kept - 1) :], clean)
    by_group: dict[str, list[tuple[Fault, ChannelAddress]]] = {}
    for fault in faults:
        address = channels[fault.channel]
        if np.any(live_at(fault, clean[address.group].times)):
            by_group.setdefault(address.group, []).append((fault, address))
    if not by_group:
        return FaultMemory(history), clean, {}
    held: dict[str, Array] = {}
    wandered: dict[str, Array] = {}
    effects: dict[str, Effect] = {}
    groups = dict(clean.groups)
    for name, members in by_group.items():
        group = clean[name]
        works = [
            _work(fault, address, memory, history, group, noise, epoch, period, held, wandered)
            for fault, address in members
        ]
        unit = members[0][1].unit
        groups[name] = laid = _laid(group, works, unit)
        for i, work in enumerate(works):
            changed = _changed(laid, _laid(group, _without(works, i), unit), work.columns)
            effects[str(work.fault.id)] = Effect(changed, None if changed[0].any() else _why(works, i, group))
    return FaultMemory(history, held, wandered), Readings(clean.time, groups, clean.aiding), effects


def not_in_view(channel: str) -> str:
    """What to say of a channel that has no reading."""
    return f"{channel} is not in view: there is no reading of it"


def live_at(fault: Fault, times: Array) -> Flags:
    """At which sample times the fault is live. Times are those of the samples, so an onset inside an epoch is exact."""
    assert fault.start is not None
    live: Flags = np.asarray(times >= fault.start - 1e-9)
    if fault.end is not None:
        live = live & (times < fault.end - 1e-9)
    return live


def addition(fault: Fault, size: float, since: Array) -> Array:
    """What a bias, ramp or sine of ``size`` [SI] adds at times ``since`` its onset [s]."""
    if fault.kind == "ramp":
        return size * since
    if fault.kind == "sine":
        return size * np.sin(fault.angular_frequency * since)
    return np.full(np.shape(since), size)


@dataclass(frozen=True)
class _Work:
    """One live fault at the samples of one epoch: what it adds, multiplies by, puts in the reading's place or removes.

    Arrays are ``(runs or 1, parts, samples)``, and zero or one where the fault is not live.
    """

    fault: Fault
    columns: list[int]
    live: Flags
    added: Array | None = None
    gain: Array | None = None
    late: Array | None = None
    held: Array | None = None
    drops: bool = field(default=False)


def _work(
    fault: Fault,
    address: ChannelAddress,
    memory: FaultMemory,
    history: tuple[Readings, ...],
    group: Group,
    noise: NoiseSource,
    epoch: int,
    period: float,
    held: dict[str, Array],
    wandered: dict[str, Array],
) -> _Work:
    """One fault's share; what it has to remember is put into ``held`` and ``wandered``."""
    assert fault.start is not None
    columns = list(address.parts)
    size = si_magnitude(fault, address.unit)
    times = np.atleast_1d(group.times)
    live = live_at(fault, times)
    runs, samples = len(group.values), len(times)
    shape = (len(columns), samples)
    added: Array | None = None
    if fault.kind in ("bias", "ramp", "sine"):
        added = np.broadcast_to(addition(fault, size, times - fault.start) * live, (1, *shape))
    elif fault.kind == "noise":
        added = size * noise.normal(f"fault/{fault.id}", epoch, shape) * live
    elif fault.kind == "outliers":
        spike = noise.uniform(f"fault/{fault.id}/when", epoch, shape) < fault.rate
        sign = np.sign(noise.normal(f"fault/{fault.id}/sign", epoch, shape))
        added = size * sign * spike * live
    elif fault.kind == "random-walk":
        so_far = (memory.wandered or {}).get(str(fault.id), np.zeros((runs, 1)))
        steps = noise.normal(f"fault/{fault.id}", epoch, (samples,)) * (size * math.sqrt(period / samples)) * live
        walk = so_far + np.cumsum(steps, axis=1)
        wandered[str(fault.id)] = walk[:, -1:]
        added = (walk * live)[:, None, :]
    elif fault.kind == "scale-factor":
        return _Work(fault, columns, live, gain=np.broadcast_to(size * live, (1, *shape)))
    elif fault.kind == "delay":
        return _Work(fault, columns, live, late=_delayed(history, address.group, columns, times - size))
    elif fault.kind == "stuck":
        value = (memory.held or {}).get(str(fault.id))
        if value is None:
            value = _last_good(history, address.group, columns)
        held[str(fault.id)] = value
        return _Work(fault, columns, live, held=value[..., None])
    else:
        return _Work(fault, columns, live, drops=True)
    return _Work(fault, columns, live, added=added)


def _laid(group: Group, works: Sequence[_Work], unit: str) -> Group:
    """The group, whose channels are in ``unit``, with these faults over it; the group itself if there are none."""
    if not works:
        return group
    sampled = group.values.ndim == 3
    reading = np.array(group.values if sampled else group.values[..., None])
    valid = np.array(group.valid)
    gain = np.ones((1, *reading.shape[1:]))
    added = np.zeros_like(reading)
    for work in works:
        if work.late is not None:
            reading[:, work.columns] = np.where(work.live, work.late, reading[:, work.columns])
        if work.gain is not None:
            gain[:, work.columns] += work.gain
        if work.added is not None:
            added[:, work.columns] += work.added
        if work.drops:
            valid[:, work.columns] = False
    reading = gain * reading + added
    for work in works:
        if work.held is not None:
            reading[:, work.columns] = np.where(work.live, work.held, reading[:, work.columns])
    sayable = np.asarray(in_range(reading, unit).all(axis=-1))
    if not sayable.all():
        valid = valid & sayable
        reading = np.where(sayable[..., None], reading, 0.0)
    return Group(reading if sampled else reading[..., 0], valid, group.times)


def _without(works: Sequence[_Work], i: int) -> list[_Work]:
    """The others; less those that do what this one does and only repeat it: later dropouts, earlier stuck faults."""
    kind = works[i].fault.kind
    return [
        work
        for k, work in enumerate(works)
        if k != i and not (work.fault.kind == kind and ((kind == "dropout" and k > i) or (kind == "stuck" and k < i)))
    ]


def _changed(laid: Group, without: Group, columns: list[int]) -> Flags:
    """Which of these columns differ ``(runs, columns)``; no reading is no reading, whatever its value."""
    a, b = laid.values[:, columns], without.values[:, columns]
    differs = (a != b) & ~(np.isnan(a) & np.isnan(b))
    if differs.ndim == 3:
        differs = differs.any(axis=-1)
    there, was_there = laid.valid[:, columns], without.valid[:, columns]
    changed: Flags = (there != was_there) | (there & was_there & differs)
    return np.broadcast_to(changed, differs.shape)


def _why(works: Sequence[_Work], i: int, group: Group) -> str:
    """Why this fault changes nothing in the first run, one clause."""
    work, fault = works[i], works[i].fault
    columns = set(work.columns)
    if not group.valid[0, work.columns].any():
        return not_in_view(fault.channel)
    for k, other in enumerate(works):
        if k != i and columns <= set(other.columns):
            if other.drops:
                return f"the dropout {other.fault.id} covers it: there is no reading"
            if other.held is not None and (fault.kind != "stuck" or k > i) and not work.drops:
                return f"the stuck fault {other.fault.id} covers it: the reading is held"
    if work.drops:
        return "other faults leave no reading to drop"
    if work.held is not None:
        return "the reading is the very value that is held"
    if work.late is not None:
        return "the reading has not changed over the delay, or nothing older is known yet"
    if fault.kind == "outliers" and work.added is not None and not np.any(work.added[0]):
        return "no spike has come in this epoch"
    if fault.kind in ("sine", "ramp") and work.added is not None and not np.any(work.added):
        return f"the {fault.kind} is zero at the moment of the reading"
    return "it is below the last bit of the reading"


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
