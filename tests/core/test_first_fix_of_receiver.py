"""The receiver finds itself whatever one satellite says at first, and gets over a first fix gone wrong."""

import numpy as np
import pytest

from ftcore import Fault, Scenario, Simulation
from ftcore.readings import Group, Readings
from ftcore.sensors import rinex
from ftcore.systems.base import Controls
from ftcore.systems.gps_receiver import LAYOUT
from ftcore.systems.gps_receiver.forms import Log, Parameters, Settings
from ftcore.systems.gps_receiver.navigator import Navigator
from ftcore.systems.gps_receiver.plant import LogPlant
from ftcore.systems.gps_receiver.satellites import SATELLITES, SLOTS
from tests.synthetic_log import ANTENNA, files

MILLISECOND = 299_792.458
EPOCHS = 30
SNAPSHOT, FILTER, COMBINED = 0, 1, 2


@pytest.fixture(scope="module")
def log():
    made = files(EPOCHS, 1.0)
    return rinex.parse(made.observation, made.navigation)


def seen(log) -> np.ndarray:
    """Columns of the satellites that the log has."""
    return np.array([SATELLITES.index(f"G{s + 1:02d}") for s in np.flatnonzero(np.isfinite(log.pseudorange[0]))])


def flown(log, added, masked=None):
    """Errors (epochs, runs, 4) [m] and codes of the estimators.

    ``added (runs, satellites)``: what is wrong with the pseudoranges, in all epochs, or a function of the epoch;
    ``masked``: epoch -> columns that are not there.
    """
    runs = len(added(1) if callable(added) else added)
    p = Parameters(log=Log(observation="o", navigation="n", antenna=tuple(ANTENNA)))
    assert p.log is not None
    plant, navigator = LogPlant(log, p.log, runs), Navigator(p, runs, log.interval, LAYOUT)
    controls = Controls({"gps": True}, Settings())
    plant_state, state = plant.initial(), navigator.initial(controls)
    errors, codes = [], []
    for epoch in range(1, len(log) + 1):
        plant_state, _, readings = plant.step(plant_state, epoch, None)
        clean = readings["gps.pseudorange"]
        valid = clean.valid.copy()
        if masked is not None:
            valid[:, masked(epoch)] = False
        faulty = Group(clean.values + (added(epoch) if callable(added) else added), valid, clean.times)
        state, output = navigator.step(
            state, Readings(readings.time, {"gps.pseudorange": faulty}, readings.aiding), controls
        )
        errors.append(np.linalg.norm(output.said.values["position_e"] - ANTENNA, axis=-1))
        codes.append(output.said["{estimator}.status"])
    return np.array(errors), np.array(codes)


@pytest.mark.parametrize("size", [3e4, 1e5, MILLISECOND, -MILLISECOND, 1e9])
def test_given_any_satellite_wrong_from_the_first_epoch_on_then_there_is_a_fix_at_once(log, size):
    columns = seen(log)
    added = np.zeros((len(columns), len(SATELLITES)))
    added[np.arange(len(columns)), columns] = size
    errors, codes = flown(log, added)
    assert (codes[:, :, SNAPSHOT] == 1).all()
    assert errors[:, :, SNAPSHOT].max() < 15.0
    assert errors[:, :, [FILTER, COMBINED]].max() < 15.0


@pytest.mark.parametrize("size", [1e5, MILLISECOND, -1e7])
def test_given_chey_2004_with_any_satellite_wrong_from_the_first_epoch_on_then_there_is_a_fix_at_once(size):
    scenario = Scenario.load("chey-2004").model_copy(update={"faults": (), "duration": 8.0})
    healthy = Simulation(scenario).advance(epochs=1)
    seen_ = [name for name in SLOTS if np.isfinite(healthy[f"elevation.{name}"]).all()]
    assert len(seen_) == 8
    for name in seen_:
        sim = Simulation(scenario)
        sim.inject(Fault(channel=f"gps.pseudorange.{name}", kind="bias", magnitude=size, start=0.0))
        sim.advance()
        assert (sim["snapshot.status"] == 1.0).all(), name
        for estimator in ("snapshot", "filter", "combined"):
            # Seven satellites of 10 m: 60 m is beyond five sigma of the worst geometry that one exclusion leaves.
            assert sim[f"{estimator}.error.position.horizontal"].max() < 60.0, (name, estimator)


