"""No two lines of a chart look alike, whatever their roles, and areas are told apart by colour and hatch."""

from __future__ import annotations

from typing import Any

from .lab import Lab

LOOKS = """async (systems) => {
  const { style } = await import('/static/traces.js');
  const drawn = (c) => (c.kind === 'time' && c.traces.length <= 6) || c.stacked;
  return systems.flatMap((system) => system.charts.filter(drawn).map((chart) => ({
    chart: `${system.id}/${chart.id}`,
    looks: chart.traces.map((t) => [style(chart, t).color, style(chart, t).dash, t.role === 'threshold']),
  })));
}"""


def test_no_two_lines_of_a_chart_look_alike(lab: Lab) -> None:
    lab.without_scene()
    systems: list[Any] = [lab.rest("GET", f"/systems/{one['id']}") for one in lab.rest("GET", "/systems")]
    charts = lab.page.evaluate(LOOKS, systems)
    assert len(charts) > 60
    for chart in charts:
        looks = [tuple(look) for look in chart["looks"]]
        assert len(set(looks)) == len(looks), chart
        colours = [look[0] for look in looks if not look[2]]
        if len(colours) <= 5:
            assert len(set(colours)) == len(colours), chart
