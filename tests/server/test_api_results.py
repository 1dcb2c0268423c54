"""Series, score, report: what a flight gave, in every form."""

from __future__ import annotations

import io
import json
import math
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from hypothesis import given
from hypothesis import settings as limits
from hypothesis import strategies as st
from rest_lab import Flight, client_of

from server.negotiation import choose
from server.series import envelope
from server.settings import Settings

ERROR = "fused.error.position.x"


@pytest.fixture
def flown(flight: Flight) -> Flight:
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "outliers", "magnitude": 40.0, "rate": 0.05})
    flight.advance(until=50.0)
    return flight


def test_series_are_columns_of_the_time_asked_for(flown: Flight) -> None:
    series = flown.get("/series", signals=f"{ERROR},gap", start=1.0, end=2.0)
    assert series["time"] == pytest.approx([1.0 + 0.1 * k for k in range(11)])
    assert len(series["signals"][ERROR]) == 11
    assert series["signals"]["gap"] == [None] * 11
    assert (series["decimation"], series["resolution"]) == ("none", [])


def test_all_signals_are_given_if_none_is_named(flown: Flight) -> None:
    assert set(flown.get("/series", end=1.0)["signals"]) == {signal.name for signal in toy.DESCRIPTION.signals}


def test_thinned_series_of_one_signal_are_samples_with_its_extremes(flown: Flight) -> None:
    full = flown.get("/series", signals=ERROR)
    thin = flown.get("/series", signals=ERROR, points=40)
    assert thin["decimation"] == "samples"
    assert len(thin["time"]) <= 42
    samples = dict(zip(full["time"], full["signals"][ERROR], strict=True))
    assert all(samples[t] == v for t, v in zip(thin["time"], thin["signals"][ERROR], strict=True))
    assert max(thin["signals"][ERROR]) == max(full["signals"][ERROR])
    assert min(thin["signals"][ERROR]) == min(full["signals"][ERROR])


def test_thinned_series_of_many_signals_are_no_longer_than_asked(client: TestClient) -> None:
    flight = Flight(client, toy.scenario(duration=600.0))
    flight.advance()
    names = [f"extra.{i}" for i in range(100)]
    thin = flight.get("/series", signals=",".join(names), points=300)
    assert thin["decimation"] == "envelope"
    assert len(thin["time"]) <= 300
    full = flight.get("/series", signals="extra.7")
    assert max(thin["signals"]["extra.7"]) == max(full["signals"]["extra.7"])


def test_a_long_flight_says_where_its_history_was_thinned() -> None:
    with client_of(Settings(max_epochs=100)) as small:
        flight = Flight(small)
        flight.advance(until=30.0)
        series = flight.get("/series", signals=ERROR)
    assert len(series["time"]) <= 100
    assert series["resolution"][0]["every"] > 0.1


@pytest.mark.parametrize("accept", ["text/csv", "text/csv;q=0.9, application/json;q=0.1"])
def test_series_as_csv(flown: Flight, accept: str) -> None:
    answer = flown.client.get(f"{flown.path}/series?signals={ERROR},gap", headers={"accept": accept})
    assert answer.headers["content-type"].startswith("text/csv")
    assert "attachment" in answer.headers["content-disposition"]
    lines = answer.text.splitlines()
    assert lines[0].replace('"', "") == f"time,{ERROR},gap"
    assert len(lines) == 501


def test_series_as_parquet_holds_every_signal_and_its_unit(flown: Flight) -> None:
    answer = flown.client.get(f"{flown.path}/series", headers={"accept": "application/vnd.apache.parquet"})
    table = pq.read_table(io.BytesIO(answer.content))
    assert table.num_rows == 500
    assert len(table.column_names) == 1 + len(toy.DESCRIPTION.signals)
    assert table.schema.field("fused.error.angle").metadata[b"display_unit"] == b"deg"
    assert table.column(ERROR).to_pylist() == flown.get("/series", signals=ERROR)["signals"][ERROR]


