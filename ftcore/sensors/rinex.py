"""Logs of real receivers: RINEX 2 and 3 observation and navigation files.

:mod:`ftcore.sensors.rinex_text` checks that a file is whole and keeps the GPS records; georinex reads the numbers from
what it kept. Every file that cannot be read is refused by one sentence, :class:`LogError`.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.sensors import broadcast, rinex_text
from ftcore.sensors.broadcast import Ephemerides
from ftcore.sensors.rinex_text import NAVIGATION, OBSERVATION, LogError, Observations, refusal

Array = NDArray[np.float64]

__all__ = ["LogError", "ObservationLog", "parse", "read", "restrict"]

PRNS: Final = 32
MAX_OBSERVATION_BYTES: Final = 20_000_000
MAX_NAVIGATION_BYTES: Final = 5_000_000
MAX_EPOCHS: Final = 3600
_BLOCK: Final = 40
"""Epochs that georinex is given at a time: its RINEX 3 reader takes a time that grows with the square."""
_GPS_EPOCH: Final = np.datetime64("1980-01-06T00:00:00", "ns")
_WEEK: Final = 604800.0
_MILLISECOND: Final = 1e-3 * earth.SPEED_OF_LIGHT

_folder: Path | None = None


@dataclass(frozen=True)
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
    """

    start: str
    interval: float
    week_seconds: Array
    pseudorange: Array
    satellites: Array
    clock: Array
    ionosphere: Array | None
    approximate: Array | None

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
    """The log of two files' contents. Raises LogError."""
    observed = rinex_text.observations(rinex_text.decode(observation, OBSERVATION), MAX_EPOCHS)
    ephemerides = _ephemerides(rinex_text.navigation(rinex_text.decode(navigation, NAVIGATION)))
    stamps, pseudorange = _pseudoranges(observed)
    seconds, interval, pseudorange, week = _grid(stamps, pseudorange, observed.interval)
    position, clock = broadcast.satellites(ephemerides, seconds, pseudorange)
    located = np.isfinite(position[..., 0])
    if (located.sum(axis=1) >= 4).sum() == 0:
        raise LogError(
            f"the two files do not belong together: the observations begin at {_text(seconds[0])} and end at "
            f"{_text(seconds[-1])}, the ephemerides are of {_text(ephemerides.toe.min())} to "
            f"{_text(ephemerides.toe.max())}"
        )
    log = ObservationLog(
        start=_text(seconds[0]),
        interval=interval,
        week_seconds=seconds - week * _WEEK,
        pseudorange=_steady(seconds, np.where(located, pseudorange, np.nan)),
        satellites=position,
        clock=clock,
        ionosphere=ephemerides.ionosphere,
        approximate=observed.position,
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


def _georinex() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import georinex
    except ImportError:
        raise LogError(
            "reading a receiver's log needs the package georinex, which is not installed: install ftlab[rinex]"
        ) from None
    return georinex


def _load(text: str, what: str) -> Any:
    """georinex on a text that was checked. What it still cannot read is a fault of the file."""
    georinex = _georinex()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return georinex.load(io.StringIO(text), use={"G"})
    except Exception as error:  # whatever a reader of a foreign format may raise is one thing here: unreadable
        raise refusal(what, f"cannot be read: it is corrupt ({type(error).__name__})") from None


def _pseudoranges(observed: Observations) -> tuple[Array, Array]:
    """Times (epochs,) on the GPS scale [s] and pseudoranges (epochs, 32)."""
    stamps, rows = [], []
    for first in range(0, len(observed.epochs), _BLOCK):
        data = _load(observed.header + "".join(observed.epochs[first : first + _BLOCK]), OBSERVATION)
        values = np.full((data.time.size, PRNS), np.nan)
        columns = [int(str(name)[1:]) - 1 for name in data.sv.values]
        kept = [i for i, column in enumerate(columns) if 0 <= column < PRNS]
        values[:, [columns[i] for i in kept]] = data[observed.code].values[:, kept]
        stamps.append(_seconds(data.time.values))
        rows.append(values)
    pseudorange = np.concatenate(rows)
    # A receiver that has lost a satellite may log a zero.
    return np.concatenate(stamps), np.where(pseudorange > 1e6, pseudorange, np.nan)


def _grid(stamps: Array, pseudorange: Array, nominal: float | None) -> tuple[Array, float, Array, float]:
    """Times on an even grid, the interval, pseudoranges there, and the GPS week of the first epoch."""
    order = np.argsort(stamps, kind="stable")
    stamps, pseudorange = stamps[order], pseudorange[order]
    steps = np.diff(stamps)
    steps = steps[steps > 1e-3]
    interval = round(float(np.median(steps)), 2) if len(steps) else float(nominal or 1.0)
    if interval < 0.01:
        raise refusal(OBSERVATION, "has more than 100 epochs a second")
    place = np.round((stamps - stamps[0]) / interval).astype(np.int64)
    if place[-1] >= MAX_EPOCHS:
        raise refusal(OBSERVATION, f"spans {place[-1] + 1} epochs of {interval:g} s; at most {MAX_EPOCHS} are read")
    seconds = stamps[0] + interval * np.arange(place[-1] + 1.0)
    grid = np.full((len(seconds), PRNS), np.nan)
    seconds[place], grid[place] = stamps, pseudorange
    return seconds, interval, grid, float(np.floor(stamps[0] / _WEEK))


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


def _ephemerides(text: str) -> Ephemerides:
    data = _load(text, NAVIGATION)
    missing = [name for name in broadcast.FIELDS if name not in data]
    if missing:
        raise refusal(NAVIGATION, f"cannot be read: it lacks {missing[0]}")
    fields = np.stack([np.asarray(data[name].values, dtype=np.float64) for name in broadcast.FIELDS])
    epoch, column = np.nonzero(np.isfinite(fields).any(axis=0))
    if not len(epoch):
        raise refusal(NAVIGATION, "holds no ephemeris of a GPS satellite")
    rows = fields[:, epoch, column]
    if not np.isfinite(rows).all():
        raise refusal(NAVIGATION, "is corrupt: an ephemeris lacks some of its numbers")
    values = dict(zip(broadcast.FIELDS, rows, strict=True))
    toc = _seconds(data.time.values)[epoch]
    toe = values["Toe"] + _WEEK * np.round((toc - values["Toe"]) / _WEEK)
    sane = (values["sqrtA"] > 1000.0) & (values["Eccentricity"] >= 0.0) & (values["Eccentricity"] < 0.3)
    if not sane.all():
        raise refusal(NAVIGATION, "is corrupt: it holds an orbit that no GPS satellite can have")
    ionosphere = data.attrs.get("ionospheric_corr_GPS")
    names = [str(data.sv.values[i]) for i in column]
    return Ephemerides(
        prn=np.array([int(name[1:3]) for name in names]),
        toc=toc,
        toe=toe,
        week_second=values["Toe"],
        values=values,
        ionosphere=None if ionosphere is None else np.asarray(ionosphere, dtype=np.float64),
    )


def _seconds(times: NDArray[Any]) -> Array:
    return np.asarray((times.astype("datetime64[ns]") - _GPS_EPOCH).astype(np.int64) * 1e-9)


def _text(seconds: float) -> str:
    moment = _GPS_EPOCH + np.timedelta64(round(float(seconds) * 1000.0), "ms")
    return str(moment.astype("datetime64[s]")).replace("T", " ")
