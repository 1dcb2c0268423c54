"""The command log of a flight: what the operator did and what is still to come, as far as a scenario has room for it.

So the document of a flight can always be flown again. The commands of the scenario's own log, those given in flight and
those given ahead of their time are entries of one log; replaying is going through it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from ftcore.commands import CommandError, OperatorCommand
from ftcore.scenario import MAX_COMMANDS

MAX_BYTES = 1_500_000
"""Largest log [bytes of JSON, without spaces]: with indents, and the rest of the scenario, a server still takes it."""


def size_of(command: OperatorCommand) -> int:
    """How much a command takes in a document [bytes], its comma included."""
    return len(command.model_dump_json().encode()) + 1


class Entry(NamedTuple):
    """One command of a log.

    Attributes:
        command: with the time at which it is done.
        own: whether it is the scenario's own, which no rewind forgets.
        size: in a document [bytes].
    """

    command: OperatorCommand
    own: bool
    size: int


@dataclass(frozen=True)
class CommandLog:
    """Commands in the order in which they are done; a value.

    Attributes:
        entries: all of them.
        done: how many are done. The others wait for their time, in the order of their times.
        size: of all together [bytes].
    """

    entries: tuple[Entry, ...] = ()
    done: int = 0
    size: int = 0

    @staticmethod
    def of(commands: Iterable[OperatorCommand]) -> CommandLog:
        """The log of a scenario, of which nothing is done yet."""
        # An epoch's time is known to a billionth of a second; commands of one epoch stay in the order of the document.
        ordered = sorted(commands, key=lambda command: round(command.time, 8))
        entries = tuple(Entry(command, True, size_of(command)) for command in ordered)
        return CommandLog(entries, 0, sum(entry.size for entry in entries))

    def __iter__(self) -> Iterator[OperatorCommand]:
        """All commands: those that are done, then those that wait."""
        return (entry.command for entry in self.entries)

    def __len__(self) -> int:
        """How many commands there are."""
        return len(self.entries)

    def due(self, now: float) -> OperatorCommand | None:
        """The next command that waits, if its time has come at ``now`` [s]."""
        if self.done == len(self.entries) or self.entries[self.done].command.time > now + 1e-9:
            return None
        return self.entries[self.done].command

    def next(self, command: OperatorCommand) -> CommandLog:
        """The log when the next command is done; ``command`` is it as it was done, with a fault's id and start."""
        entry = self.entries[self.done]
        if entry.own or entry.command == command:
            return replace(self, done=self.done + 1)
        new = Entry(command, False, size_of(command))
        entries = (*self.entries[: self.done], new, *self.entries[self.done + 1 :])
        return CommandLog(entries, self.done + 1, self.size - entry.size + new.size)

    def with_done(self, command: OperatorCommand) -> CommandLog:
        """The log with a command that is done now. Raises CommandError if a scenario has no room for it."""
        return replace(self._with(command, self.done), done=self.done + 1)

    def with_waiting(self, command: OperatorCommand) -> CommandLog:
        """The log with a command for later. Raises CommandError if a scenario has no room for it."""
        place = len(self.entries)
        while place > self.done and self.entries[place - 1].command.time > command.time:
            place -= 1
        return self._with(command, place)

    def until(self, time: float) -> CommandLog:
        """The log after a rewind to ``time`` [s]: of later commands only the scenario's own stay, and wait again."""
        kept = tuple(entry for entry in self.entries if entry.own or entry.command.time <= time + 1e-9)
        done = sum(entry.command.time <= time + 1e-9 for entry in kept[: self.done])
        return CommandLog(kept, done, sum(entry.size for entry in kept))

    def _with(self, command: OperatorCommand, place: int) -> CommandLog:
        entry = Entry(command, False, size_of(command))
        size = self.size + entry.size
        if len(self.entries) >= MAX_COMMANDS or size > MAX_BYTES:
            raise CommandError(
                "commands",
                f"the command log is full: a scenario holds at most {MAX_COMMANDS} commands of {MAX_BYTES} bytes "
                "together; fly on without more, rewind, or begin a new flight",
            )
        return replace(self, entries=(*self.entries[:place], entry, *self.entries[place:]), size=size)
