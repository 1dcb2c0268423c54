"""The yardstick: what a figure in seconds becomes on a machine that is slower, faster, or now this and now that."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator

import pytest
from rich.console import Console

from tests.bench import measure
from tests.bench.__main__ import figure_table, pace_line
from tests.bench.measure import BATCH, CALLS, REFERENCE, SURROUNDED, TURN, Figure, Taken, best, taken


class Machine:
    """A processor that needs `slower(time)` seconds for what takes one second on the reference machine."""

    def __init__(self, slower: Callable[[float], float]) -> None:
        self.slower = slower
        self.time = 0.0
        self.looks = 0

    def process_time(self) -> float:
        return self.time

    def yardstick(self) -> float:
        self.looks += 1
        length = SURROUNDED * REFERENCE * self.slower(self.time)
        self.time += length
        return length

    def work(self, pieces: int, seconds: float) -> Iterator[None]:
        """Pieces that take so long on the reference machine."""
        for _ in range(pieces):
            self.time += seconds * self.slower(self.time)
            yield


Built = Callable[[Callable[[float], float]], Machine]


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Built:
    """What this process believes to run on."""

    def built(slower: Callable[[float], float]) -> Machine:
        made = Machine(slower)
        monkeypatch.setattr(measure.time, "process_time", made.process_time)
        monkeypatch.setattr(measure, "yardstick", made.yardstick)
        return made

    return built


def test_given_a_machine_half_as_fast_then_half_of_the_seconds_count(machine: Built) -> None:
    slow = machine(lambda _: 2.0)
    found = taken(slow.work(pieces=50, seconds=0.02))
    assert found.seconds == pytest.approx(2.0), "the yardstick's own time is nobody's"
    assert found.pace == pytest.approx(2.0)
    assert found.at_reference == pytest.approx(1.0)


@pytest.mark.parametrize("slower", [1.0, 0.5])
def test_given_a_machine_as_fast_or_faster_then_the_seconds_stand(machine: Built, slower: float) -> None:
    found = taken(machine(lambda _: slower).work(pieces=50, seconds=0.02))
    assert found.pace == pytest.approx(slower)
    assert found.seconds == pytest.approx(slower)
    assert found.at_reference == pytest.approx(found.seconds)


def test_given_a_machine_that_changes_its_speed_then_each_stretch_is_divided_by_its_own(machine: Built) -> None:
    """Twice as slow for a second, then as fast as the reference: wrong by half a turn at most, at the change."""
    found = taken(machine(lambda t: 2.0 if t < 1.0 else 1.0).work(pieces=200, seconds=0.005))
    assert found.seconds == pytest.approx(1.5, abs=0.02)
    assert found.at_reference == pytest.approx(1.0, abs=0.005)


def test_given_short_pieces_then_the_yardstick_waits_for_its_turn(machine: Built) -> None:
    one = machine(lambda _: 1.0)
    taken(one.work(pieces=1000, seconds=TURN / 10.0))
    assert 80 <= one.looks <= 102


def test_given_several_tries_then_the_one_that_took_least_counts_and_not_the_one_with_a_disturbed_yardstick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tries = [Taken(3.0, 1.5), Taken(2.4, 1.0), Taken(4.0, 2.5), Taken(2.5, 1.0)]
    left = iter(tries)
    monkeypatch.setattr(measure, "taken", lambda _: next(left))
    assert best(lambda: iter(()), tries=4) == tries[1]


def test_given_a_figure_in_seconds_then_it_is_judged_at_the_reference_pace_and_a_ratio_as_it_is() -> None:
    assert Figure("", "", 4.0, "s", 3.0, "most", at_reference=2.5).met
    assert not Figure("", "", 4.0, "s", 3.0, "most", at_reference=3.5).met
    assert not Figure("", "", 4.0, "x", 5.0, "least").met


def test_given_the_table_then_it_shows_the_pace_and_both_figures() -> None:
    flight = Figure("flight", "real-time factor", 150.0, "x", 200.0, "least", at_reference=225.0)
    out = io.StringIO()
    Console(file=out, width=250).print(figure_table([pace_line([1.4, 1.6], 3.9e-6, 11e9), flight]))
    first, last = (line for line in out.getvalue().splitlines() if "pace: how" in line or "flight" in line)
    for words in ("1.5 x", "1.40 to 1.60", "3.9 us", "11 GFlop/s in a batch; there 2.5 us, 25 GFlop/s"):
        assert words in first
    for words in ("150 x", "225 x", ">= 200 x", "met"):
        assert words in last


def test_given_a_yardstick_then_half_of_it_is_calls_and_half_arithmetic_by_the_figures_of_the_design_notes() -> None:
    """2.5 us a call, and 25 GFlop/s, which is 0.74 us a product."""
    assert pytest.approx(CALLS * 2.5e-6, rel=0.02) == 0.5 * REFERENCE
    assert pytest.approx(BATCH * 2.0 * 21**3 / 25e9, rel=0.02) == 0.5 * REFERENCE
