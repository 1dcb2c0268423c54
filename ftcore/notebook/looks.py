"""How lines look: by role, then by place among their peers, as in the page (frontend/traces.js, styles/tokens.css)."""

from __future__ import annotations

from dataclasses import dataclass

from ftcore.description import Chart, Trace

THEMES = {
    "dark": {
        "panel": "#202124",
        "grid": "#303236",
        "edge": "#6d737b",
        "ink": "#e6e6e6",
        "dim": "#a3a9b0",
        "series": ("#56b4e9", "#e69f00", "#2bb58c", "#9aa7ff", "#c9cdd2"),
        "fault": "#e8701a",
        "alarm": "#f0e442",
        "isolated": "#d48ab4",
        "ok": "#2bb58c",
    },
    "light": {
        "panel": "#ffffff",
        "grid": "#e6e8eb",
        "edge": "#7a828b",
        "ink": "#1d1f21",
        "dim": "#565c63",
        "series": ("#0072b2", "#a85400", "#00734f", "#4a4fc4", "#5b6168"),
        "fault": "#c24e00",
        "alarm": "#7d6900",
        "isolated": "#953b70",
        "ok": "#00734f",
    },
}
_DASHES = ("solid", "5px,2px", "2px,2px", "8px,3px,2px,3px")
_LIMITS = ("7px,4px", "2px,5px", "12px,3px,2px,3px")
_APART = ("protected", "local", "unprotected", "threshold")


@dataclass(frozen=True)
class Theme:
    """Colours by what they mean."""

    panel: str
    grid: str
    edge: str
    ink: str
    dim: str
    series: tuple[str, ...]
    fault: str
    alarm: str
    isolated: str
    ok: str


def theme_of(name: str) -> Theme:
    """The colours of a theme. Raises ValueError for an unknown one."""
    if name not in THEMES:
        raise ValueError(f"no theme {name!r}; there are {', '.join(THEMES)}")
    return Theme(**THEMES[name])  # type: ignore[arg-type]


def look(chart: Chart, trace: Trace, theme: Theme) -> dict[str, object]:
    """Colour, width and dash of a line, as Plotly takes them."""
    peers = [t for t in chart.traces if (t.role == trace.role if trace.role in _APART else t.role not in _APART)]
    place = peers.index(trace)
    protected = sum(t.role == "protected" for t in chart.traces)
    local = sum(t.role == "local" for t in chart.traces)
    shades = theme.series
    if trace.role == "protected":
        return {"color": shades[place % len(shades)], "width": 1.6, "dash": _DASHES[place % len(_DASHES)]}
    if trace.role == "local":
        return {"color": shades[((protected or 1) + place) % len(shades)], "width": 1.1, "dash": _DASHES[1 + place % 3]}
    if trace.role == "unprotected":
        return {"color": theme.dim, "width": 1.2, "dash": "2px,2px"}
    if trace.role == "threshold":
        return {"color": theme.ink, "width": 1.0, "dash": _LIMITS[place % len(_LIMITS)]}
    after = protected + local
    turn = (place + after) // len(shades) + (1 + place % 2 if after else 0)
    return {"color": shades[(place + after) % len(shades)], "width": 1.2, "dash": _DASHES[turn % len(_DASHES)]}


def faint(colour: str, opacity: float) -> str:
    """A colour ``#rrggbb``, see-through."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"