def test_given_two_satellites_wrong_from_the_first_epoch_on_then_what_is_vouched_for_is_right(log):
    columns = seen(log)
    pairs = [(a, b) for i, a in enumerate(columns) for b in columns[i + 1 :]]
    added = np.zeros((len(pairs), len(SATELLITES)))
    for run, (a, b) in enumerate(pairs):
        added[run, a], added[run, b] = MILLISECOND, -1.7e5
    errors, codes = flown(log, added)
    vouched = codes[:, :, SNAPSHOT] <= 1
    assert errors[:, :, SNAPSHOT][vouched].max() < 30.0
    assert vouched[-1].mean() > 0.9


@pytest.mark.parametrize("size", [2e3, 3e4, MILLISECOND])
def test_given_a_first_fix_gone_wrong_then_all_get_over_it_when_there_are_more_satellites(log, size):
    """Five epochs with four satellites, one of them wrong: nobody can know. Then all eight, and the wrong one stays."""
    columns = seen(log)
    added = np.zeros((4, len(SATELLITES)))
    added[np.arange(4), columns[:4]] = size
    errors, codes = flown(log, added, lambda epoch: columns[4:] if epoch <= 5 else columns[:0])
    assert (codes[:5, :, SNAPSHOT] >= 3).all()
    assert (codes[6:, :, SNAPSHOT] == 1).all()
    assert errors[6:, :, SNAPSHOT].max() < 15.0
    assert errors[9:, :, COMBINED].max() < 15.0
    assert errors[22:, :, FILTER].max() < 15.0


def test_given_a_fault_of_the_first_epochs_only_then_its_end_heals_everything(log):
    columns = seen(log)
    added = np.zeros((len(columns), len(SATELLITES)))
    added[np.arange(len(columns)), columns] = MILLISECOND
    errors, codes = flown(log, lambda epoch: added if epoch <= 10 else 0.0 * added)
    assert (codes[15:, :, SNAPSHOT] == 0).all()
    assert errors[15:, :, [SNAPSHOT, FILTER, COMBINED]].max() < 15.0


def test_given_a_broadcast_orbit_that_is_wrong_by_any_amount_then_the_receiver_finds_itself():
    """M0, the node or the axis of one satellite in turn: from kilometres to half an orbit, and out of all bounds."""
    made = files(3, 1.0)
    lines = made.navigation.decode().splitlines(keepends=True)
    starts = [i for i, line in enumerate(lines) if line.startswith("10 26")]
    assert len(starts) == 1
    at = starts[0]
    for row, column, value in (
        (1, 60, "-1.234000000000D-01"),
        (1, 60, " 9.999000000000D+00"),
        (2, 60, " 5.160000000000D+03"),
        (2, 60, " 5.900000000000D+03"),
        (2, 60, " 1.000000000000D+01"),
        (2, 22, " 2.500000000000D-01"),
        (3, 41, " 2.000000000000D+00"),
        (1, 22, " 1.000000000000D+30"),
        (0, 22, " 1.000000000000D-03"),
        (0, 22, " 1.000000000000D+60"),
    ):
        changed = lines.copy()
        line = changed[at + row]
        changed[at + row] = line[:column] + value + line[column + 19 :]
        log = rinex.parse(made.observation, "".join(changed).encode())
        errors, codes = flown(log, np.zeros((1, len(SATELLITES))))
        assert (codes[:, :, SNAPSHOT] <= 1).all(), value
        assert errors[:, :, SNAPSHOT].max() < 15.0, value
        assert errors[:, :, COMBINED].max() < 15.0, value