@pytest.mark.parametrize(
    "query", ["start=nan", "end=-1", "points=1", "points=x", "limit=3", "signals=%00", "start=inf"]
)
def test_a_query_that_makes_no_sense_is_refused(flown: Flight, query: str) -> None:
    answer = flown.client.get(f"{flown.path}/series?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["parameter"] == query.partition("=")[0]


def test_the_score_says_what_the_fault_cost(flight: Flight) -> None:
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0, "start": 30.0})
    flight.advance(until=50.0)
    score = flight.get("/score")
    (fault,) = score["faults"]
    assert fault["channel"] == "ruler.position.x"
    assert fault["time_to_alarm"]["size"] < 0.5
    assert fault["alarms"]["size"]["after_onset"]["words"] == "1 of 1 runs in which it acted"
    assert fault["words"].startswith("noticed by size after")
    assert score["headline"]


def test_every_rate_of_the_score_has_its_denominator_and_its_interval(flight: Flight) -> None:
    flight.advance(until=50.0)
    score = flight.get("/score")
    (test,) = score["tests"]
    assert test["epochs"] == 500
    assert test["low"] <= test["false_alarm_rate"] <= test["high"]
    assert f"in {test['epochs']} tests" in test["words"]
    (ruler,) = score["isolations"]
    assert (ruler["count"], ruler["hours"]) == (0, pytest.approx(50.0 / 3600))
    assert ruler["low"] == 0.0 < ruler["high"]
    strip = {item["label"]: item for item in score["headline"]}
    assert strip["False alarms"]["note"].startswith("of 500 tests of sound sensors")
    assert "sensor-hours" in strip["False isolations"]["note"]


def test_a_report_is_one_page_that_needs_nothing_else(flown: Flight) -> None:
    answer = flown.client.get(f"{flown.path}/report")
    assert answer.headers["content-type"].startswith("text/html")
    assert "sandbox" in answer.headers["content-security-policy"]
    page = answer.text
    assert len(page) > 3_000_000  # plotly.js is in it
    assert not re.search(
        r"""<(script|link|img|iframe)[^>]+(src|href)=["']?(?!data:)""", page[:20_000] + page[-200_000:]
    )
    data = page.rpartition('<script type="application/json" id="data">')[2].partition("</script>")[0]
    facts = json.loads(data)
    assert facts["scenario"]["commands"][0]["action"] == "inject"
    assert facts["charts"][0]["columns"][ERROR]
    assert facts["events"][0]["kind"] == "fault.injected"
    assert facts["score"]["tests"][0]["words"]
    assert facts["score"]["isolations"][0]["words"]


def test_a_reports_text_cannot_become_markup(client: TestClient) -> None:
    evil = "</script><script>alert(1)</script>&amp;"
    flight = Flight(client, toy.scenario(summary=evil), title="<b>" + evil)
    page = flight.client.get(f"{flight.path}/report").text
    assert "<script>alert(1)" not in page


@given(
    values=st.lists(st.one_of(st.floats(-1e9, 1e9), st.just(math.nan)), min_size=1, max_size=200),
    points=st.integers(2, 60),
)
@limits(max_examples=60, deadline=None)
def test_an_envelope_keeps_extremes_order_and_bounds(values: list[float], points: int) -> None:
    time_, given_ = np.arange(len(values), dtype=float), np.array(values)
    shared, thin = envelope(time_, {"x": given_}, points)
    assert len(shared) == len(thin["x"]) <= max(2, points)
    assert (np.diff(shared) >= 0).all()
    assert (shared[0], shared[-1]) == (time_[0], time_[-1])
    if np.isfinite(given_).any():
        assert np.nanmax(thin["x"]) == np.nanmax(given_)
        assert np.nanmin(thin["x"]) == np.nanmin(given_)
    else:
        assert np.isnan(thin["x"]).all()


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        ("*/*", "a/b"),
        ("", "a/b"),
        ("c/d", "c/d"),
        ("c/*", "c/d"),
        ("a/b;q=0.1, c/d", "c/d"),
        ("a/b;q=0, */*", "c/d"),
        ("x/y", None),
        ("a/b;q=x", None),
    ],
)
def test_the_media_type_is_the_one_liked_best(accept: str, chosen: str | None) -> None:
    assert choose(accept, ("a/b", "c/d")) == chosen
