"""Columns of a recording: thinned so that extremes stay, and written as JSON, CSV or Parquet."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ftcore import Simulation
from server.encoding import to_json

Array = NDArray[np.float64]
Decimation = Literal["none", "samples", "envelope"]

CELLS = 50_000
"""Most numbers in one frame of a stream."""


@dataclass(frozen=True)
class Columns:
    """Time and signals, SI; NaN where there is no value."""

    time: Array
    signals: Mapping[str, Array]
    decimation: Decimation = "none"
    resolution: Sequence[Mapping[str, float]] = ()

    def json(self) -> bytes:
        """The JSON document of the API; NaN and infinity become null."""
        document = {
            "time": self.time,
            "signals": dict(self.signals),
            "decimation": self.decimation,
            "resolution": self.resolution,
        }
        return to_json(document)


def rows_for(signals: int) -> int:
    """How many rows a frame of so many signals may have."""
    return max(300, CELLS // max(1, signals))


def columns(
    simulation: Simulation,
    names: Sequence[str],
    start: float | None = None,
    end: float | None = None,
    points: int | None = None,
) -> Columns:
    """Columns of run 0 between two times, in at most about ``points`` rows.

    The rows where a signal has an extreme are kept as they are, as long as they are few enough; with many signals
    nearly every row is some signal's extreme, and then the envelope is given.

    Raises:
        KeyError: unknown signal; the message lists near misses.
    """
    full = simulation.recording.time
    lo = 0 if start is None else int(np.searchsorted(full, start - 1e-9))
    hi = len(full) if end is None else int(np.searchsorted(full, end + 1e-9))
    resolution = simulation.resolution
    if points is None or hi - lo <= points:
        time, found = simulation.columns(list(names), start, end)
        return Columns(time, found, "none", resolution)
    if len(names) <= 8:
        time, found = simulation.columns(list(names), start, end, points)
        if len(time) <= 2 * points:
            return Columns(time, found, "samples", resolution)
    time, found = simulation.columns(list(names), start, end)
    time, found = envelope(time, found, points)
    return Columns(time, found, "envelope", resolution)


def envelope(time: Array, signals: Mapping[str, Array], points: int) -> tuple[Array, dict[str, Array]]:
    """Two rows per span of time: each signal's least and greatest value of the span, in the order they came.

    The times are the first and the last of the span, so an extreme may stand up to one span beside its moment.
    NaN counts only where a span has nothing else.
    """
    spans = max(1, points // 2)
    edges = np.unique(np.linspace(0, len(time), spans + 1).astype(int))
    starts, stops = edges[:-1], edges[1:]
    shared = np.empty(2 * len(starts))
    shared[0::2], shared[1::2] = time[starts], time[stops - 1]
    thinned = {}
    for name, values in signals.items():
        least, greatest = np.where(np.isnan(values), np.inf, values), np.where(np.isnan(values), -np.inf, values)
        low, high = np.minimum.reduceat(least, starts), np.maximum.reduceat(greatest, starts)
        span = np.repeat(np.arange(len(starts)), stops - starts)
        index = np.arange(len(values))
        at_low = np.minimum.reduceat(np.where(least == low[span], index, len(values)), starts)
        at_high = np.minimum.reduceat(np.where(greatest == high[span], index, len(values)), starts)
        rises = at_low <= at_high
        both = np.empty(2 * len(starts))
        both[0::2], both[1::2] = np.where(rises, low, high), np.where(rises, high, low)
        nothing = np.repeat(np.isinf(low) & np.isinf(high) & (low > high), 2)
        both[nothing] = np.nan
        thinned[name] = both
    return shared, thinned


def table(simulation: Simulation, names: Sequence[str] | None, start: float | None, end: float | None) -> Any:
    """An Arrow table of run 0: time and the signals in SI; the unit shown to a person is in each field's metadata."""
    import pyarrow as pa

    wanted = list(simulation.signals) if names is None else list(names)
    time, found = simulation.columns(wanted, start, end)
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"})]
    fields += [pa.field(n, pa.float64(), metadata={"display_unit": simulation.signals[n].unit}) for n in wanted]
    return pa.Table.from_arrays([pa.array(time), *(pa.array(found[n]) for n in wanted)], schema=pa.schema(fields))


def csv(arrow: Any) -> bytes:
    """A table as CSV with a header line, full precision."""
    import pyarrow.csv as writer

    sink = io.BytesIO()
    writer.write_csv(arrow, sink)
    return sink.getvalue()


def parquet(arrow: Any) -> bytes:
    """A table as a Parquet file."""
    import pyarrow.parquet as writer

    sink = io.BytesIO()
    writer.write_table(arrow, sink)
    return sink.getvalue()
