"""Recording: named signals against time, bounded if asked, never silently thinned.

Rows are SI. A bounded recording that is full keeps every second row of its older half; :attr:`Recording.resolution`
says until when it is how coarse.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Signal
from ftcore.files import replacing
from ftcore.growing import Growing
from ftcore.names import choose, unknown

Array = NDArray[np.float64]


class Recording:
    """Growing table ``(epochs, runs, signals)`` with a time column.

    Args:
        signals: all that the system has; the columns of the rows that are appended.
        runs: how many.
        period: seconds between epochs.
        max_epochs: when so many are in, the older half is thinned. None: unbounded.
        chosen: which of the signals are kept, names or patterns such as ``"test.*"``; None: all.

    Raises:
        ValueError: a bound that is too low, or a name or pattern that no signal has.
    """

    def __init__(
        self,
        signals: Sequence[Signal],
        runs: int,
        period: float,
        max_epochs: int | None = None,
        chosen: Iterable[str] | None = None,
    ) -> None:
        kept = choose([signal.name for signal in signals], chosen)
        self.signals: Mapping[str, Signal] = {signals[i].name: signals[i] for i in kept}
        self.column = {name: i for i, name in enumerate(self.signals)}
        self.period = period
        self.runs = runs
        self._all = [signal.name for signal in signals]
        self._kept = None if len(kept) == len(signals) else np.array(kept, dtype=np.intp)
        self._track = Growing([((runs, len(kept)), np.dtype(np.float64))], max_epochs)

    @property
    def max_epochs(self) -> int | None:
        """Bound on the epochs that are kept; None: unbounded."""
        return self._track.max_epochs

    def append(self, time: float, row: Array) -> None:
        """Add one epoch: ``row`` is ``(runs, signals)``, of all the system's signals."""
        self._track.append(time, row if self._kept is None else row[:, self._kept])

    def length_at(self, time: float) -> int:
        """How many of the recorded epochs are not after ``time``."""
        return int(np.searchsorted(self.time, time + 0.5 * self.period))

    def truncate(self, time: float) -> None:
        """Forget everything after ``time``."""
        self._track.truncate(self.length_at(time))

    def copy_until(self, time: float) -> Recording:
        """An independent recording of everything up to ``time``."""
        twin = object.__new__(Recording)
        twin.__dict__.update(self.__dict__)
        twin._track = self._track.copy(self.length_at(time))
        return twin

    @property
    def time(self) -> Array:
        """Times of the recorded epochs ``(epochs,)``."""
        return self._track.time

    def __getitem__(self, name: str) -> Array:
        """One signal ``(epochs, runs)``. Raises KeyError, naming near misses, for an unknown one."""
        return self._track.array(0)[:, :, self._column_of(name)].copy()

    @property
    def rows(self) -> Array:
        """All signals ``(epochs, runs, signals)``, read only."""
        view = self._track.array(0)
        view.flags.writeable = False
        return view

    def __len__(self) -> int:
        """Recorded epochs."""
        return len(self._track)

    def latest(self) -> dict[str, float]:
        """Last value of every signal of run 0; empty before the first epoch."""
        if not len(self):
            return {}
        return dict(zip(self.column, self._track.array(0)[-1, 0].tolist(), strict=True))

    @property
    def resolution(self) -> list[dict[str, float]]:
        """Where older history is coarser than the epoch: ``[{"until": s, "every": s}, ...]``; empty if nowhere."""
        time = self.time
        if len(time) < 2:
            return []
        step = np.round(np.diff(time) / self.period).astype(int)
        change = np.flatnonzero(np.diff(step)) + 1
        coarse = []
        for start, stop in zip(np.r_[0, change], np.r_[change, len(step)], strict=True):
            if step[start] > 1:
                coarse.append({"until": float(time[stop]), "every": float(step[start] * self.period)})
        return coarse

    def columns(
        self,
        names: Sequence[str],
        start: float | None = None,
        end: float | None = None,
        points: int | None = None,
        run: int = 0,
    ) -> tuple[Array, dict[str, Array]]:
        """Columns of one run between two times.

        With ``points`` every signal keeps its extremes: time is cut into ``points / 2`` buckets, and the rows where any
        signal has its least or greatest value of the bucket survive (the time axis is shared, so there may be more).
        """
        time = self.time
        lo = 0 if start is None else int(np.searchsorted(time, start - 1e-9))
        hi = len(time) if end is None else int(np.searchsorted(time, end + 1e-9))
        picked = [self._column_of(name) for name in names]
        data = self._track.array(0)[lo:hi, run][:, picked]
        time = time[lo:hi].copy()
        if points is not None and len(time) > points:
            keep = decimate(data, points)
            time, data = time[keep], data[keep]
        return time, {name: data[:, i].copy() for i, name in enumerate(names)}

    def _column_of(self, name: str) -> int:
        if name in self.column:
            return self.column[name]
        if name in self._all:
            raise KeyError(f"{name} is not recorded; name it, or a pattern of it, in Simulation(signals=[...])")
        raise KeyError(unknown("signal", name, self.column))


def decimate(data: Array, points: int) -> NDArray[np.intp]:
    """Rows that keep the extremes of every column of ``data (n, columns)``, first and last row included."""
    n = len(data)
    buckets = max(1, points // 2)
    edges = np.linspace(0, n, buckets + 1).astype(int)
    keep = {0, n - 1}
    finite = np.nan_to_num(data)
    for a, b in pairwise(edges.tolist()):
        if b > a:
            keep.update((a + finite[a:b].argmin(axis=0)).tolist())
            keep.update((a + finite[a:b].argmax(axis=0)).tolist())
    return np.array(sorted(keep), dtype=np.intp)


def to_parquet(recording: Recording, path: Any) -> None:
    """Write all signals of all runs as Parquet: columns time, run, then signals in SI; units in the schema metadata.

    The file appears whole or not at all. Raises OSError.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = _long_table(recording)
    fields = []
    for name in table:
        unit = "s" if name == "time" else "" if name == "run" else recording.signals[name].unit
        fields.append(pa.field(name, pa.from_numpy_dtype(table[name].dtype), metadata={"display_unit": unit}))
    arrow = pa.Table.from_arrays([pa.array(v) for v in table.values()], schema=pa.schema(fields))
    with replacing(path) as unfinished:
        pq.write_table(arrow, unfinished)


def to_csv(recording: Recording, path: Any) -> None:
    """Write all signals of all runs as CSV in SI: columns time, run, then signals; full precision.

    The file appears whole or not at all. Raises OSError.
    """
    import pyarrow as pa
    import pyarrow.csv as pv

    arrow = pa.table(_long_table(recording))
    with replacing(path) as unfinished:
        pv.write_csv(arrow, unfinished)


def _long_table(recording: Recording) -> dict[str, NDArray[Any]]:
    rows = recording.rows
    epochs, runs, _ = rows.shape
    table: dict[str, NDArray[Any]] = {
        "time": np.repeat(recording.time, runs),
        "run": np.tile(np.arange(runs), epochs),
    }
    flat = rows.reshape(epochs * runs, -1)
    for name, i in recording.column.items():
        table[name] = np.ascontiguousarray(flat[:, i])
    return table
