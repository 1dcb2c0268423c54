"""The score strip: what it says of one failure, of several, and of whom was wrongly accused."""

from __future__ import annotations

import numpy as np
import pytest

from ftcore import Fault, Scenario, Simulation
from ftcore.score import Headline


def strip(sim: Simulation) -> dict[str, Headline]:
    return {item.label: item for item in sim.score().headline}


def test_given_two_axes_of_one_gyro_when_they_fail_together_then_it_is_one_failure() -> None:
    items = strip(Simulation(Scenario.load("kim-2005")).advance(until=3.0))
    assert items["Fault found after"].value is not None
    assert items["Isolated after"].note == "Gyro 1 named"


def test_given_a_sound_gyro_when_it_is_accused_then_the_strip_says_so() -> None:
    items = strip(Simulation(Scenario.load("kim-2005-mismatch")).advance(until=8.0))
    assert items["Isolated after"].note == "wrongly: Gyro 3"
    assert items["False isolations"].value == 1.0
    assert items["False isolations"].note.startswith("Gyro 3 at 7.")


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


def test_given_a_fault_then_what_its_tests_say_is_no_false_alarm() -> None:
    sim = Simulation(Scenario.load("zhang-1992").model_copy(update={"faults": []})).advance(until=5.0)
    sim.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=1000.0))
    before = sim.score().tests
    after = sim.advance(until=15.0).score().tests
    gps = [(a, b) for a, b in zip(before, after, strict=True) if a.subject == "gps"]
    assert gps
    assert all(a == b for a, b in gps), "alarms under the fault are none of its false ones"


def mismatched_gyro_1(*more: Fault) -> Simulation:
    """A UKF whose model is so wrong that it blames sound gyro 3 for gyro 1, from 6.5 to 9 s; further faults after."""
    scenario = Scenario.load("kim-2005-mismatch").model_copy(update={"faults": []})
    sim = Simulation(scenario, runs=10, seed=9951)
    for axis in "xy":
        sim.inject(Fault(channel=f"imu.gyro.1{axis}", kind="bias", magnitude=0.05, start=6.5, end=9.0))
    for fault in more:
        sim.inject(fault)
    return sim.advance()


@pytest.mark.long
def test_given_the_victim_fails_later_then_the_wrong_isolation_is_not_forgotten() -> None:
    alone = mismatched_gyro_1().score().faults
    followed = mismatched_gyro_1(Fault(channel="imu.gyro.3x", kind="bias", magnitude=0.05, start=13.0)).score().faults
    # The past cannot depend on the future: the same flight up to 13 s, so the same judgement of it.
    assert [f.wrong for f in followed[:2]] == [f.wrong for f in alone]
    assert all(f.wrong_isolations == ["imu.gyro.3"] and f.wrong_share > 0.5 for f in followed[:2])


@pytest.mark.long
def test_given_a_fault_on_gps_at_20_minutes_then_an_innocent_star_tracker_that_is_thrown_out_shows() -> None:
    sim = Simulation(Scenario.load("yang-2016-scenario-1")).advance(until=1800.0)
    score = sim.score()
    out = [e.time for e in sim.events if (e.kind, e.subject) == ("subsystem.isolated", "cns")]
    (cns,) = [i for i in score.isolations if i.subject == "cns"]
    assert [w.time for w in cns.first] == out[:20], "nothing is ever wrong with the star tracker here"
    tests = [t for t in score.tests if t.subject == "cns" and t.name.startswith("two-propagator")]
    assert tests
    made = {t.name: np.isfinite(sim[f"test.{t.name}.cns.statistic"]).sum() for t in tests}
    assert {t.name: t.epochs for t in tests} == made, "its tests count whenever they are made, GPS faulty or not"
    (item,) = [h for h in score.headline if h.label == "False isolations"]
    assert item.value == sum(i.count for i in score.isolations)
