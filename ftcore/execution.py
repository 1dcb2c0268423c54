"""What the operator's commands do: a new operator, and the events that say so. Nothing is changed in place.

A command that cannot be done is refused here, before anything of the flight has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ftcore import operator
from ftcore.acting import Situation
from ftcore.commands import Change, Clear, CommandError, Configure, Inject, OperatorCommand, Switch, not_before
from ftcore.events import Raw
from ftcore.faults import Fault
from ftcore.operator import Operator
from ftcore.prospects import Outlook, refuse_idle
from ftcore.systems.base import Form, no_effect


@dataclass(frozen=True)
class Rules:
    """What commands are checked against, the same for a whole flight.

    Attributes:
        absent: channels that are not there, and why.
        parameters: of the flight.
        form: of the system's settings.
    """

    absent: Mapping[str, str]
    parameters: Form
    form: type[Form]


@dataclass(frozen=True)
class Execution:
    """What a command makes of a flight.

    Attributes:
        command: as it was done: a fault that was injected has its id and its start.
        operator: what is broken, switched and set afterwards; the same object as before if nothing changes.
        faults: those that were injected, changed, ended, or taken away before they began.
        events: what is to be announced.
    """

    command: OperatorCommand
    operator: Operator
    faults: tuple[Fault, ...] = ()
    events: tuple[Raw, ...] = ()


def execute(command: OperatorCommand, situation: Situation, rules: Rules, outlook: Callable[[], Outlook]) -> Execution:
    """Do a command now, whatever its time.

    Args:
        command: what the operator does.
        situation: the flight as it is.
        rules: of the flight.
        outlook: what is known of the rest of the flight; asked for where a fault is laid or changed.

    Raises:
        CommandError: it cannot be done; the field is that of the fault, the setting or the subsystem.
    """
    before, now, channels = situation.operator, situation.now, situation.channels
    match command:
        case Inject():
            after, fault = operator.inject(before, command.fault, now, channels, rules.absent)
            refuse_idle(fault, channels[fault.channel], outlook())
            done = command.model_copy(update={"fault": fault})
            return Execution(done, after, (fault,), (situation.event("fault.injected", fault),))
        case Change():
            after, fault = operator.change(before, command.fault, command.fields, now, channels, rules.absent)
            refuse_idle(fault, channels[fault.channel], outlook(), situation.has_acted(fault))
            return Execution(command, after, (fault,), (situation.event("fault.changed", fault),))
        case Clear():
            return _clear(command, situation)
        case Switch():
            after = operator.switch(before, command.subsystem, command.enabled)
            if after.enabled == before.enabled:
                return Execution(command, before)
            detail = {"enabled": command.enabled}
            return Execution(command, after, (), ((-1, "subsystem.switched", command.subsystem, detail),))
        case Configure():
            after = operator.configure(before, rules.form, command.settings)
            for name, why in after.settings.without_effect(rules.parameters, situation.settled).items():
                if getattr(after.settings, name) != getattr(before.settings, name):
                    raise CommandError(name, no_effect(name, why))
            if after.settings == before.settings:
                return Execution(command, before)
            return Execution(command, after, (), ((-1, "settings.changed", "settings", dict(command.settings)),))


def _clear(command: Clear, situation: Situation) -> Execution:
    """End one fault, or all that are armed or active."""
    ids = [command.fault]
    if command.fault is None:
        ids = [f.id for f in situation.operator.faults if situation.standing(f).state != "ended"]
    faults: list[Fault] = []
    events: list[Raw] = []
    for id in ids:
        fault = situation.operator.find(str(id))
        after, ended = operator.clear(situation.operator, str(id), situation.now, situation.channels)
        stays = any(other.id == fault.id for other in after.faults)
        faults.append(ended if stays else fault)
        if after is not situation.operator:
            situation = replace(situation, operator=after)
            events.append(situation.event("fault.cleared", ended))
            if stays:
                events += situation.if_silent(ended)
    return Execution(command, situation.operator, tuple(faults), tuple(events))


def foresee(command: OperatorCommand, situation: Situation, rules: Rules) -> None:
    """Refuse a command for later that cannot be done whatever comes before it.

    Faults, settings and switches may be others by then, so only what is fixed for the flight is checked.

    Raises:
        CommandError: as :func:`execute` does.
    """
    match command:
        case Inject():
            not_before(command)
            healthy = replace(situation.operator, faults=())
            operator.inject(healthy, command.fault, command.time, situation.channels, rules.absent)
        case Switch():
            situation.operator.find_subsystem(command.subsystem)
        case Configure():
            for name in command.settings:
                if name not in rules.form.model_fields:
                    known = ", ".join(rules.form.model_fields)
                    raise CommandError(name, f"there is no setting {name!r}; settings are {known}")
        case Change() | Clear():
            pass  # the fault that it names may be injected until then
