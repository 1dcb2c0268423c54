"""One self-contained page about a flight: plots, events, score and scenario, with nothing to load.

The page's template, style and script lie in ``resources``; they and plotly.js are written into it.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from importlib import metadata, resources
from typing import Any

from ftcore import Simulation, units
from ftcore.description import drawable
from ftcore.faults import KINDS
from server import series
from server.encoding import to_json

POINTS = 1200
"""About how many rows each chart is drawn from; extremes are kept."""
MAX_EVENTS = 2000


def gather(simulation: Simulation, title: str) -> dict[str, Any]:
    """Everything the page shows, copied out of the simulation."""
    description, scenario = simulation.description, simulation.scenario
    shown = {signal.name: signal for signal in description.signals}
    charts = []
    for chart in drawable(description.charts, simulation.signals):
        found = series.columns(simulation, list(chart.signals()), points=POINTS)
        columns = {name: values / units.factor(shown[name].unit) for name, values in found.signals.items()}
        charts.append(chart.model_dump(mode="json") | {"time": found.time, "columns": columns})
    operator = [event for event in simulation.events if event.run <= 0]
    return {
        "title": title,
        "ftlab": metadata.version("ftlab"),
        "system": description.title,
        "source": scenario.source or description.source,
        "summary": scenario.summary,
        "seed": simulation.seed,
        "runs": simulation.runs,
        "time": simulation.now,
        "resolution": simulation.resolution,
        "charts": charts,
        "events": [event.model_dump(mode="json") for event in operator[:MAX_EVENTS]],
        "events_left_out": max(0, len(operator) - MAX_EVENTS),
        "deeds": deeds(simulation),
        "score": simulation.score().model_dump(mode="json"),
        "estimators": description.estimators,
        "scenario": simulation.document().model_dump(mode="json", exclude_defaults=True),
    }


def deeds(simulation: Simulation) -> list[tuple[str, float | None, int, str]]:
    """What each fault did: its name, when it first acted in the first run [s], in how many epochs, and why no more."""
    told = []
    for live in simulation.faults:
        fault = live.fault
        first = float(simulation.acted[str(fault.id)].first[0])
        name = f"{fault.id}: {fault.channel} {KINDS[fault.kind].label}"
        told.append((name, None if math.isnan(first) else first, live.acted_epochs, live.silent_because or "acting"))
    return told


def render(facts: dict[str, Any]) -> bytes:
    """The page as HTML."""
    data = to_json(facts).replace(b"<", b"\\u003c")
    parts = {
        b"title": facts["title"].replace("&", "&amp;").replace("<", "&lt;").encode(),
        b"style": _resource("report.css"),
        b"plotly": _plotly(),
        b"script": _resource("report.js"),
        b"data": data,
    }
    # In one pass over the template, so that a title which looks like a place is only a title.
    return re.sub(rb"\{\{(\w+)\}\}", lambda place: parts[place[1]], _resource("report.html"))


def _resource(name: str) -> bytes:
    return (resources.files("server") / "resources" / name).read_bytes()


@lru_cache(maxsize=1)
def _plotly() -> bytes:
    source = (resources.files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    return source.replace(b"</script", b"<\\/script")
