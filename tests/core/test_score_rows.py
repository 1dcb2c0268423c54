"""A score is made from rows, so that the scores of some runs and of others merge to the score of all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftcore import Fault, Scenario, Simulation
from ftcore.score import Rows, Score, compute, merge, summarise
from ftcore.score.rows import merged
from tests.written_flight import AIDS, GYROS, Flight

ZHANG = Scenario.load("zhang-1992-visible")
KIM = Scenario.load("kim-2005-mismatch")


def cuts(runs: int) -> st.SearchStrategy[list[list[int]]]:
    """Runs divided into several stretches, in any order."""
    places = st.sets(st.integers(1, runs - 1), min_size=1)
    stretches = places.map(lambda at: [list(part) for part in np.split(np.arange(runs), sorted(at))])
    return stretches.flatmap(st.permutations)


@st.composite
def written(draw: st.DrawFn) -> Flight:
    """Any flight of 6 runs: faults that act in some of them, alarms and isolations anywhere."""
    flight = Flight(seconds=60, runs=6)
    moments = st.integers(1, 59)
    for channel in draw(
        st.lists(st.sampled_from(["gps.position.all", "gps.pseudorange.C1", "imu.gyro.1x"]), max_size=3)
    ):
        start = float(draw(moments))
        first = [draw(st.sampled_from([start, start + 2.0, np.nan])) for _ in range(6)]
        flight.fault(channel, start, draw(st.sampled_from([None, start + 20.0])), first)
    for _ in range(draw(st.integers(0, 12))):
        start, run = float(draw(moments)), draw(st.integers(0, 5))
        test, subjects = draw(st.sampled_from([("residual", AIDS), ("parity", GYROS)]))
        flight.alarm(test, draw(st.sampled_from(subjects)), start, start + draw(st.integers(1, 9)), run)
    for _ in range(draw(st.integers(0, 8))):
        start, run = float(draw(moments)), draw(st.integers(0, 5))
        flight.isolate(draw(st.sampled_from([*AIDS, *GYROS[1:]])), start, start + draw(st.integers(1, 30)), run)
    return flight


@pytest.fixture(scope="module")
def zhang() -> Simulation:
    return Simulation(ZHANG, runs=8).advance(until=55.0)


@given(flight=written(), parts=cuts(6))
@settings(max_examples=25, deadline=None)
def test_given_any_flight_when_its_runs_are_scored_in_parts_then_these_merge_to_the_whole(
    flight: Flight, parts: list[list[int]]
) -> None:
    whole, together = flight.score(), merge([flight.score_of(part) for part in parts])
    assert together == whole
    assert together.rows == whole.rows


@given(parts=cuts(8))
@settings(max_examples=12, deadline=None)
def test_given_a_flown_batch_when_its_rows_are_divided_then_their_scores_merge_to_the_bit(
    zhang: Simulation, parts: list[list[int]]
) -> None:
    whole = zhang.score()
    scores = [summarise(whole.rows.of_runs(part)) for part in parts]
    assert [score.runs for score in scores] == [len(part) for part in parts]
    assert merge(scores) == whole


@given(parts=cuts(8))
@settings(max_examples=4, deadline=None)
def test_given_a_flown_batch_when_each_part_is_scored_by_itself_then_these_merge_to_the_bit(
    zhang: Simulation, parts: list[list[int]]
) -> None:
    whole = zhang.score()
    assert merge([_of_part(zhang, np.array(part)) for part in parts]) == whole


def _of_part(simulation: Simulation, places: np.ndarray) -> Score:
    """Score of some runs, from their part of the flight alone."""
    first = int(places[0])
    acted = {
        id: replace(a, first=a.first[places], last=a.last[places], epochs=a.epochs[places], now=a.now[places])
        for id, a in simulation.acted.items()
    }
    assert not any(a.pauses for a in acted.values())
    return compute(
        simulation._book.of_runs(places),
        [event for event in simulation.events if event.run in places or event.run < 0],
        [live.fault for live in simulation.faults],
        simulation.description,
        simulation._channels,
        acted,
        {str(live.fault.id): live.silent_because for live in simulation.faults},
        first,
        simulation.period,
        simulation.document(),
    )


def test_given_runs_that_fly_in_batches_of_their_own_then_their_scores_merge_to_that_of_one_batch() -> None:
    whole = Simulation(ZHANG, runs=5).advance(until=40.0).score()
    flown = [Simulation(ZHANG, runs=n, first_run=k).advance(until=40.0).score() for k, n in ((3, 2), (0, 3))]
    together = merge(flown)
    assert together.rows.runs.tolist() == [0, 1, 2, 3, 4]
    assert [f.words for f in together.faults] == [f.words for f in whole.faults]
    assert together.isolations == whole.isolations
    for name, estimator in whole.estimators.items():
        # The linear algebra of another batch may round otherwise.
        assert together.estimators[name].position.rms == pytest.approx(estimator.position.rms, rel=1e-6)


def test_there_is_a_row_per_run_and_fault_with_units(zhang: Simulation) -> None:
    rows = zhang.score().rows
    assert len(rows.faults) == 8 * 2
    assert rows.faults["run"].tolist() == np.repeat(np.arange(8), 2).tolist()
    assert rows.faults["fault"].tolist() == ["accelerometer", "satellite"] * 8
    assert {rows.faults.units[n] for n in rows.faults if n.endswith("_delay")} == {"s"}
    assert rows.faults.units["worst.fused.error.position.up"] == "m"
    assert rows.faults.dtypes["acted"].kind == "b"
    assert rows.flights["run"].tolist() == list(range(8))
    alarm = next(e for e in zhang.events if (e.kind, e.subject, e.run) == ("test.alarmed", "gps", 3) and e.time >= 50.0)
    delay = rows.of_fault("satellite")[f"alarm_delay.{alarm.detail['test']}"][3]
    assert delay == alarm.time - rows.of_fault("satellite")["first_acted"][3]


def test_medians_shares_and_errors_are_those_of_the_rows(zhang: Simulation) -> None:
    score = zhang.score()
    satellite, rows = score.faults[1], score.rows.of_fault("satellite")
    assert satellite.acted.count == np.count_nonzero(rows["acted"])
    assert satellite.time_to_isolate == np.nanmedian(rows["isolation_delay"])
    worst = np.abs(zhang["fused.error.position.up"][zhang.time >= 50.0]).max(axis=0)
    np.testing.assert_array_equal(rows["worst.fused.error.position.up"], worst)
    error = np.stack([zhang[f"fused.error.position.{axis}"] for axis in ("east", "north", "up")])
    settled = (error**2).sum(axis=0)[zhang.time >= 20.0]
    assert score.estimators["fused"].position.rms == pytest.approx(np.sqrt(settled.mean()), rel=1e-12)
    assert score.estimators["fused"].position.worst == np.sqrt(settled.max())


def test_rows_cannot_be_written_to(zhang: Simulation) -> None:
    rows = zhang.score().rows
    with pytest.raises(ValueError, match="read-only"):
        rows.flights["run"][0] = 7


def test_a_score_without_a_fault_merges_too() -> None:
    calm = KIM.model_copy(update={"faults": ()})
    parts = [Simulation(calm, runs=2, first_run=k).advance(until=0.2).score() for k in (0, 2)]
    assert merge(parts).runs == 4
    assert merge([merge(parts[:1]), parts[1]]) == merge(parts)


AT_ONCE = KIM.model_copy(update={"faults": (Fault(id="f", channel="imu.gyro.1x", kind="bias", magnitude=1, start=0),)})
Flown = dict[str, Any]


@pytest.mark.parametrize(
    ("said", "flown"),
    [
        ("no scores to merge", []),
        ("run 1 is in two of the scores", [{"runs": 2}, {"first_run": 1}]),
        ("two systems, redundant-imu and sins-gps-doppler", [{}, {"scenario": ZHANG, "first_run": 1}]),
        ("of 0.1 s and of 0.2 s", [{}, {"until": 0.2, "first_run": 1}]),
        ("other faults", [{}, {"scenario": AT_ONCE, "first_run": 1}]),
        ("two scenarios, seeds", [{}, {"seed": 99, "first_run": 1}]),
    ],
)
def test_scores_that_do_not_belong_together_are_refused(said: str, flown: list[Flown]) -> None:
    def rows(scenario: Scenario = KIM, until: float = 0.1, **more: int) -> Rows:
        return Simulation(scenario, **more).advance(until=until).score().rows

    with pytest.raises(ValueError, match=said):
        merged([rows(**each) for each in flown])


def test_what_is_not_there_is_refused_by_name(zhang: Simulation) -> None:
    rows = zhang.score().rows
    with pytest.raises(KeyError, match="no fault 'gyro'; there are accelerometer, satellite"):
        rows.of_fault("gyro")
    with pytest.raises(KeyError, match="no run 8; there are 8, 0 to 7"):
        rows.of_runs([2, 8])
    with pytest.raises(ValueError, match="read from a document"):
        _ = Score.model_validate(zhang.score().model_dump()).rows
