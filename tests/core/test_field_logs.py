"""Files from the field: each folder of tests/field says what it is and what is right; the kinds behind them follow."""

from pathlib import Path

import numpy as np
import pytest

from ftcore import Scenario, Simulation
from ftcore.sensors import rinex
from ftcore.sensors.rinex import LogError, ObservationLog
from ftcore.systems.gps_receiver.logs import log_scenario

FIELD = Path(__file__).parents[1] / "field"


def paths(folder: str, observation: str = "a.15o", navigation: str = "a.15n") -> tuple[str, str]:
    return str(FIELD / folder / observation), str(FIELD / folder / navigation)


def opened(folder: str, observation: str = "a.15o", navigation: str = "a.15n") -> ObservationLog:
    return rinex.read(*paths(folder, observation, navigation))


def flown(*files: str) -> Simulation:
    return Simulation(Scenario.model_validate(log_scenario(*paths(*files)))).advance()


def error(sim: Simulation) -> np.ndarray:
    parts = [sim[f"snapshot.error.position.{part}"] for part in ("east", "north", "up")]
    return np.sqrt(np.sum(np.square(parts), axis=0))[:, 0]


@pytest.fixture(scope="module")
def plain() -> ObservationLog:
    """The log that most of the others were made of."""
    return opened("bom")


# ---- the files themselves


def test_given_a_byte_order_mark_then_it_is_skipped(plain):
    assert (len(plain), plain.interval, plain.start) == (6, 30.0, "2015-07-19 01:20:00")
    assert np.isfinite(plain.pseudorange).sum() == 60
    assert error(flown("bom")).max() < 5.0


@pytest.mark.parametrize(("file", "said"), [("all.15o", "are P1"), ("half.15o", "P1 is read where C1 is blank: in 30")])
def test_given_a_blank_c1_then_p1_is_read_and_said(plain, file, said):
    log = opened("c1-blank-p1-given", file)
    np.testing.assert_array_equal(np.isfinite(log.pseudorange), np.isfinite(plain.pseudorange))
    # The two codes of one signal are a few metres apart at most.
    assert 0.0 < np.nanmax(np.abs(log.pseudorange - plain.pseudorange)) < 5.0
    assert any(said in note for note in log.notes)
    assert error(flown("c1-blank-p1-given", file)).max() < 5.0


def test_given_an_epoch_twice_then_one_is_taken_and_it_is_said(plain):
    log = opened("duplicate-epoch")
    np.testing.assert_array_equal(log.pseudorange, plain.pseudorange)
    assert any("01:21:00 at line 79" in note for note in log.notes)


def test_given_a_new_site_then_the_file_is_refused_at_its_line():
    with pytest.raises(LogError, match=r"event flag 3, a new site at \(-740000.*line 81") as refused:
        opened("event2-3-moving-new-site")
    assert refused.value.part == "observation"


def test_given_a_new_list_of_observables_then_it_is_followed():
    log = opened("event4-new-types")
    assert (np.isfinite(log.pseudorange).sum(axis=1) == 10).all()
    assert any("list of observables changes" in note for note in log.notes)
    assert error(flown("event4-new-types")).max() < 5.0


def test_given_records_of_cycle_slips_then_they_are_passed_over(plain):
    np.testing.assert_array_equal(opened("event6-cycle-slips").pseudorange, plain.pseudorange)


def test_given_a_newer_set_that_is_not_healthy_then_its_satellite_is_not_used():
    sim = flown("health-newer-set")
    assert not np.nan_to_num(sim["used.gps.G29"]).any()
    assert sim["gps.satellites"].min() >= 8
    assert any("G29 in 6 of 6 epochs" in note for note in opened("health-newer-set").notes)


def test_given_glonass_records_of_five_lines_then_the_others_are_read():
    sim = flown("nav-305-glonass", "a.rnx", "a_MN.rnx")
    assert sim.last_epoch == 6
    assert error(sim).max() < 5.0


def test_given_a_full_minute_then_it_is_the_next_one():
    log = opened("seconds-60")
    assert (len(log), log.interval) == (13, 30.0)
    assert log.week_seconds[10] == 3600.0 + 25 * 60.0  # the epoch of 01:24:60
    assert np.isfinite(log.pseudorange[10]).sum() == 10
