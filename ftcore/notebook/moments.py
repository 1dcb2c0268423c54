"""Charts of a moment: the sky, bars, and a plane of two signals, at the last epoch of the part that is drawn."""

from __future__ import annotations

from functools import partial
from html import escape as escaped
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart
from ftcore.notebook.looks import Theme, faint, look

Array = NDArray[np.float64]
Drawn = dict[str, Any]

escape = partial(escaped, quote=False)


def moment(chart: Chart, time: Array, columns: dict[str, Array], theme: Theme) -> Drawn:
    """Data and layout of a chart that is not drawn over time; ``columns`` are in the unit a person is shown."""
    draw = {"sky": _sky, "bars": _bars, "xy": _plane}[chart.kind]
    data, layout = draw(chart, columns, theme)
    when = f"to {time[-1]:g} s" if chart.kind == "xy" else f"at {time[-1]:g} s"
    note = {"text": escape(f"{chart.title}, {when}"), "showarrow": False, "xref": "paper", "yref": "paper"}
    layout.setdefault("annotations", []).append(note | {"x": 0.0, "y": 1.06, "xanchor": "left", "yanchor": "bottom"})
    return {"data": data, "layout": layout | {"showlegend": False, "height": 460}}


def _axis(theme: Theme, title: str, unit: str) -> dict[str, Any]:
    text = title if unit in ("", "1") else f"{title}, {unit}"
    return {"gridcolor": theme.grid, "zerolinecolor": theme.edge, "title": {"text": escape(text)}}


def _sky(chart: Chart, columns: dict[str, Array], theme: Theme) -> tuple[list[Drawn], Drawn]:
    """Satellites above the horizon: north up, east right, the zenith in the middle."""
    places = [(t.label, columns[t.signal][-1], columns[str(t.across)][-1]) for t in chart.traces]
    seen = [(label, up, around) for label, up, around in places if up >= 0.0]
    data = {
        "type": "scatterpolar",
        "mode": "markers+text",
        "text": [escape(label) for label, _, _ in seen],
        "textposition": "middle right",
        "r": [90.0 - up for _, up, _ in seen],
        "theta": [around for _, _, around in seen],
        "customdata": [up for _, up, _ in seen],
        "hovertemplate": "%{text}: elevation %{customdata:.1f}°, azimuth %{theta:.1f}°<extra></extra>",
        "marker": {"color": theme.series[0], "size": 9},
    }
    around = {"direction": "clockwise", "rotation": 90, "tickvals": [0, 90, 180, 270], "ticktext": ["N", "E", "S", "W"]}
    upward = {"range": [0, 90], "tickvals": [30, 60], "ticktext": ["60°", "30°"]}
    grid = {"gridcolor": theme.grid, "linecolor": theme.edge}
    return [data], {"polar": {"bgcolor": theme.panel, "angularaxis": around | grid, "radialaxis": upward | grid}}


def _bars(chart: Chart, columns: dict[str, Array], theme: Theme) -> tuple[list[Drawn], Drawn]:
    """A bar a trace; a threshold is a line at plus and minus its value."""
    present = [t for t in chart.traces if np.isfinite(columns[t.signal][-1])]
    bars = [t for t in present if t.role != "threshold"]
    data = {
        "type": "bar",
        "x": [escape(t.label) for t in bars],
        "y": [columns[t.signal][-1] for t in bars],
        "hovertemplate": f"%{{x}}: %{{y:.4g}}{'' if chart.unit == '1' else ' ' + escape(chart.unit)}<extra></extra>",
        "marker": {"color": theme.series[0]},
    }
    lines = [
        {
            "type": "line",
            "xref": "paper",
            "x0": 0,
            "x1": 1,
            "y0": sign * columns[t.signal][-1],
            "y1": sign * columns[t.signal][-1],
            "line": {"color": theme.ink, "width": 1, "dash": "dash"},
        }
        for t in present
        if t.role == "threshold"
        for sign in (1.0, -1.0)
    ]
    return [data], {"shapes": lines, "xaxis": {}, "yaxis": _axis(theme, chart.title, chart.unit)}


def _plane(chart: Chart, columns: dict[str, Array], theme: Theme) -> tuple[list[Drawn], Drawn]:
    """A point an epoch; regions say what it is to be there."""
    traces = [t for t in chart.traces if t.role != "threshold"]
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": escape(t.label),
            "x": columns[str(t.across)],
            "y": columns[t.signal],
            "marker": {"size": 5, "color": look(chart, t, theme)["color"], "opacity": 0.7},
        }
        for t in traces
    ]
    layout: Drawn = {"xaxis": _axis(theme, chart.across, chart.unit), "yaxis": _axis(theme, chart.upward, chart.unit)}
    limit = float(columns[chart.limit][-1]) if chart.limit is not None else np.nan
    if not np.isfinite(limit):
        return data, layout
    drawn = np.concatenate([columns[name] for t in traces for name in (t.signal, str(t.across))])
    most = float(np.nanmax(drawn)) if np.isfinite(drawn).any() else 0.0
    end = min(2.5 * limit, max(1.3 * limit, 1.05 * most))
    at = {"zero": 0.0, "limit": limit, "end": end}
    shades = {"ok": theme.ok, "suspect": theme.alarm, "faulted": theme.fault, "isolated": theme.isolated}
    layout["shapes"], layout["annotations"] = [], []
    for region in chart.regions:
        corners = [(at[x], at[y]) for x, y in region.corners]
        path = "M" + "L".join(f"{x} {y}" for x, y in corners) + "Z"
        shade = faint(shades.get(region.health, theme.edge), 0.14)
        layout["shapes"].append(
            {"type": "path", "path": path, "fillcolor": shade, "line": {"width": 0}, "layer": "below"}
        )
        x, y = (sum(place) / len(corners) for place in zip(*corners, strict=True))
        layout["annotations"].append({"text": escape(region.label), "showarrow": False, "x": x, "y": y})
    for way in ("xaxis", "yaxis"):
        layout[way]["range"] = [0.0, end]
    return data, layout
