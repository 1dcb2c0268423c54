"""What the operator did, as far as a scenario has room for it: a flight's document can always be flown again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ftcore.commands import CommandError
from ftcore.scenario import MAX_COMMANDS, Command

MAX_BYTES = 1_500_000
"""Largest log [bytes of JSON, without spaces]: with indents, and the rest of the scenario, a server still takes it."""


def size_of(command: Command) -> int:
    """How much a command takes in a document [bytes], its comma included."""
    return len(command.model_dump_json().encode()) + 1


@dataclass(frozen=True)
class CommandLog:
    """Commands in the order in which they were given, each with its size, beside those of the scenario's own log.

    Attributes:
        scripted: how many commands the scenario has, and their size together [bytes].
        given: those that were given in flight, with their sizes [bytes].
    """

    scripted: tuple[int, int] = (0, 0)
    given: tuple[tuple[Command, int], ...] = ()
    size: int = 0

    @staticmethod
    def beside(commands: Sequence[Command]) -> CommandLog:
        """An empty log for a scenario with these commands of its own."""
        size = sum(map(size_of, commands))
        return CommandLog((len(commands), size), (), size)

    def __iter__(self) -> Iterator[Command]:
        """The commands that were given in flight."""
        return (command for command, _ in self.given)

    def plus(self, *commands: Command) -> CommandLog:
        """The log with more commands. Raises CommandError if a scenario has no room for them."""
        sizes = [size_of(command) for command in commands]
        size, number = self.size + sum(sizes), self.scripted[0] + len(self.given) + len(commands)
        if number > MAX_COMMANDS or size > MAX_BYTES:
            raise CommandError(
                "commands",
                f"the command log is full: a scenario holds at most {MAX_COMMANDS} commands of {MAX_BYTES} bytes "
                "together; fly on without more, rewind, or begin a new flight",
            )
        return replace(self, given=(*self.given, *zip(commands, sizes, strict=True)), size=size)

    def until(self, time: float) -> CommandLog:
        """The log without what was given after ``time`` [s]."""
        kept = tuple((command, size) for command, size in self.given if command.time <= time + 1e-9)
        return replace(self, given=kept, size=self.scripted[1] + sum(size for _, size in kept))
