"""Everything that the operator has set, as a value, and what each command makes of it.

Each function takes an operator and returns a new one, or refuses what cannot be with the field that is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from pydantic import ValidationError

from ftcore.commands import CommandError, NoSuchFault, refusal
from ftcore.faults import KINDS, ChannelAddress, Fault, FaultError, check, unused
from ftcore.scenario import MAX_FAULTS
from ftcore.systems.base import Controls, Form

Channels = Mapping[str, ChannelAddress]


@dataclass(frozen=True)
class LiveFault:
    """A fault as the operator sees it; what it does is of run 0.

    Attributes:
        fault: what was laid where.
        unit: of its magnitude, as a person reads it.
        state: whether its time has come, and gone.
        acting: whether it changed what the navigator was given in the last epoch.
        acted_epochs: in how many epochs it has done so.
        silent_because: one clause that says why it is not acting; None while it is.
    """

    fault: Fault
    unit: str | None
    state: Literal["armed", "active", "ended"]
    acting: bool = False
    acted_epochs: int = 0
    silent_because: str | None = None


@dataclass(frozen=True)
class Operator:
    """What is broken, switched and set.

    Attributes:
        faults: all that were ever injected and flew, or still may.
        enabled: subsystem -> switched on.
        settings: the system's settings form.
        next_id: number of the next fault that comes without an id.
    """

    faults: tuple[Fault, ...]
    enabled: Mapping[str, bool]
    settings: Any
    next_id: int = 1

    @property
    def controls(self) -> Controls:
        """The part the navigator sees."""
        return Controls(self.enabled, self.settings)

    def find(self, fault_id: str) -> Fault:
        """The fault of that id. Raises NoSuchFault, listing those there are."""
        for fault in self.faults:
            if fault.id == fault_id:
                return fault
        known = ", ".join(str(f.id) for f in self.faults) or "none"
        raise NoSuchFault("fault", f"no fault {fault_id!r}; there is {known}")

    def find_subsystem(self, name: str) -> None:
        """Raise CommandError, listing those there are, if there is no subsystem of that name."""
        if name not in self.enabled:
            raise CommandError("name", f"no subsystem {name!r}; there are {', '.join(self.enabled)}")


def unit_of(fault: Fault, channels: Channels) -> str | None:
    """Unit of a fault's magnitude, as a person reads it."""
    return fault.unit or KINDS[fault.kind].unit(channels[fault.channel].unit)


def live(fault: Fault, now: float, channels: Channels) -> LiveFault:
    """A fault with its state at ``now`` [s]."""
    assert fault.start is not None
    state: Literal["armed", "active", "ended"] = "active"
    if fault.end is not None and now >= fault.end - 1e-9:
        state = "ended"
    elif now < fault.start - 1e-9:
        state = "armed"
    return LiveFault(fault, unit_of(fault, channels), state)


def inject(
    operator: Operator, fault: Fault, now: float, channels: Channels, absent: Mapping[str, str]
) -> tuple[Operator, Fault]:
    """Lay a fault over a channel that is not ``absent``; start defaults to now, an id is given where there is none."""
    if len(operator.faults) >= MAX_FAULTS:
        raise CommandError("fault", f"there are {MAX_FAULTS} faults already, the most one flight takes")
    number = operator.next_id
    taken = {f.id for f in operator.faults}
    if fault.id in taken:
        raise CommandError("id", f"there is a fault {fault.id!r} already; leave id out to be given one")
    while fault.id is None and f"f{number}" in taken:
        number += 1
    start = now if fault.start is None else fault.start
    _refuse_past(start, now, "leave start out to begin now, or rewind")
    if fault.end is not None and fault.end <= start:
        raise CommandError("end", f"end is {fault.end:g} s, which is not after the start at {start:g} s")
    injected = fault.model_copy(update={"id": fault.id or f"f{number}", "start": start})
    _checked(injected, channels, absent)
    return replace(operator, faults=(*operator.faults, injected), next_id=number + 1), injected


