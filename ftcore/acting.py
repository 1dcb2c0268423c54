"""Which faults act, which are silent and why, and which can never act.

A fault acts in an epoch in which it changes what the navigator is given; see :mod:`ftcore.injection`. One whose sensor
is switched off, or whose reading the navigator leaves out unseen, does not act.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ftcore.events import Raw, fault_detail
from ftcore.faults import Acted, ChannelAddress, Fault
from ftcore.injection import Effect, not_in_view
from ftcore.operator import LiveFault, Operator, live, unit_of
from ftcore.readings import Readings
from ftcore.systems.base import Output


@dataclass(frozen=True)
class Deeds:
    """What the faults of a flight have done so far; a value.

    Attributes:
        acted: fault id -> when it acted, of all faults that have been live at a sample.
        silent: fault id -> why it changed nothing in the first run in the last epoch at whose samples it was live.
    """

    acted: Mapping[str, Acted] = field(default_factory=dict)
    silent: Mapping[str, str] = field(default_factory=dict)

    def of(self, fault: Fault, runs: int) -> Acted:
        """When this fault acted."""
        return self.acted.get(str(fault.id)) or Acted.never(runs)


def follow(
    deeds: Deeds,
    effects: Mapping[str, Effect],
    operator: Operator,
    channels: Mapping[str, ChannelAddress],
    output: Output,
    time: float,
) -> Deeds:
    """The deeds after the epoch that ends at ``time`` [s], in which the live faults had these effects."""
    if not effects and not any(acted.now.any() for acted in deeds.acted.values()):
        return deeds
    runs = len(output.alarm)
    acted = {id: a.after(time, np.zeros_like(a.now)) if a.now.any() else a for id, a in deeds.acted.items()}
    silent = dict(deeds.silent)
    for fault in operator.faults:
        id = str(fault.id)
        effect = effects.get(id)
        if effect is None:
            continue
        changed, because = effect.changed, effect.because
        left_out = output.left_out.get(channels[fault.channel].group)
        off = switched_off(channels[fault.channel].sensor, operator.enabled)
        if off is not None:
            changed, because = changed & False, f"{off} is switched off"
        elif left_out is not None:
            changed = changed & ~left_out.where[:, list(channels[fault.channel].parts)]
            because = because or left_out.because
        now = np.asarray(changed.any(axis=-1))
        acted[id] = deeds.of(fault, runs).after(time, now)
        silent.pop(id, None)
        if not now[0] and because is not None:
            silent[id] = because
    return Deeds(acted, silent)


@dataclass(frozen=True)
class Situation:
    """A flight at one moment, as far as its faults are concerned.

    Attributes:
        operator: what is broken, switched and set.
        deeds: of all faults.
        channels: addresses by channel name.
        seen: clean readings of the last epoch, of the first one before it is flown; None where they are not known.
        now: time of the last epoch [s].
        runs: how many there are.
        settled: nobody is suspected or isolated, in any run.
    """

    operator: Operator
    deeds: Deeds
    channels: Mapping[str, ChannelAddress]
    seen: Readings | None
    now: float
    runs: int
    settled: bool = True

    def standing(self, fault: Fault) -> LiveFault:
        """A fault with its state, what it does in run 0, and why it is silent if it is."""
        known = live(fault, self.now, self.channels)
        return standing(known, self.deeds, self.operator.enabled, self.channels, self.seen, self.runs)

    def has_acted(self, fault: Fault) -> bool:
        """Whether it has changed anything in any run."""
        return bool(self.deeds.of(fault, self.runs).epochs.any())

    def event(self, kind: str, fault: Fault, run: int = -1, **more: Any) -> Raw:
        """An event about a fault."""
        detail = fault_detail(fault, unit_of(fault, self.channels)) | more
        return run, kind, self.channels[fault.channel].sensor, detail

    def if_silent(self, fault: Fault) -> Iterator[Raw]:
        """An event for a fault that is over, or lasts until the flight is, if it has acted in no run."""
        if not self.has_acted(fault):
            yield self.event("fault.silent", fault, because=self.standing(fault).silent_because)

    def edges(self, before: float, deeds_before: Deeds, finished: bool) -> Iterator[Raw]:
        """Events of faults in the last epoch: begun, ended, acting for the first time; at the end, never having acted.

        Args:
            before: time of the epoch before [s].
            deeds_before: of that epoch.
            finished: whether the flight is over.
        """
        for fault in self.operator.faults:
            assert fault.start is not None
            if before < fault.start <= self.now or (before == 0.0 == fault.start):
                yield self.event("fault.started", fault)
            if fault.end is not None and before < fault.end <= self.now:
                yield self.event("fault.ended", fault)
                yield from self.if_silent(fault)
        for fault in self.operator.faults:
            if deeds_before.of(fault, self.runs).epochs.all():
                continue
            for run in np.flatnonzero(self.deeds.of(fault, self.runs).first == self.now).tolist():
                yield self.event("fault.acted", fault, run)
            if finished and (fault.end is None or fault.end > self.now):
                yield from self.if_silent(fault)


def standing(
    fault: LiveFault,
    deeds: Deeds,
    enabled: Mapping[str, bool],
    channels: Mapping[str, ChannelAddress],
    seen: Readings | None,
    runs: int,
) -> LiveFault:
    """The fault with what it does in run 0, and why it is silent if it is.

    Args:
        fault: as :func:`ftcore.operator.live` says it.
        deeds: of all faults.
        enabled: subsystem -> switched on.
        channels: addresses by channel name.
        seen: clean readings of the last epoch, of the first one before it is flown; None where they are not known.
        runs: how many there are.
    """
    acted = deeds.of(fault.fault, runs)
    epochs = int(acted.epochs[0])
    if fault.state == "active" and acted.now[0]:
        return replace(fault, acting=True, acted_epochs=epochs)
    return replace(fault, acted_epochs=epochs, silent_because=_why(fault, deeds, enabled, channels, seen, epochs))


def _why(
    live: LiveFault,
    deeds: Deeds,
    enabled: Mapping[str, bool],
    channels: Mapping[str, ChannelAddress],
    seen: Readings | None,
    epochs: int,
) -> str:
    """Why a fault is not acting, one clause."""
    fault, id = live.fault, str(live.fault.id)
    known = deeds.silent.get(id)
    if live.state == "armed":
        return f"armed; starts at {fault.start:g} s"
    if live.state == "ended":
        if epochs:
            return f"ended at {fault.end:g} s"
        return f"ended at {fault.end:g} s, never having acted: {known or 'no reading came while it lasted'}"
    address = channels[fault.channel]
    off = switched_off(address.sensor, enabled)
    if off is not None:
        return f"{off} is switched off"
    if known is not None:
        return known
    if seen is not None and not seen[address.group].valid[0, list(address.parts)].any():
        return not_in_view(fault.channel)
    return "no reading has come since it was laid; the next epoch brings one"


def switched_off(sensor: str, enabled: Mapping[str, bool]) -> str | None:
    """The subsystem that this sensor belongs to, if it is switched off."""
    for name, on in enabled.items():
        if not on and (sensor == name or sensor.startswith(f"{name}.")):
            return name
    return None
