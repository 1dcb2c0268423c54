"""Logs of real receivers: RINEX 2 and 3 observation and navigation files, plain or packed.

Every file that cannot be read is refused by one sentence, :class:`LogError`; what a person has to know of a file that
is read, such as another code than the civil one, stands in the log's notes.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.sensors import broadcast, rinex_navigation, rinex_observation
from ftcore.sensors.broadcast import WEEK
from ftcore.sensors.rinex_observation import PRNS, Observations
from ftcore.sensors.rinex_text import NAVIGATION, OBSERVATION, LogError, date, refusal
from ftcore.sensors.rinex_unpack import unpack

Array = NDArray[np.float64]

__all__ = ["LogError", "ObservationLog", "parse", "read", "restrict"]

MAX_OBSERVATION_BYTES: Final = 64_000_000
"""Of a file, and of what comes out of a packed one: a day of 30 s with all systems and signals has 30 to 40 MB."""
MAX_NAVIGATION_BYTES: Final = 20_000_000
"""The same of navigation files: a day of all systems and the whole world has 8 to 12 MB."""
MAX_EPOCHS: Final = 8640
"""A day at an epoch every ten seconds."""
LONGEST: Final = 108_000.0
"""Longest log [s], thirty hours."""
_MILLISECOND: Final = 1e-3 * earth.SPEED_OF_LIGHT

_folder: Path | None = None


@dataclass(frozen=True, eq=False)
class ObservationLog:
    """What a receiver logged, on an even grid of time; epochs that the log lacks have no pseudoranges.

    Attributes:
        start: time of the first epoch, for a person.
        interval: seconds between epochs.
        week_seconds: (epochs,) the receiver's time tags, seconds of the first epoch's GPS week [s].
        pseudorange: (epochs, 32) on L1, by satellite number from 1 on [m]; NaN where there is none. Without the whole
            milliseconds by which a receiver sets its clock now and then: they are in all satellites alike.
        satellites: (epochs, 32, 3) position at emission, Earth-fixed of that time [m]; NaN where unknown.
        clock: (epochs, 32) the satellite clock's error, with relativity and group delay [m].
        ionosphere: (8,) Klobuchar's coefficients, or None if the navigation file has none.
        approximate: (3,) position from the header, Earth-fixed [m], or None.
        notes: what a person has to know of the reading, a sentence each.
    """

    start: str
    interval: float
    week_seconds: Array
    pseudorange: Array
    satellites: Array
    clock: Array
    ionosphere: Array | None
    approximate: Array | None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Epochs."""
        return len(self.week_seconds)


def restrict(folder: Path | None) -> Path | None:
    """Accept only bare names of files in ``folder`` from now on, as a server must; None lifts that.

    Returns the folder before.
    """
    global _folder
    before, _folder = _folder, folder
    return before


def read(observation: str, navigation: str) -> ObservationLog:
    """Read a pair of files; the last few are kept, until they change.

    Raises:
        LogError: one sentence that says which file is at fault, and how.
    """
    files = []
    for name, what, limit in (
        (observation, OBSERVATION, MAX_OBSERVATION_BYTES),
        (navigation, NAVIGATION, MAX_NAVIGATION_BYTES),
    ):
        path = _locate(name, what)
        stat = path.stat()
        if stat.st_size > limit:
            raise refusal(what, f"has {stat.st_size / 1e6:.1f} MB; at most {limit / 1e6:.0f} MB are read")
        files.append((str(path), stat.st_size, stat.st_mtime_ns))
    return _read(*files)


def parse(observation: bytes, navigation: bytes) -> ObservationLog:
    """The log of two files' contents, plain or packed. Raises LogError."""
    observed = rinex_observation.read(unpack(observation, OBSERVATION, MAX_OBSERVATION_BYTES), MAX_EPOCHS)
    broadcasted = rinex_navigation.read(unpack(navigation, NAVIGATION, MAX_NAVIGATION_BYTES))
    ephemerides = broadcasted.ephemerides
    stamps, pseudorange, doubled = _merged(observed)
    seconds, interval, pseudorange, between = _grid(stamps, pseudorange, observed.interval)
    position, clock = broadcast.satellites(ephemerides, seconds, pseudorange)
    located = np.isfinite(position[..., 0])
    if not (located.sum(axis=1) >= 4).any():
        raise LogError(
            f"the two files do not belong together: the observations begin at {date(seconds[0])} and end at "
            f"{date(seconds[-1])}, the ephemerides are of {date(ephemerides.toe.min())} to "
            f"{date(ephemerides.toe.max())}"
        )
    log = ObservationLog(
        start=date(seconds[0]),
        interval=interval,
        week_seconds=seconds - float(np.floor(seconds[0] / WEEK)) * WEEK,
        pseudorange=_steady(seconds, np.where(located, pseudorange, np.nan)),
        satellites=position,
        clock=clock,
        ionosphere=ephemerides.ionosphere,
        approximate=observed.position,
        notes=_few([*observed.notes, *doubled, *between, *broadcasted.notes, *_unlocated(located, pseudorange)]),
    )
    for array in (log.week_seconds, log.pseudorange, log.satellites, log.clock):
        array.setflags(write=False)
    return log


def _locate(name: str, what: str) -> Path:
    if _folder is not None and (Path(name).name != name or name in ("", ".", "..")):
        raise refusal(what, "must be the bare name of an uploaded file")
    path = Path(name).expanduser() if _folder is None else _folder / name
    try:
        if path.is_file():
            return path
    except (OSError, ValueError):
        pass
    if _folder is not None:
        raise refusal(what, f"{name[:80]!r} is not here, or no longer; upload the log again")
    raise LogError(f"there is no {what} {name!r}", what.split()[0])


