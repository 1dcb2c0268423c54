"""The score strip: what it says of one failure, of several, and of whom was wrongly accused."""

from __future__ import annotations

from ftcore import Fault, Scenario, Simulation
from ftcore.score import Headline


def strip(sim: Simulation) -> dict[str, Headline]:
    return {item.label: item for item in sim.score().headline}


def test_given_two_axes_of_one_gyro_when_they_fail_together_then_it_is_one_failure() -> None:
    items = strip(Simulation(Scenario.load("kim-2005")).advance(until=3.0))
    assert items["Fault found after"].value is not None
    assert items["Isolated after"].note == "Gyro 1 named"


def test_given_a_sound_gyro_when_it_is_accused_then_the_strip_says_so() -> None:
    items = strip(Simulation(Scenario.load("kim-2005-conventional")).advance(until=3.0))
    assert items["Isolated after"].note == "Gyro 1 named; wrongly: Gyro 3"


def test_given_several_faults_then_the_strip_counts_who_was_named() -> None:
    sim = Simulation(Scenario.load("zhang-1992-visible")).advance(until=60.0)
    items = strip(sim)
    assert items["Isolated, of 2"].value == 2.0
    assert items["Isolated, of 2"].note == "Accelerometer 3, GPS named"


def test_given_no_fault_then_nothing_is_found_and_every_driving_test_counts() -> None:
    sim = Simulation(Scenario.load("zhang-1992").model_copy(update={"faults": []})).advance(until=5.0)
    items = strip(sim)
    assert items["Fault found after"].value is None
    assert items["Fault found after"].note == "no fault yet"
    assert "tests of sound sensors" in items["False alarms"].note


def test_given_a_fault_then_false_alarms_are_counted_before_it() -> None:
    sim = Simulation(Scenario.load("zhang-1992").model_copy(update={"faults": []})).advance(until=5.0)
    sim.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=1000.0))
    before = sim.score().tests
    after = sim.advance(until=15.0).score().tests
    gps = [(a, b) for a, b in zip(before, after, strict=True) if a.subject == "gps"]
    assert gps
    assert all(a == b for a, b in gps), "alarms under the fault are none of its false ones"
