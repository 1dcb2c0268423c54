"""What a navigator keeps of its past, to fly it again without a culprit that is named late.

Some older banks of filters are kept by value, one every `SPACING` epochs, and every epoch since the oldest of them with
what it needs to be flown again. A bank and an epoch are values of the system's own types (``B`` and ``E``); everything
leads with runs. A run is flown again from the last bank before its own onset, together with the runs that share that
bank; nothing changes in the other runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ftcore.systems.base import Flags, Notice

Ints = NDArray[np.int64]
B = TypeVar("B")
E = TypeVar("E")
T = TypeVar("T")

SPAN = 60
"""Epochs that can be flown again at least, once so many have been flown."""
SPACING = 20
"""Epochs between two banks that are kept."""


@dataclass(frozen=True)
class Past(Generic[B, E]):
    """What is remembered.

    Attributes:
        now: number of the last epoch.
        banks: (number, bank after that epoch), oldest first.
        epochs: all since the oldest bank.
    """

    now: int = 0
    banks: tuple[tuple[int, B], ...] = ()
    epochs: tuple[E, ...] = ()

    @property
    def first(self) -> int:
        """Number of the first epoch that can be flown again."""
        return self.banks[0][0] + 1


@dataclass(frozen=True)
class Flight(Generic[B, E]):
    """How a system flies its past again.

    Attributes:
        some: (bank, runs) -> the bank of these runs alone, and ``some_epoch`` the same of an epoch.
        again: (bank, epoch, its number, runs) -> the bank after the epoch as it is seen now, and that epoch.
        put: (whole bank, bank of some runs, those runs) -> the whole with these runs; ``put_epoch`` the same.
    """

    some: Callable[[B, Ints], B]
    some_epoch: Callable[[E, Ints], E]
    again: Callable[[B, E, int, Ints], tuple[B, E]]
    put: Callable[[B, B, Ints], B]
    put_epoch: Callable[[E, E, Ints], E]


def keep(past: Past[B, E], bank: B) -> Past[B, E]:
    """Before an epoch: keep the bank if it is time."""
    if past.banks and past.now % SPACING:
        return past
    return replace(past, banks=(*past.banks, (past.now, bank)))


def add(past: Past[B, E], epoch: E) -> Past[B, E]:
    """After an epoch: add it, and forget what is older than `SPAN` epochs and the bank before them."""
    now, banks, epochs = past.now + 1, past.banks, (*past.epochs, epoch)
    while len(banks) > 1 and banks[1][0] <= now - SPAN:
        epochs = epochs[banks[1][0] - banks[0][0] :]
        banks = banks[1:]
    return Past(now, banks, epochs)


def fly_again(past: Past[B, E], latest: B, named: Flags, since: Ints, flight: Flight[B, E]) -> tuple[Past[B, E], B]:
    """The latest bank as it would be if every epoch since ``since`` had been seen as it is now, in the runs ``named``.

    ``named (runs,)``; ``since (runs,)``: number of the first epoch that is seen differently, clipped to what is kept.
    The past that is kept is corrected as well, so a later return to it does not bring the culprit back.
    """
    first = past.first
    since = np.clip(since, first, past.now)
    numbers = np.array([number for number, _ in past.banks])
    place = np.searchsorted(numbers, since, side="left") - 1
    banks, epochs = list(past.banks), list(past.epochs)
    for origin in np.unique(place[named]).tolist():
        who = np.flatnonzero(named & (place == origin))
        flown = flight.some(banks[origin][1], who)
        then, begin = origin + 1, int(since[who].min())
        for number in range(banks[origin][0] + 1, past.now + 1):
            i = number - first
            flown, amended = flight.again(flown, flight.some_epoch(epochs[i], who), number, who)
            if number >= begin:
                epochs[i] = flight.put_epoch(epochs[i], amended, who)
            if then < len(banks) and banks[then][0] == number:
                banks[then] = (number, flight.put(banks[then][1], flown, who))
                then += 1
        latest = flight.put(latest, flown, who)
    return Past(past.now, tuple(banks), tuple(epochs)), latest


def notices(who: Mapping[str, Flags], since: Ints, now: int, seconds: float) -> list[Notice]:
    """Whose measurements were taken out of the past, and since when: ``who`` subject -> ``(runs,)``, ``since (runs,)``
    epochs of so many seconds."""
    first = since.astype(np.float64)
    numbers = {"since [s]": first * seconds, "epochs": now + 1.0 - first}
    return [Notice("filter.reflown", name, where, numbers) for name, where in who.items() if where.any()]


def of_runs(value: T, who: Ints) -> T:
    """A value for the runs ``who`` alone: all arrays in it, at any depth of dataclasses and tuples, lead with runs.

    What is common to all runs leads with 1 and stays.
    """
    return cast(T, _mapped(lambda array: array if len(array) == 1 else array[who], value))


def with_runs(value: T, some: T, who: Ints, runs: int) -> T:
    """The value with what ``some`` says of the runs ``who``; shapes as in `of_runs`."""

    def put(old: NDArray[Any], new: NDArray[Any]) -> NDArray[Any]:
        if old is new:
            return old
        whole = np.array(np.broadcast_to(old, (runs, *old.shape[1:])))
        whole[who] = new
        return whole

    return cast(T, _mapped(put, value, some))


def _mapped(function: Callable[..., Any], *values: Any) -> Any:
    first = values[0]
    if isinstance(first, np.ndarray):
        return function(*values)
    if isinstance(first, tuple):
        return tuple(_mapped(function, *parts) for parts in zip(*values, strict=True))
    if is_dataclass(first) and not isinstance(first, type):
        return replace(
            cast(Any, first),
            **{f.name: _mapped(function, *(getattr(v, f.name) for v in values)) for f in fields(first)},
        )
    return values[-1]
