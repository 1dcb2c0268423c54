"""Plotly figures of charts and signals, from the declarations that the page draws."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape as escaped
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.description import Chart, Trace, drawable
from ftcore.names import choose, unknown
from ftcore.notebook.flown import Flown
from ftcore.notebook.looks import Theme, faint, look, theme_of
from ftcore.notebook.marks import KINDS_OF_MARKS, Stretch, stretches
from ftcore.notebook.moments import moment

Array = NDArray[np.float64]

escape = partial(escaped, quote=False)
"""Plotly reads text as HTML, of which it knows little: quotes stay as they are."""
ALONG = 32
"""Letters that fit along the upward axis of a chart."""
ROW = 260
"""Height of a chart [px]."""
WORDS = {"fault": "fault", "alarm": "alarm", "isolated": "isolated"}


def figure(flight: Flown, what: Sequence[str], run: int, start: float | None, end: float | None, theme: str) -> Any:
    """The figure; see :meth:`ftcore.notebook.Notebook.plot`."""
    try:
        from plotly import graph_objects
    except ImportError as error:
        raise ImportError("plot() needs the package plotly, which cannot be imported: pip install plotly") from error
    if not 0 <= run < flight.runs:
        raise ValueError(f"there is no run {run}; this flight has {flight.runs}, from 0 on")
    charts = found(flight, what)
    colours = theme_of(theme)
    alone = [chart for chart in charts if chart.kind != "time"]
    names = list(dict.fromkeys(name for chart in charts for name in chart.signals()))
    time, columns = flight.recording.columns(names, start, end, run=run)
    if not len(time):
        raise ValueError(
            f"nothing is recorded there; the flight is at {flight.now:g} s of {flight.duration:g} s: advance() first"
        )
    shown = {name: values / units.factor(flight.signals[name].unit) for name, values in columns.items()}
    if alone and len(charts) > 1:
        raise ValueError(f"{alone[0].title!r} is not drawn over time, so it is drawn alone: plot({alone[0].id!r})")
    number = flight.first_run + run
    title = flight.scenario.title if flight.runs == 1 else f"{flight.scenario.title}, run {number}"
    if alone:
        drawn = moment(alone[0], time, shown, colours)
    else:
        happened = stretches(flight.events, number, flight.description)
        drawn = over_time(charts, time, shown, happened, colours)
    drawn["layout"] |= {
        "title": {"text": escape(title), "x": 0.0, "xanchor": "left", "font": {"size": 15}},
        "font": {"color": colours.ink, "size": 12},
        "paper_bgcolor": colours.panel,
        "plot_bgcolor": colours.panel,
        "hoverlabel": {"bgcolor": colours.panel, "font": {"color": colours.ink}},
    }
    return graph_objects.Figure(**drawn)


def found(flight: Flown, what: Sequence[str]) -> list[Chart]:
    """The charts that are meant by titles, ids, words of titles, or names and patterns of signals.

    Raises:
        ValueError: nothing of that name, or several charts; near misses are named.
    """
    charts = drawable(flight.description.charts, flight.signals)
    if not what:
        opened = [chart for chart in charts if chart.shown and chart.kind == "time"] or list(charts[:1])
        if not opened:
            raise ValueError("no chart can be drawn from what is recorded; see Simulation(signals=[...])")
        return opened
    picked: list[Chart] = []
    loose: list[str] = []
    for name in what:
        chart = _chart(charts, name)
        if chart is not None:
            picked.append(chart)
            continue
        try:
            loose += [list(flight.signals)[i] for i in choose(list(flight.signals), [name])]
        except ValueError:
            known = [*(c.title for c in charts), *(c.id for c in charts), *flight.signals]
            raise ValueError(unknown("chart or signal", name, known)) from None
    return [*picked, *_loose(flight, list(dict.fromkeys(loose)))]


def _chart(charts: Sequence[Chart], name: str) -> Chart | None:
    """One chart by id, title or words of its title; None if there is none. Raises ValueError for several."""
    wanted = name.strip().lower()
    for chart in charts:
        if wanted == chart.id.lower():
            return chart
    same = [chart for chart in charts if wanted == chart.title.lower()]
    words = [chart for chart in charts if wanted and all(word in chart.title.lower() for word in wanted.split())]
    hits = same or words
    if len(hits) > 1:
        raise ValueError(f"{name!r} may be {', '.join(f'{c.title} ({c.id})' for c in hits[:6])}; say which by its id")
    return hits[0] if hits else None


def _loose(flight: Flown, names: Sequence[str]) -> list[Chart]:
    """Signals that were named by themselves: a chart for those of each unit."""
    by_unit: dict[str, list[str]] = {}
    for name in names:
        by_unit.setdefault(flight.signals[name].unit, []).append(name)
    charts = []
    for unit, members in by_unit.items():
        traces = tuple(Trace(signal=name, label=name) for name in members)
        title = flight.signals[members[0]].label if len(members) == 1 else "Signals"
        charts.append(Chart(id=members[0], title=title, unit=unit, group="", traces=traces))
    return charts


def over_time(
    charts: Sequence[Chart], time: Array, columns: dict[str, Array], happened: Sequence[Stretch], theme: Theme
) -> dict[str, Any]:
    """Charts one below the other over the same time, and at the bottom what happened.

    Args:
        time: ``(epochs,)`` [s].
        columns: signal -> values ``(epochs,)`` in the unit that a person is shown.
        happened: stretches of faults, alarms and isolations.
    """
    first, last = float(time[0]), float(time[-1])
    marks = _clipped(happened, first, last)
    lanes = [kind for kind in KINDS_OF_MARKS if any(s.kind == kind for s in marks)]
    heights = [1.0] * len(charts) + ([0.08 + 0.09 * len(lanes)] if lanes else [])
    gap = 0.11 / len(heights)
    unit = (1.0 - gap * (len(heights) - 1)) / sum(heights)
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"showlegend": True, "hovermode": "x unified", "shapes": [], "annotations": []}
    top = 1.0
    for i, height in enumerate(heights):
        axis, bottom = str(i + 1) if i else "", max(0.0, top - height * unit)
        common = {"gridcolor": theme.grid, "zerolinecolor": theme.edge, "linecolor": theme.edge}
        y: dict[str, Any] = common | {"domain": [bottom, top], "anchor": f"x{axis}"}
        x: dict[str, Any] = common | {"anchor": f"y{axis}", "range": [first, last if last > first else first + 1.0]}
        x |= {"title": {"text": "time"}} if i == len(heights) - 1 else {"showticklabels": False}
        x |= {"ticksuffix": " s"} | ({"matches": "x"} if i else {})
        if i < len(charts):
            drawn = _lines(charts[i], time, columns, axis, theme)
            data += drawn
            if not drawn:
                place = {"xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5 * (bottom + top)}
                layout["annotations"].append(
                    place | {"text": f"no value from {first:g} to {last:g} s", "showarrow": False}
                )
            y |= _upward(charts[i])
            layout["shapes"] += [
                {
                    "type": "rect",
                    "xref": f"x{axis}",
                    "yref": f"y{axis} domain",
                    "x0": s.start,
                    "x1": s.end,
                    "y0": 0,
                    "y1": 1,
                    "fillcolor": faint(theme.fault, 0.09),
                    "line": {"width": 0},
                    "layer": "below",
                }
                for s in marks
                if s.kind == "fault"
            ]
        else:
            data += _lane(marks, lanes, axis, theme)
            y |= {"tickvals": list(range(len(lanes))), "ticktext": [WORDS[kind] for kind in lanes], "showgrid": False}
            y |= {"range": [len(lanes) - 0.5, -0.5], "zeroline": False}
        layout[f"xaxis{axis}"], layout[f"yaxis{axis}"] = x, y
        top = bottom - gap
    layout["height"] = int(90 + ROW * sum(heights))
    return {"data": data, "layout": layout}


def _upward(chart: Chart) -> dict[str, Any]:
    """The upward axis of a chart: title with unit, scale, and words for numbers."""
    unit = "" if chart.unit == "1" else f", {chart.unit}"
    axis: dict[str, Any] = {"title": {"text": folded(f"{chart.title}{unit}")}, "type": chart.scale}
    if chart.levels:
        axis |= {"tickvals": list(range(len(chart.levels))), "ticktext": [escape(level) for level in chart.levels]}
    return axis


def folded(text: str) -> str:
    """A title in lines that fit along an axis."""
    return "<br>".join(escape(part) for part in wrap(text, ALONG))


def _lines(chart: Chart, time: Array, columns: dict[str, Array], axis: str, theme: Theme) -> list[dict[str, Any]]:
    """Lines of a chart, the band of 3 sigma below its line."""
    unit = "" if chart.unit == "1" else f" {chart.unit}"
    on: dict[str, Any] = {"xaxis": f"x{axis}", "yaxis": f"y{axis}", "legendgroup": chart.id, "x": time}
    heading = {"legendgrouptitle": {"text": escape(chart.title)}}
    drawn: list[dict[str, Any]] = []
    for trace in chart.traces:
        values = columns[trace.signal]
        if not np.isfinite(values).any():
            continue
        style = look(chart, trace, theme)
        if trace.sigma is not None:
            band = 3.0 * columns[trace.sigma]
            edge = on | {"type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
            edge |= {"showlegend": False}
            drawn.append(edge | {"y": -band})
            drawn.append(edge | {"y": band, "fill": "tonexty", "fillcolor": faint(str(style["color"]), 0.14)})
        line = dict(style) | {"shape": "hv" if chart.levels else "linear"}
        name = escape(f"{trace.label} ±3σ" if trace.sigma is not None else trace.label)
        told = {"name": name, "hovertemplate": f"%{{y:.4g}}{escape(unit)}", **heading}
        stack = {"stackgroup": chart.id} if chart.stacked else {}
        drawn.append(on | {"type": "scatter", "mode": "lines", "y": values, "line": line, **told, **stack})
    return drawn


def _clipped(happened: Sequence[Stretch], first: float, last: float) -> list[Stretch]:
    """The part that is in the picture, ends included."""
    inside = []
    for s in happened:
        start, end = max(s.start, first), min(last if s.end is None else s.end, last)
        if start <= end:
            inside.append(Stretch(s.kind, s.label, start, end))
    return inside


def _lane(marks: Sequence[Stretch], lanes: Sequence[str], axis: str, theme: Theme) -> list[dict[str, Any]]:
    """What happened: a lane for each kind, a thick line for each stretch, told when pointed at."""
    drawn = []
    colours = {"fault": theme.fault, "alarm": theme.alarm, "isolated": theme.isolated}
    for place, kind in enumerate(lanes):
        x: list[float | None] = []
        text: list[str] = []
        for s in marks:
            if s.kind == kind:
                assert s.end is not None
                x += [s.start, s.end, None]
                text += [escape(f"{s.label}, {s.start:g} to {s.end:g} s")] * 2 + [""]
        drawn.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": WORDS[kind],
                "xaxis": f"x{axis}",
                "yaxis": f"y{axis}",
                "x": x,
                "y": [None if value is None else place for value in x],
                "text": text,
                "hovertemplate": "%{text}<extra></extra>",
                "line": {"color": colours[kind], "width": 7},
                "marker": {"color": colours[kind], "size": 7, "symbol": "line-ns"},
                "showlegend": False,
            }
        )
    return drawn