@lru_cache(maxsize=4)
def _read(observation: tuple[str, int, int], navigation: tuple[str, int, int]) -> ObservationLog:
    contents = []
    for (path, size, _), what in ((observation, OBSERVATION), (navigation, NAVIGATION)):
        try:
            with open(path, "rb") as file:
                contents.append(file.read(size + 1))
        except OSError as error:
            raise refusal(what, f"cannot be read: {error.strerror}") from None
    return parse(*contents)


def _merged(observed: Observations) -> tuple[Array, Array, list[str]]:
    """Epochs in the order of time, each once; of a satellite that an epoch has twice the first in the file."""
    order = np.argsort(observed.stamps, kind="stable")
    stamps, ranges = observed.stamps[order], observed.pseudorange[order]
    notes = []
    if (np.diff(observed.stamps) < -1e-3).any():
        back = int(observed.lines[1:][(np.diff(observed.stamps) < -1e-3).argmax()])
        notes.append(f"the epochs are not in the order of time, at line {back} for one; they are sorted")
    again = np.diff(stamps, prepend=-np.inf) <= 1e-3
    if again.any():
        kept = np.flatnonzero(~again)
        owner = np.cumsum(~again) - 1
        result = ranges[kept].copy()
        for row in np.flatnonzero(again).tolist():
            own = result[owner[row]]
            own[np.isnan(own)] = ranges[row][np.isnan(own)]
        where = int(order[again.argmax()])
        notes.append(
            f"{again.sum()} epoch{'s are' if again.sum() > 1 else ' is'} twice in the file, that of "
            f"{date(observed.stamps[where])} at line {observed.lines[where]} for one; what is there first is taken"
        )
        stamps, ranges = stamps[kept], result
    return stamps, ranges, notes


def _grid(stamps: Array, pseudorange: Array, nominal: float | None) -> tuple[Array, float, Array, list[str]]:
    """Times on an even grid, the interval, pseudoranges there, and what that leaves out."""
    steps = np.diff(stamps)
    given = nominal if nominal is not None and 0.01 <= nominal <= 86400.0 else 1.0
    interval = round(float(np.median(steps)), 2) if len(steps) else given
    if interval < 0.01:
        raise refusal(OBSERVATION, "has more than 100 epochs a second")
    place = np.round((stamps - stamps[0]) / interval).astype(np.int64)
    if place[-1] >= MAX_EPOCHS:
        raise refusal(OBSERVATION, f"spans {place[-1] + 1} epochs of {interval:g} s; at most {MAX_EPOCHS} are read")
    if (place[-1] + 1) * interval > LONGEST:
        spanned = (place[-1] + 1) * interval / 3600.0
        raise refusal(OBSERVATION, f"spans {spanned:.1f} hours; at most {LONGEST / 3600.0:.0f} are read")
    first = np.concatenate([[True], np.diff(place) > 0])
    notes = []
    if not first.all():
        notes.append(
            f"{np.count_nonzero(~first)} of {len(first)} epochs lie between those of a {interval:g} s grid and are left"
            f" out, that of {date(stamps[first.argmin()])} for one"
        )
    seconds = stamps[0] + interval * np.arange(place[-1] + 1.0)
    grid = np.full((len(seconds), PRNS), np.nan)
    seconds[place[first]], grid[place[first]] = stamps[first], pseudorange[first]
    return seconds, interval, grid, notes


def _unlocated(located: NDArray[np.bool_], pseudorange: Array) -> list[str]:
    """Satellites that are heard and have no usable ephemeris."""
    lost = (np.isfinite(pseudorange) & ~located).sum(axis=0)
    if not lost.any():
        return []
    heard = np.isfinite(pseudorange).sum(axis=0)
    worst = [f"G{s + 1:02d} in {lost[s]} of {heard[s]} epochs" for s in np.argsort(-lost, kind="stable") if lost[s]]
    more = f" and {len(worst) - 6} more" if len(worst) > 6 else ""
    return [f"no healthy and possible ephemeris of these hours, so not used: {', '.join(worst[:6])}{more}"]


def _few(notes: list[str]) -> tuple[str, ...]:
    """Notes of one kind by one example, and how many there are."""
    kinds = Counter(_kind(note) for note in notes)
    told: dict[str, str] = {}
    for note in notes:
        more = kinds[_kind(note)] - 1
        told.setdefault(_kind(note), note + (f" (and {more} more like this)" if more else ""))
    return tuple(told.values())


def _kind(note: str) -> str:
    """A note without its numbers."""
    return "".join(c for c in note if not c.isdigit())


def _steady(time: Array, pseudorange: Array) -> Array:
    """Pseudoranges (epochs, s) without the steps of whole milliseconds in the receiver's clock.

    Such a step is 300 km in all satellites at once; what their motion and the clock's drift add in a minute is less
    than a quarter of that. Over longer gaps nothing can be said, and nothing is done.
    """
    rows = np.flatnonzero(np.isfinite(pseudorange).any(axis=1))
    change = np.diff(pseudorange[rows], axis=0)
    near = (np.diff(time[rows]) <= 60.0) & (np.isfinite(change).sum(axis=1) >= 3)
    steps = np.zeros(len(pseudorange))
    if near.any():
        steps[rows[1:][near]] = np.rint(np.nanmedian(change[near], axis=1) / _MILLISECOND)
    return np.asarray(pseudorange - _MILLISECOND * np.cumsum(steps)[:, None])