def change(
    operator: Operator,
    fault_id: str,
    fields: Mapping[str, Any],
    now: float,
    channels: Channels,
    absent: Mapping[str, str],
) -> tuple[Operator, Fault]:
    """Change fields of a fault that is armed or active."""
    old = operator.find(fault_id)
    if live(old, now, channels).state == "ended":
        raise CommandError("fault", f"fault {fault_id!r} has ended; inject a new one")
    if "id" in fields:
        raise CommandError("id", "a fault keeps its id; leave it out")
    if fields.get("start", old.start) is None:
        raise CommandError("start", "start of a fault that is there cannot be none; give a time in seconds")
    kind = fields.get("kind", old.kind)
    if kind in KINDS:
        for name in fields:
            if not KINDS[kind].uses(name):
                raise CommandError(name, unused(kind, name))
    kept = {name: value for name, value in old.model_dump().items() if kind not in KINDS or KINDS[kind].uses(name)}
    try:
        new = Fault.model_validate(kept | dict(fields))
    except ValidationError as error:
        raise refusal(error, "end") from None
    if new.start != old.start:
        assert old.start is not None
        if live(old, now, channels).state == "active":
            raise CommandError(
                "start", f"fault {fault_id!r} has started at {old.start:g} s; clear it and inject another one"
            )
        assert new.start is not None
        _refuse_past(new.start, now, "give a later one, or rewind")
    if new.end is not None and new.end != old.end and new.end <= now + 1e-9:
        raise CommandError(
            "end", f"end is {new.end:g} s, but the flight is at {now:g} s; clear the fault to end it now"
        )
    _checked(new, channels, absent)
    return replace(operator, faults=tuple(new if f.id == fault_id else f for f in operator.faults)), new


def _refuse_past(start: float, now: float, instead: str) -> None:
    """Refuse a start [s] that the flight has passed."""
    if start < now - 1e-9:
        raise CommandError("start", f"start is {start:g} s, but the flight is at {now:g} s; {instead}")


def _checked(fault: Fault, channels: Channels, absent: Mapping[str, str]) -> None:
    """Refuse a fault that its channel cannot take, or for which there is none."""
    try:
        check(fault, channels)
    except FaultError as error:
        raise CommandError(error.field, str(error)) from None
    if fault.channel in absent:
        raise CommandError("channel", f"{fault.channel} is not there: {absent[fault.channel]}")


def ended_by(fault: Fault, now: float) -> Fault:
    """A fault as it was when it was cleared at ``now`` [s], or has ended before; one that never began ends too."""
    return fault if fault.end is not None and fault.end <= now + 1e-9 else fault.model_copy(update={"end": now})


def clear(operator: Operator, fault_id: str, now: float, channels: Channels) -> tuple[Operator, Fault]:
    """End a fault now; one that never flew is taken away altogether."""
    fault = operator.find(fault_id)
    if live(fault, now, channels).state == "ended":
        return operator, fault
    assert fault.start is not None
    ended = ended_by(fault, now)
    if fault.start >= now - 1e-9:
        return replace(operator, faults=tuple(f for f in operator.faults if f.id != fault_id)), ended
    return replace(operator, faults=tuple(ended if f.id == fault_id else f for f in operator.faults)), ended


def switch(operator: Operator, subsystem: str, enabled: bool) -> Operator:
    """Switch a subsystem off or on."""
    operator.find_subsystem(subsystem)
    return replace(operator, enabled={**operator.enabled, subsystem: enabled})


def configure(operator: Operator, form: type[Form], settings: Mapping[str, Any]) -> Operator:
    """Change settings of the system."""
    try:
        new = form.strictly(operator.settings.model_dump() | dict(settings))
    except TypeError as error:
        raise CommandError("settings", f"settings are numbers, texts, true or false: {error}") from None
    except ValidationError as error:
        known = ", ".join(form.model_fields)
        raise refusal(error, "settings", f"; settings are {known}") from None
    return replace(operator, settings=new)
