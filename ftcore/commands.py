"""Commands: everything that is done to a flight, each a frozen value with its time.

:meth:`ftcore.simulation.Simulation.do` takes them and is the only way into a flight. A command is JSON and back
(``TypeAdapter(Command)``), told from the others by its ``action``; so is the answer to it. What the operator does is
kept in the command log of a scenario document; the two that move time, :class:`Advance` and :class:`Rewind`, are not.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from ftcore.documents import Seconds, Strict
from ftcore.faults import Fault
from ftcore.identifiers import Id, Name


class CommandError(ValueError):
    """A command that was refused and changed nothing; ``field`` says which part of it is wrong."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


class NoSuchFault(CommandError):
    """A command to a fault that is not there."""


class FlightError(RuntimeError):
    """FTLab failed in an epoch, which is a defect of FTLab and of no command. The flight stands as it was before.

    Attributes:
        time: of the last epoch that was flown [s].
        reason: what went wrong, for the record.
    """

    def __init__(self, time: float, error: Exception) -> None:
        self.time = time
        self.reason = f"{type(error).__name__}: {error}".splitlines()[0][:300]
        super().__init__(
            f"FTLab failed in the epoch after {time:g} s ({self.reason}); this is a defect of FTLab. The flight is "
            f"kept up to {time:g} s: look at it, rewind it, or fork from before"
        )


def _number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no number, text, true or false")


def _as_json(values: dict[str, Any]) -> dict[str, Any]:
    """The values as JSON gives them back, so that a command written and read is the same command."""
    try:
        text = json.dumps(values, allow_nan=False, default=_number, ensure_ascii=False)
        text.encode()
        copy: dict[str, Any] = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise PydanticCustomError(
            "json", "these are finite numbers, texts, true or false: {reason}", {"reason": str(error)}
        ) from None
    return copy


Values = Annotated[dict[str, Any], AfterValidator(_as_json)]
"""Named values, of which the command's own form says nothing more."""


def _names_its_action(schema: dict[str, Any]) -> None:
    """A document has to say what its commands are; in Python the class does."""
    del schema["properties"]["action"]["default"]
    schema["required"] = ["action", *schema["required"]]


class _Base(Strict):
    action: str
    time: Seconds

    model_config = ConfigDict(json_schema_extra=_names_its_action)

    @model_serializer(mode="wrap")
    def _with_its_action(self, handler: SerializerFunctionWrapHandler):  # type: ignore[no-untyped-def]
        """Also where defaults are left out. Pydantic takes the schema from the fields, as no type is returned."""
        return {"action": self.action, **handler(self)}


class Inject(_Base):
    """Operator command: inject this fault."""

    action: Literal["inject"] = "inject"
    fault: Fault


class Change(_Base):
    """Operator command: change fields of a fault."""

    action: Literal["change"] = "change"
    fault: Id
    fields: Values


class Clear(_Base):
    """Operator command: clear one fault, or all (``fault`` absent)."""

    action: Literal["clear"] = "clear"
    fault: Id | None = None


class Switch(_Base):
    """Operator command: switch a subsystem."""

    action: Literal["switch"] = "switch"
    subsystem: Name
    enabled: bool


class Configure(_Base):
    """Operator command: change settings."""

    action: Literal["configure"] = "configure"
    settings: Values


class Advance(_Base):
    """Fly on to a time, or for a number of epochs, or to the end if neither is given; never past the end."""

    action: Literal["advance"] = "advance"
    until: float | None = Field(default=None, ge=0.0, json_schema_extra={"unit": "s"})
    epochs: int | None = Field(default=None, ge=0)


class Rewind(_Base):
    """Go back to an earlier moment, as it was when the clock left it; what came later is forgotten."""

    action: Literal["rewind"] = "rewind"
    to: Seconds


OperatorCommand = Annotated[Inject | Change | Clear | Switch | Configure, Field(discriminator="action")]
"""What the operator does: the command log of a scenario document holds these."""

Command = Annotated[Inject | Change | Clear | Switch | Configure | Advance | Rewind, Field(discriminator="action")]
"""Everything that can be done to a flight."""


class Answer(Strict):
    """What came of a command that was not refused.

    Attributes:
        command: as it was done: a fault that was injected has its id and its start.
        outcome: done; unchanged, where everything was so already; scheduled, to be done when its time comes.
        time: where the flight stands afterwards.
        faults: those that were injected, changed, ended, or taken away before they began (these as they were).
    """

    command: Command
    outcome: Literal["done", "unchanged", "scheduled"]
    time: Seconds
    faults: tuple[Fault, ...] = ()


C = TypeVar("C", bound=Strict)
_INSIDE: dict[type[Strict], str] = {Inject: "fault", Change: "fields", Configure: "settings"}
"""Where a command has what it is about."""


def made(form: type[C], values: Mapping[str, Any]) -> C:
    """A command of these values.

    Args:
        form: its class.
        values: its fields; numbers of NumPy are numbers.

    Raises:
        CommandError: a value that the form does not take, with the field that is wrong.
    """
    numbers = {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
    try:
        return form.model_validate(numbers)
    except ValidationError as error:
        first = error.errors()[0]
        message = first["msg"].removeprefix("Value error, ")
        names = [str(part) for part in first["loc"]]
        if names[:1] == [_INSIDE.get(form)]:
            # A rule on a whole fault begins with the field that breaks it.
            names = names[1:] or [word for word in message.split(" ")[:1] if word in Fault.model_fields] or names
        raise CommandError(".".join(names), message) from None


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Named values as JSON has them. Raises CommandError, naming one that is no number, text, true or false."""
    for name, value in values.items():
        try:
            _as_json({name: value})
        except PydanticCustomError as error:
            raise CommandError(name, error.message()) from None
    return _as_json(dict(values))


def refusal(error: ValidationError, whole: str, known: str = "") -> CommandError:
    """The first thing that pydantic found, as a refused command; ``whole`` names the field where it names none."""
    first = error.errors()[0]
    hint = known if first["type"] == "extra_forbidden" else ""
    return CommandError(".".join(map(str, first["loc"])) or whole, first["msg"] + hint)


def place(command: Command, field: str) -> str:
    """Where a refused field stands in the document of its command, as a dotted path.

    A refusal names a fault's field, a setting or a switch by the word that the operator used: ``magnitude`` of an
    Inject is at ``fault.magnitude``.
    """
    inside = _INSIDE.get(type(command))
    if isinstance(command, Switch) and field == "name":
        return "subsystem"
    if inside is None or field in (inside, "fault", "time", "commands"):
        return field
    return f"{inside}.{field}"


def not_before(command: Inject) -> None:
    """Refuse a fault that starts before it is injected. Raises CommandError."""
    start = command.fault.start
    if start is not None and start < command.time - 1e-9:
        raise CommandError(
            "start",
            f"start is {start:g} s, but the command is given at {command.time:g} s; leave start out to begin then",
        )


def what(command: OperatorCommand) -> str:
    """What a command is about, in words."""
    match command:
        case Inject(fault=fault):
            return f"{fault.channel} {fault.words()}"
        case Change(fault=fault_id, fields=fields):
            return f"{fault_id}: {_pairs(fields)}"
        case Clear(fault=fault_id):
            return fault_id or "all faults"
        case Switch(subsystem=subsystem, enabled=enabled):
            return f"{subsystem} {'on' if enabled else 'off'}"
        case Configure(settings=settings):
            return _pairs(settings)


def _pairs(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())
