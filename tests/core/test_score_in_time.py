"""The score judges in time: who was wronged is decided by what was wrong at that moment, not before and not after."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest, chi2

from ftcore.faults import Acted
from ftcore.score import FaultScore, IsolationScore, Score, intervals
from ftcore.score import TestScore as AlarmScore
from tests.written_flight import RECOVERY, Flight


def alarms_of(score: Score, name: str, subject: str) -> AlarmScore:
    (found,) = [t for t in score.tests if (t.name, t.subject) == (name, subject)]
    return found


def isolations_of(score: Score, subject: str) -> IsolationScore:
    (found,) = [i for i in score.isolations if i.subject == subject]
    return found


def only_fault(score: Score) -> FaultScore:
    (found,) = score.faults
    return found


# ---- wrong isolations are judged at the moment they happen


def test_given_a_sound_gyro_is_isolated_when_it_fails_later_then_it_was_wronged_all_the_same() -> None:
    flight = Flight().fault("imu.gyro.1x", 20.0, 40.0).isolate("imu.gyro.3", 25.0, 42.0)
    assert only_fault(flight.score()).wrong_share == 1.0
    score = flight.fault("imu.gyro.3x", 60.0).score()
    assert [f.wrong_isolations for f in score.faults] == [["imu.gyro.3"], []]
    assert isolations_of(score, "imu.gyro.3").count == 1


def test_given_a_culprit_is_isolated_again_within_the_recovery_window_then_it_is_not_wronged() -> None:
    flight = Flight().fault("cns.attitude.roll", 20.0, 40.0)
    flight.isolate("cns", 22.0, 45.0).isolate("cns", 45.0 + RECOVERY, 70.0)
    score = flight.score()
    assert isolations_of(score, "cns").count == 0
    assert score.recovery == RECOVERY


def test_given_a_culprit_is_isolated_again_after_the_recovery_window_then_it_is_wronged() -> None:
    flight = Flight().fault("cns.attitude.roll", 20.0, 40.0)
    flight.isolate("cns", 22.0, 45.0).isolate("cns", 46.0 + RECOVERY, 70.0)
    (wrong,) = isolations_of(flight.score(), "cns").first
    assert (wrong.time, wrong.run, wrong.calm) == (46.0 + RECOVERY, 0, True)


def test_given_an_aid_is_isolated_before_its_fault_acts_then_it_is_wronged() -> None:
    score = Flight().fault("cns.attitude.roll", 20.0).isolate("cns", 19.0, 30.0).score()
    assert isolations_of(score, "cns").count == 1
    assert only_fault(score).isolation is not None
    assert only_fault(score).isolated == []


@pytest.mark.parametrize(
    ("channel", "subject", "wronged"),
    [
        ("gps.pseudorange.C1", "gps", False),
        ("gps.pseudorange.C1", "gps.C1", False),
        ("gps.pseudorange.C1", "gps.C2", True),
        ("gps.position.all", "gps.C2", False),
        ("imu.gyro.1x", "imu.gyro.1", False),
        ("imu.gyro.1x", "imu.gyro.3", True),
        ("imu.gyro.1x", "gps", True),
        ("altimeter.height.up", "gps", True),
        ("altimeter.height.up", "altimeter", False),
    ],
)
def test_a_fault_explains_its_sensor_its_part_and_the_whole_of_it(channel: str, subject: str, wronged: bool) -> None:
    score = Flight().fault(channel, 20.0).isolate(subject, 22.0, 30.0).score()
    fault = only_fault(score)
    assert fault.wrong_isolations == ([subject] if wronged else [])
    assert fault.isolated == ([] if wronged else [subject])
    assert fault.isolated_share == (0.0 if wronged else 1.0)
    assert isolations_of(score, subject).count == int(wronged)


def test_an_innocent_star_tracker_that_is_thrown_out_long_after_shows_in_the_strip() -> None:
    flight = Flight(seconds=3600).fault("gps.position.all", 1200.0, 1260.0).isolate("gps", 1201.0, 1262.0)
    flight.isolate("cns", 2130.0, 2400.0)
    score = flight.score()
    (item,) = [h for h in score.headline if h.label == "False isolations"]
    assert item.value == 1.0
    assert "Star tracker at 2130 s" in item.note
    assert "sensor-hours" in item.note
    cns = isolations_of(score, "cns")
    assert cns.hours == pytest.approx((3600 - 270) / 3600)
    assert cns.calm == 1


def test_given_a_fault_that_pauses_then_it_excuses_nobody_meanwhile_not_even_once_it_acts_again() -> None:
    flight = Flight(seconds=100).fault("gps.pseudorange.C1", 10.0)
    acted = flight.acted["f1"]
    pause = (np.array([20.0]), np.array([70.0]))  # the satellite set and rose again
    flight.acted["f1"] = Acted(acted.first, acted.last, acted.epochs, acted.now, (pause,))
    for start in (20.0 + RECOVERY, 45.0, 70.0):
        flight.isolate("gps", start, start + 1.0)
    assert [w.time for w in isolations_of(flight.score(), "gps").first] == [45.0]


def test_pauses_of_a_fault_are_remembered_if_they_are_long() -> None:
    acted = Acted.never(2)
    for time in range(1, 11):
        acted = acted.after(float(time), np.array([time in (2, 3, 5, 9), time == 4]))
    ((before, after),) = acted.pauses
    np.testing.assert_array_equal(before, [5.0, np.nan])
    np.testing.assert_array_equal(after, [9.0, np.nan])
    assert acted.epochs.tolist() == [4, 1]


# ---- found, missed, already in alarm


def test_given_a_test_in_alarm_at_onset_then_it_is_neither_found_by_delay_nor_missed() -> None:
    flight = Flight(runs=4).fault("gps.position.all", 50.0)
    flight.alarm("residual", "gps", 45.0, 60.0, run=0)  # already in alarm
    flight.alarm("residual", "gps", 45.0, 47.0, run=1).alarm("residual", "gps", 53.0, 60.0, run=1)  # found
    flight.alarm("residual", "gps", 55.0, 60.0, run=2)  # found
    fault = only_fault(flight.score())
    outcome = fault.alarms["residual"]
    assert (outcome.after_onset.count, outcome.already.count, outcome.missed.count) == (2, 1, 1)
    assert outcome.delay == 4.0
    assert fault.alarmed_share["residual"] == 0.75, "one of four was missed, no more"


def test_given_a_test_in_alarm_at_onset_in_a_single_run_then_the_strip_says_already_in_alarm() -> None:
    score = Flight().fault("gps.position.all", 50.0).alarm("residual", "gps", 45.0, 60.0).score()
    item = score.headline[0]
    assert item.value is None
    assert item.note == "already in alarm: residual test"


def test_given_only_a_baselines_test_notices_then_the_system_has_not_found_the_fault() -> None:
    score = Flight().fault("cns.attitude.roll", 50.0).alarm("old", "cns", 52.0, 60.0).score()
    assert only_fault(score).time_to_alarm["old"] == 2.0
    assert "not noticed by any test" in only_fault(score).words
    assert (score.headline[0].value, score.headline[0].note) == (None, "not noticed yet")


def test_given_a_subject_isolated_at_onset_then_it_is_neither_isolated_for_it_nor_missed() -> None:
    outcome = only_fault(Flight().fault("cns.attitude.roll", 50.0).isolate("cns", 40.0, 70.0).score()).isolation
    assert outcome is not None
    assert (outcome.after_onset.count, outcome.already.count, outcome.missed.count) == (0, 1, 0)
    assert outcome.delay is None


def test_delays_count_from_the_first_epoch_in_which_the_fault_acted_in_each_run() -> None:
    flight = Flight(runs=3).fault("cns.attitude.roll", 20.0, first=[20.0, 30.0, np.nan])
    for run, time in enumerate((22.0, 36.0, 40.0)):
        flight.alarm("residual", "cns", time, 60.0, run).isolate("cns", time + 1.0, 60.0, run)
    fault = only_fault(flight.score())
    assert fault.time_to_alarm["residual"] == 4.0  # median of 2 and 6
    assert fault.time_to_isolate == 5.0
    assert fault.first_acted == 25.0
    assert (fault.acted.count, fault.acted.of) == (2, 3)
    assert fault.isolation is not None
    assert fault.isolation.after_onset.of == 2
    assert fault.isolated_share == 1.0
    assert "2 of 3 runs" in fault.words


def test_readmission_counts_from_the_end_of_the_fault_in_the_runs_that_were_out_then() -> None:
    flight = Flight(runs=3).fault("cns.attitude.roll", 20.0, 40.0)
    flight.isolate("cns", 22.0, 46.0, run=0).isolate("cns", 22.0, 30.0, run=1).isolate("cns", 22.0, 101.0, run=2)
    fault = only_fault(flight.score())
    assert fault.time_to_readmit == 6.0
    assert fault.readmission is not None
    assert (fault.readmission.count, fault.readmission.of) == (1, 2)


def test_given_the_fault_is_not_over_then_nothing_is_said_of_readmission() -> None:
    flight = Flight(seconds=30).fault("cns.attitude.roll", 20.0, 40.0, first=[20.0]).isolate("cns", 22.0, 31.0)
    fault = only_fault(flight.score())
    assert (fault.time_to_readmit, fault.readmission) == (None, None)


def test_given_a_fault_that_never_acted_then_it_is_neither_found_nor_missed_and_says_why() -> None:
    flight = Flight(runs=2).fault("gps.pseudorange.C1", 20.0, first=[np.nan, np.nan])
    flight.isolate("gps", 25.0, 60.0).alarm("residual", "gps", 22.0, 60.0)
    score = flight.score(silent={"f1": "C1 is not in view"})
    fault = only_fault(score)
    assert fault.words == "never acted: C1 is not in view"
    assert (fault.alarms, fault.isolation, fault.isolated, fault.wrong) == ({}, None, [], None)
    assert (fault.isolated_share, fault.wrong_share, fault.alarmed_share) == (None, None, {})
    assert {h.label: (h.value, h.note) for h in score.headline[:2]} == {
        "Fault found after": (None, fault.words),
        "Isolated after": (None, fault.words),
    }
    assert isolations_of(score, "gps").count == 1, "what never acted excuses nobody"
    assert alarms_of(score, "residual", "gps").alarms == 38


def test_given_another_fault_is_found_then_the_silent_one_is_not() -> None:
    flight = Flight().fault("gps.pseudorange.C1", 20.0, first=[np.nan]).fault("cns.attitude.roll", 30.0)
    items = flight.alarm("residual", "cns", 31.0, 90.0).isolate("cns", 32.0, 90.0).score().headline
    assert (items[0].label, items[0].value) == ("Fault found after", 1.0)
    assert "1 other never acted" in items[0].note


# ---- false alarms: per subject, over the whole flight


def test_false_alarms_count_before_between_and_after_faults() -> None:
    flight = Flight(seconds=200).fault("gps.position.all", 50.0, 60.0).fault("gps.position.all", 120.0, 130.0)
    for start in (10.0, 55.0, 65.0, 100.0, 125.0, 180.0):
        flight.alarm("residual", "gps", start, start + 1)
    gps = alarms_of(flight.score(), "residual", "gps")
    assert gps.alarms == 3  # at 10, 100 and 180 s; 55 and 125 in faults, 65 in the recovery window
    excused = 2 * (10 + RECOVERY)  # 50 to 59 s the first acts, 60 to 69 s its recovery, the second alike
    assert gps.epochs == 200 - excused


def test_alarms_on_one_aid_count_while_another_is_faulty() -> None:
    score = Flight().fault("gps.position.all", 20.0).alarm("residual", "cns", 50.0, 60.0).score()
    cns = alarms_of(score, "residual", "cns")
    assert (cns.alarms, cns.epochs, cns.stretches, cns.clustered) == (10, 100, 1, True)
    assert "1 stretch" in cns.words
    assert "wider" in cns.words


def test_alarms_that_an_inertial_fault_drives_stand_apart_and_isolating_for_them_is_wrong() -> None:
    score = Flight().fault("imu.gyro.1x", 20.0).alarm("residual", "gps", 30.0, 40.0).isolate("gps", 35.0, 50.0).score()
    gps = alarms_of(score, "residual", "gps")
    assert (gps.alarms, gps.epochs) == (0, 19)
    assert (gps.reached_alarms, gps.reached_epochs) == (10, 81)
    assert only_fault(score).wrong_isolations == ["gps"]


def test_alarms_on_a_gyro_whose_sibling_failed_stand_apart() -> None:
    score = Flight().fault("imu.gyro.1x", 20.0).alarm("parity", "imu.gyro.2", 30.0, 40.0).score()
    assert alarms_of(score, "parity", "imu.gyro.2").alarms == 0
    assert alarms_of(score, "parity", "imu.gyro.2").reached_alarms == 10
    assert alarms_of(score, "parity", "imu.gyro").reached_epochs == 0, "the whole cluster is explained by its gyro"


def test_runs_are_judged_each_by_its_own_fault() -> None:
    flight = Flight(runs=2).fault("gps.position.all", 20.0, first=[20.0, np.nan])
    for run in (0, 1):
        flight.alarm("residual", "gps", 50.0, 51.0, run).isolate("gps", 50.0, 51.0, run)
    score = flight.score()
    gps = alarms_of(score, "residual", "gps")
    assert (gps.alarms, gps.epochs) == (1, 19 + 100)
    assert (gps.runs.count, gps.runs.of) == (1, 2)
    assert [w.run for w in isolations_of(score, "gps").first] == [1]


def test_a_batch_that_does_not_begin_at_run_0_is_scored_alike() -> None:
    flight = Flight(runs=2).fault("cns.attitude.roll", 20.0).isolate("cns", 22.0, 60.0, run=1).isolate("gps", 5.0, 9.0)
    moved = [e.model_copy(update={"run": e.run + 7}) for e in flight._events()]
    there = flight.score()
    flight._events = lambda: moved  # type: ignore[method-assign]
    moved_score = flight.score(first_run=7)
    assert moved_score.rows.runs.tolist() == [7, 8]
    (wrong,) = isolations_of(moved_score, "gps").first
    assert wrong.run == 7, "a run keeps its number, so that scores of several batches merge"
    wrong.run = 0
    assert moved_score.model_dump() == there.model_dump()


# ---- intervals


@pytest.mark.parametrize(("count", "of"), [(0, 10), (9, 10), (10, 10), (29, 7194), (1, 1), (0, 1), (500, 1000)])
def test_shares_have_the_interval_of_clopper_and_pearson(count: int, of: int) -> None:
    exact = binomtest(count, of).proportion_ci(0.95, method="exact")
    assert intervals.of_share(count, of) == pytest.approx((exact.low, exact.high), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("count", [0, 1, 13])
def test_rates_have_the_exact_interval_of_a_poisson_count(count: int) -> None:
    low, high = intervals.of_rate(count, 2.0)
    assert high == pytest.approx(chi2.ppf(0.975, 2 * count + 2) / 4.0)
    assert low == pytest.approx(chi2.ppf(0.025, 2 * count) / 4.0 if count else 0.0)


@pytest.mark.parametrize(("count", "of"), [(-1, 3), (4, 3), (0, 0)])
def test_a_share_that_cannot_be_is_refused(count: int, of: int) -> None:
    with pytest.raises(ValueError, match="no share"):
        intervals.of_share(count, of)


def test_every_share_of_a_score_names_its_denominator_and_its_interval() -> None:
    flight = Flight(runs=10).fault("imu.gyro.1x", 20.0, 40.0)
    for run in range(9):
        flight.isolate("imu.gyro.3", 25.0, 42.0, run)
    fault = only_fault(flight.score())
    assert fault.wrong is not None
    assert fault.wrong.words == "9 of 10 runs in which it acted (95 %: 55.5 to 99.7 %)"
    assert (fault.wrong.low, fault.wrong.high) == pytest.approx((0.55498, 0.99747), abs=1e-5)
