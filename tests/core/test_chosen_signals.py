"""Only chosen signals are recorded: less memory, the same flight, the same score."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from ftcore import Fault, Scenario, Simulation, history
from ftcore.names import choose, unknown

ZHANG = Scenario.load("zhang-1992-visible")
CHOSEN = ["fused.error.position.*", "test.residual.gps.statistic"]
NAMES = [
    *(f"fused.error.position.{axis}" for axis in ("east", "north", "up", "horizontal")),
    "test.residual.gps.statistic",
]


def flown(signals: Sequence[str] | None, until: float = 32.0, **more: int) -> Simulation:
    return Simulation(ZHANG, runs=2, signals=signals, **more).advance(until=until)


@pytest.fixture(scope="module")
def everything() -> Simulation:
    return flown(None)


@pytest.mark.parametrize("signals", [CHOSEN, []], ids=["some", "none"])
def test_given_any_choice_of_signals_then_flight_events_and_score_are_the_same(
    everything: Simulation, signals: list[str]
) -> None:
    some = flown(signals)
    assert list(some.signals) == (NAMES if signals else [])
    for name in some.signals:
        np.testing.assert_array_equal(some[name], everything[name])
    assert some.events == everything.events
    assert some.score() == everything.score()
    assert some.document() == everything.document()


def test_given_a_choice_when_rewound_forked_and_flown_again_then_the_bits_are_the_same(everything: Simulation) -> None:
    some = flown(CHOSEN)
    branch = some.fork(at=20.0)
    assert branch.signals == some.signals
    for again in (branch.advance(until=32.0), some.rewind(to=15.0).advance(until=32.0)):
        np.testing.assert_array_equal(again.recording.rows, flown(CHOSEN).recording.rows)
        assert again.score() == everything.score()
    again = Simulation(some.document(), runs=2).advance(until=32.0)
    np.testing.assert_array_equal(again[NAMES[0]], everything[NAMES[0]])


def test_given_a_fork_when_it_flies_on_then_the_score_of_the_other_stays() -> None:
    sim = flown(None, until=32.0)
    before = sim.score()
    branch = sim.fork(at=30.0)
    branch.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=300.0))
    branch.advance(until=36.0)
    assert sim.score() == before
    assert branch.score() != before


def test_given_a_bounded_recording_then_the_score_does_not_depend_on_the_choice() -> None:
    bounded = [flown(signals, until=36.0, max_epochs=16) for signals in (None, CHOSEN, [])]
    assert bounded[0].resolution == bounded[1].resolution == bounded[2].resolution != []
    assert bounded[0].score() == bounded[1].score() == bounded[2].score()


def test_given_a_large_batch_when_it_is_rewound_then_the_bits_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "LARGE_BATCH", 2)
    monkeypatch.setattr(history, "CHECKPOINTS", 1)
    sim = flown(CHOSEN, until=12.0)
    assert list(sim._history._states) == [0]
    rows = sim.recording.rows.copy()
    np.testing.assert_array_equal(sim.rewind(to=7.0).advance(until=12.0).recording.rows, rows)


def test_given_a_choice_then_files_hold_it(tmp_path: Path) -> None:
    sim = flown(CHOSEN, until=3.0)
    sim.to_csv(tmp_path / "some.csv")
    head = (tmp_path / "some.csv").read_text().splitlines()[0]
    assert [name.strip('"') for name in head.split(",")] == ["time", "run", *NAMES]


def test_given_a_name_that_no_signal_has_then_it_is_refused_with_near_misses() -> None:
    with pytest.raises(ValueError, match=r"no signal 'fused.error.position.upp'; for instance fused.error.position.up"):
        Simulation(ZHANG, signals=["test.*", "fused.error.position.upp"])
    with pytest.raises(ValueError, match=r"a list of signal names .* \['test.\*'\]"):
        Simulation(ZHANG, signals="test.*")


def test_given_a_signal_that_was_not_chosen_then_the_message_says_how_to_choose_it() -> None:
    sim = flown(CHOSEN, until=1.0)
    with pytest.raises(KeyError, match=r"gps.error.position.up is not recorded; .*signals="):
        sim["gps.error.position.up"]
    with pytest.raises(KeyError, match=r"no signal 'fused.error.position.top'; for instance fused.error.position"):
        sim["fused.error.position.top"]


def test_names_are_chosen_by_name_or_pattern_in_the_order_of_declaration() -> None:
    names = ["a.x", "a.y", "b.x", "b[1]"]
    assert choose(names, None) == [0, 1, 2, 3]
    assert choose(names, []) == []
    assert choose(names, ["*.x", "a.x"]) == [0, 2]
    assert choose(names, ["b[1]"]) == [3], "a name is a name first"
    assert unknown("name", "q", []) == "no name 'q'; there are none"
