"""What a chart may declare: a kind is refused what it cannot draw, and names every signal that it needs."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from ftcore import catalogue
from ftcore.description import Chart, Region, Trace

REGION = Region(label="here", health="ok", corners=(("zero", "zero"), ("limit", "limit"), ("zero", "limit")))


def chart(**changes: Any) -> Chart:
    given = {"id": "c", "title": "C", "unit": "m", "group": "g", "traces": (Trace(signal="a", label="a"),)}
    return Chart(**(given | changes))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"kind": "xy"}, "needs `across`"),
        ({"kind": "sky"}, "needs `across`"),
        ({"kind": "bars", "stacked": True}, "over time"),
        ({"kind": "bars", "scale": "log"}, "over time"),
        ({"kind": "bars", "levels": ("off", "on")}, "over time"),
        ({"limit": "l"}, "for kind xy"),
        ({"kind": "xy", "traces": (Trace(signal="a", label="a", across="b"),), "regions": (REGION,)}, "need a limit"),
    ],
)
def test_a_chart_that_cannot_be_drawn_is_refused(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        chart(**changes)


def test_a_chart_names_each_signal_that_it_needs_once() -> None:
    cloud = Trace(signal="level", label="p", across="error", code="class", sigma="s")
    same = Trace(signal="level", label="q", across="error")
    drawn = chart(kind="xy", limit="alert", regions=(REGION,), traces=(cloud, same))
    assert drawn.signals() == ("level", "s", "error", "class", "alert")


def test_a_line_across_bars_needs_no_x() -> None:
    limit = Trace(signal="l", label="limit", role="threshold")
    assert chart(kind="bars", traces=(Trace(signal="a", label="a"), limit)).signals() == ("a", "l")


@pytest.mark.parametrize("system", catalogue.systems(), ids=lambda s: s.id)
def test_every_chart_is_drawn_from_signals_and_scene_items_that_exist(system: Any) -> None:
    signals, items = {s.name for s in system.signals}, {i.id for i in system.scene}
    for drawn in system.charts:
        assert set(drawn.signals()) <= signals
        assert {t.item for t in drawn.traces if t.item} <= items
    for item in system.scene:
        assert set(item.trail or ()) <= signals


@pytest.mark.parametrize("system", catalogue.systems(), ids=lambda s: s.id)
def test_one_look_at_all_charts_stays_within_what_a_stream_carries(system: Any) -> None:
    shown = {name for drawn in system.charts if drawn.shown for name in drawn.signals()}
    assert len(shown) <= 500
