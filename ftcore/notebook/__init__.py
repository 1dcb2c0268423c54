"""At home in a notebook: what a flight looks like there, its charts, its tables, and a bar that shows progress.

Plotly, pandas, polars, xarray and tqdm are imported when they are asked for, never before.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore import frames, units
from ftcore.description import drawable
from ftcore.names import choose
from ftcore.notebook import overview
from ftcore.notebook.flown import Flown
from ftcore.notebook.progress import Progress, progressing

__all__ = ["Notebook", "Progress", "progressing"]


class Notebook:
    """What a simulation offers in a notebook."""

    def __repr__(self: Flown) -> str:
        """Scenario, time, runs and faults in one line."""
        return overview.line(self)

    def _repr_html_(self: Flown) -> str:
        return overview.card(self)

    def _ipython_key_completions_(self: Flown) -> list[str]:
        """What ``simulation["<tab>`` offers."""
        return list(self.signals)

    @property
    def charts(self: Flown) -> dict[str, str]:
        """Charts that can be drawn from what is recorded: id -> title; see :meth:`plot`.

        >>> from ftcore import Scenario, Simulation
        >>> Simulation(Scenario.load("kim-2005")).charts["height"]
        'Height'
        """
        return {chart.id: chart.title for chart in drawable(self.description.charts, self.signals)}

    def plot(
        self: Flown,
        *what: str,
        run: int = 0,
        start: float | None = None,
        end: float | None = None,
        theme: str = "light",
    ) -> Any:
        """A Plotly figure of charts or signals, with faults, alarms and isolations below.

        Args:
            what: charts by title, id or words of the title, such as ``"altitude error"``; or signals by name or
                pattern. Each chart is a row; all signals of one unit are a row. Nothing: the charts that the page
                opens with.
            run: place of the run in the batch, from 0 on.
            start, end: part of the flight [s]; all of it if absent. Charts of a moment show the end of it.
            theme: ``"light"`` or ``"dark"``.

        Returns:
            A ``plotly.graph_objects.Figure``, in the units that a person is shown.

        Raises:
            ValueError: no chart or signal of that name (near misses are named), no such run, or an empty part.
            ImportError: Plotly is not installed.

        >>> from ftcore import Scenario, Simulation
        >>> figure = Simulation(Scenario.load("zhang-1992-visible")).advance(until=5.0).plot("altitude error")
        >>> figure.layout.yaxis.title.text
        'Altitude error, m'
        """
        from ftcore.notebook import plots

        return plots.figure(self, what, run, start, end, theme)

    def to_pandas(self: Flown, signals: Iterable[str] | None = None) -> Any:
        """The recording as a ``pandas.DataFrame``, a row per epoch and run: time, run, signals in SI.

        Args:
            signals: names or patterns; None: all that are recorded.

        Raises:
            ValueError: a name that no recorded signal has, with near misses.
            ImportError: pandas is not installed.

        >>> from ftcore import Scenario, Simulation
        >>> flown = Simulation(Scenario.load("zhang-1992-visible"), runs=2).advance(until=3.0)
        >>> frame = flown.to_pandas(["fused.error.position.*"])
        >>> frame.shape, frame.attrs["units"]["fused.error.position.up"]
        ((6, 6), 'm')
        """
        return frames.to_pandas(*_long(self, signals))

    def to_polars(self: Flown, signals: Iterable[str] | None = None) -> Any:
        """The recording as a ``polars.DataFrame``; as :meth:`to_pandas`. Raises ValueError, ImportError."""
        return frames.to_polars(_long(self, signals)[0])

    def to_xarray(self: Flown, signals: Iterable[str] | None = None) -> Any:
        """The recording as an ``xarray.Dataset`` over time and run, in SI, with units and labels as attributes.

        Raises:
            ValueError: a name that no recorded signal has, with near misses.
            ImportError: xarray is not installed.
        """
        names = _chosen(self, signals)
        known = {n: {"units": units.si(self.signals[n].unit), "long_name": self.signals[n].label} for n in names}
        recording = self.recording
        return frames.to_xarray(recording.time.copy(), _numbers(self), {n: recording[n] for n in names}, known)


def _chosen(flight: Flown, signals: Iterable[str] | None) -> list[str]:
    recorded = list(flight.signals)
    return [recorded[i] for i in choose(recorded, signals)]


def _numbers(flight: Flown) -> NDArray[np.int64]:
    """Numbers of the runs ``(runs,)``."""
    return np.arange(flight.first_run, flight.first_run + flight.runs, dtype=np.int64)


def _long(flight: Flown, signals: Iterable[str] | None) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Columns of a row per epoch and run, and their units, SI."""
    names, recording = _chosen(flight, signals), flight.recording
    columns: dict[str, NDArray[Any]] = {
        "time": np.repeat(recording.time, flight.runs),
        "run": np.tile(_numbers(flight), len(recording)),
    }
    columns |= {name: recording[name].ravel() for name in names}
    return columns, {"time": "s", "run": "1"} | {name: units.si(flight.signals[name].unit) for name in names}
