"""A scenario: one document that says what flies, what senses, what fails and who watches.

It is what a notebook loads, what REST takes and what an experiment hands back: with the operator's commands in it, the
same document replays to the same bits.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import FailFast, Field, ValidationInfo, field_validator, model_validator

from ftcore.commands import CommandError, Inject, OperatorCommand, not_before, what
from ftcore.display import card, counted, line, table
from ftcore.documents import Strict
from ftcore.faults import KINDS, Fault, FaultError, check
from ftcore.identifiers import Line, Text
from ftcore.systems.base import System, addresses, invalid, no_effect
from ftcore.systems.registry import SYSTEMS

MAX_FAULTS = 200
MAX_COMMANDS = 20_000
LISTED = 20
"""Commands that a notebook shows."""


class Scenario(Strict):
    """What flies, what senses, what fails, who watches."""

    id: str = Field(default="untitled", pattern=r"^[a-z0-9][a-z0-9-]{0,59}$")
    title: Line = Field(default="Untitled", max_length=120)
    summary: Text = Field(default="", max_length=2000)
    hint: Line = Field(default="", max_length=300, description="one sentence: what to try")
    source: Line = Field(default="", max_length=300, description="the paper, or FTLab")
    featured: bool = Field(default=False, description="listed first; a first-time visitor lands on the first of these")
    system: str = Field(description="id of the system that flies")
    seed: int = Field(default=1, ge=0, lt=2**53, description="a whole number that a browser can hold too")
    duration: float = Field(
        default=100.0,
        gt=0.0,
        le=108_000.0,
        description="at most 36000 s for what is simulated; a receiver's log may last longer",
        json_schema_extra={"unit": "s"},
    )
    parameters: dict[str, Any] = Field(default_factory=dict, description="fixed at the start; schema: the system's")
    settings: dict[str, Any] = Field(default_factory=dict, description="changeable in flight; schema: the system's")
    subsystems: dict[str, bool] = Field(default_factory=dict, description="switched on or off at the start")
    faults: tuple[Fault, ...] = Field(default=(), max_length=MAX_FAULTS)
    commands: Annotated[tuple[OperatorCommand, ...], FailFast()] = Field(
        default=(), max_length=MAX_COMMANDS, description="what the operator did, to replay it"
    )

    @field_validator("system")
    @classmethod
    def _known_system(cls, value: str) -> str:
        if value not in SYSTEMS:
            raise ValueError(f"no system {value!r}; there are {', '.join(SYSTEMS)}")
        return value

    @field_validator("parameters", "settings", mode="after")
    @classmethod
    def _fits_the_system(cls, value: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        system = SYSTEMS.get(info.data.get("system", ""))
        if system is not None:
            form = system.Parameters if info.field_name == "parameters" else system.Settings
            form.strictly(value)
        return value

    @model_validator(mode="after")
    def _every_setting_matters(self) -> Scenario:
        given = self.model.Settings.model_validate(self.settings)
        idle = given.without_effect(self.model.Parameters.model_validate(self.parameters))
        for name in given.differing(tuple(self.settings)):
            if name in idle:
                raise invalid("Scenario", ("settings", name), no_effect(name, idle[name]))
        return self

    @model_validator(mode="after")
    def _lasts_no_longer_than_the_system_can(self) -> Scenario:
        longest = SYSTEMS[self.system].Parameters.model_validate(self.parameters).longest
        if self.duration > longest:
            raise ValueError(f"duration: {self.duration:g} s is too long here; at most {longest:g} s are")
        return self

    @model_validator(mode="after")
    def _faults_and_subsystems_exist(self) -> Scenario:
        description = SYSTEMS[self.system].description
        channels = addresses(description)
        for i, fault in enumerate(self.faults):
            try:
                check(fault, channels)
            except FaultError as error:
                raise ValueError(f"faults[{i}].{error.field}: {error}") from None
        for i, command in enumerate(self.commands):
            if isinstance(command, Inject):
                try:
                    check(command.fault, channels)
                    not_before(command)
                except (FaultError, CommandError) as error:
                    raise ValueError(f"commands[{i}].fault.{error.field}: {error}") from None
        names = [s.name for s in description.subsystems]
        for name in self.subsystems:
            if name not in names:
                raise ValueError(f"subsystems: no subsystem {name!r}; there are {', '.join(names)}")
        ids = [fault.id for fault in self.faults if fault.id is not None]
        if len(set(ids)) < len(ids):
            raise ValueError("faults: two faults have the same id")
        return self

    def __repr__(self) -> str:
        """Id, system, duration and what fails, in one line."""
        return (
            f"<Scenario {self.id}: {self.system}, {self.duration:g} s, seed {self.seed}, "
            f"{counted(len(self.faults), 'fault')}, {counted(len(self.commands), 'command')}>"
        )

    __str__ = __repr__

    def _repr_html_(self) -> str:
        units = {channel.name: channel.unit for channel in self.model.description.channels}
        faults = [(fault.channel, fault.words(KINDS[fault.kind].unit(units[fault.channel]))) for fault in self.faults]
        commands = [(f"{command.time:g} s", command.action, what(command)) for command in self.commands[:LISTED]]
        more = len(self.commands) - len(commands)
        off = [(name, "on" if on else "off") for name, on in self.subsystems.items()]
        given = [(name, str(value)) for name, value in (self.parameters | self.settings).items()]
        return card(
            self.title,
            f"{self.model.description.title}; {self.duration:g} s, seed {self.seed}",
            line(self.summary),
            table("Faults", ("channel", "fault"), faults),
            table("Commands", ("time", "command", "what"), commands),
            line(f"and {counted(more, 'more command')}" if more else ""),
            table("Switched at the start", ("subsystem", ""), off),
            table("Other than by default", ("parameter or setting", "value"), given),
            line(f"Try: {self.hint}" if self.hint else ""),
            line(f"Source: {self.source}" if self.source else ""),
        )

    @property
    def model(self) -> System:
        """The system that flies."""
        return SYSTEMS[self.system]

    @classmethod
    def load(cls, id_or_path: str | Path) -> Scenario:
        """A ready scenario by id, or one from a JSON file.

        Raises:
            FileNotFoundError: neither a ready scenario nor a file; the message lists the ready ones.
            ValueError: the document is not a scenario (pydantic's ValidationError is one).
        """
        ready = resources.files("ftcore") / "scenarios" / f"{id_or_path}.json"
        if isinstance(id_or_path, str) and "/" not in id_or_path and ready.is_file():
            return cls.model_validate_json(ready.read_text("utf-8"))
        path = Path(id_or_path)
        if not path.is_file():
            raise FileNotFoundError(
                f"no scenario {str(id_or_path)!r}: not a file, and the ready ones are {', '.join(ready_ids())}"
            )
        return cls.model_validate(json.loads(path.read_text("utf-8")))


def ready_ids() -> list[str]:
    """Ids of the ready scenarios, in alphabetical order."""
    folder = resources.files("ftcore") / "scenarios"
    return sorted(entry.name.removesuffix(".json") for entry in folder.iterdir() if entry.name.endswith(".json"))
