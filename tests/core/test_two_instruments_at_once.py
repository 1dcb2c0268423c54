"""System A with two instruments of the redundant IMU wrong at once: nobody sound stays out, and errors are as said.

Errors are judged as in the random schedules, by their median over the last ten seconds: each of the nine axes of a run
leaves 4 sigma with a probability of 6e-5. The seeds are fixed, so a test fails always or never.
"""

import numpy as np
import pytest
from scipy.stats import chi2

from ftcore import Fault, Scenario, Simulation
from ftcore.detection import contradiction, overruling, parity
from ftcore.detection.geometry import three_two_dof
from ftcore.systems.sins_gps_doppler import hindsight
from ftcore.systems.sins_gps_doppler.forms import Parameters
from ftcore.systems.sins_gps_doppler.navigator import Navigator
from tests.core.test_hindsight import culprits, scaled, state

CALM = Scenario.load("zhang-1992").model_copy(update={"faults": ()})
CLUSTER = three_two_dof()


def flight(*faults, duration=70.0, runs=1, **settings):
    scenario = CALM.model_copy(update={"faults": faults, "duration": duration, "settings": settings})
    return Simulation(scenario, runs=runs, seed=11)


def wrong(cluster, axis, magnitude, start=12.0, end=22.0, kind="bias"):
    return Fault(channel=f"imu.{cluster}.{axis}", kind=kind, magnitude=magnitude, start=start, end=end)


def hidden(cluster, size):
    """Instruments 1 and 2 are wrong, and the parity vector lies in the fault plane of instrument 3."""
    made = Navigator.geometry(Parameters())
    normal = np.linalg.svd(made.V[:, made.instrument == 2])[0][:, 2]
    a = normal @ made.V[:, :4]
    f = np.array([1.0, -0.4, 0.7, 0.9])
    f -= a * (a @ f) / (a @ a)
    return [wrong(cluster, name, size * float(x)) for name, x in zip(("1x", "1y", "2x", "2y"), f, strict=True)]


def of_kind(sim, kind, subject=None):
    return [e for e in sim.events if e.kind == kind and subject in (None, e.subject)]


def nobody_sound_is_out_and_the_errors_are_as_said(sim):
    late = sim.time > sim.duration - 10.0
    for name in ("used.gps", "used.doppler", "used.altimeter"):
        assert sim[name][late].mean() > 0.9, name
    for name in sim.signals:
        if name.startswith("fused.error.") and name.replace(".error.", ".sigma.") in sim.signals:
            off = np.median(np.abs(sim[name][late] / sim[name.replace(".error.", ".sigma.")][late]), axis=0)
            assert off.max() < 4.0, (name, off)


@pytest.mark.parametrize(
    ("subject", "faults", "settings"),
    [
        # One without readings, another one wrong: one parity equation is left.
        ("imu.gyro", (Fault(channel="imu.gyro.3y", kind="dropout", start=12.0, end=22.0), ("gyro", "1x", 60.0)), {}),
        # One after the other: the first is named, the second contradicts the last that is left.
        ("imu.gyro", (("gyro", "1y", -110.0), ("gyro", "2x", 200.0, 15.0)), {"driving_test": "two-propagator"}),
        # Both at once: the parity vector lies in nobody's plane.
        (
            "imu.accelerometer",
            (("accelerometer", "1y", 4.0), ("accelerometer", "3x", 2.0)),
            {"imu_driving_test": "parity", "master": "tolerant", "fusion_mode": "rescale"},
        ),
    ],
    ids=["one without readings", "one after the other", "both at once"],
)
def test_given_two_contradict_each_other_then_it_is_said_and_the_sound_aids_stay_in(subject, faults, settings):
    sim = flight(*(f if isinstance(f, Fault) else wrong(*f) for f in faults), **settings).advance()
    said = of_kind(sim, "integrity.cannot-isolate", subject)
    assert said
    assert all(e.detail["statistic"] > e.detail["threshold"] > 0.0 for e in said)
    assert not of_kind(sim, "subsystem.isolated", "gps")
    assert not of_kind(sim, "subsystem.isolated", "doppler")
    nobody_sound_is_out_and_the_errors_are_as_said(sim)


@pytest.mark.parametrize(
    ("faults", "settings"),
    [
        (hidden("gyro", 200.0), {"master": "tolerant"}),
        (hidden("accelerometer", 20.0), {"fusion_mode": "no-reset", "imu_driving_test": "parity"}),
    ],
    ids=["gyros", "accelerometers"],
)
def test_given_two_look_like_the_third_then_the_aids_overrule_the_inertial_solution(faults, settings):
    sim = flight(*faults, **settings).advance(until=45.0)
    opened = of_kind(sim, "filter.reopened", "imu")
    assert opened
    assert all(e.detail["velocity [m/s]"] > 0.0 for e in opened)
    # Flown again without a culprit, the past that was kept leads here, the opening and the new start included.
    now, numbers = state(sim)
    out_of_sight = next(i for i in range(24) if not any(e.trusted[:, i].any() for e in now.history.epochs))
    first = now.history.banks[0][0] + 1
    assert min(e.time for e in opened) > first
    _, again = hindsight.fly_again(now.history, now.filters, culprits(1, first, satellite=out_of_sight), *numbers)
    np.testing.assert_allclose(again.x, now.filters.x, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(scaled(again.P), scaled(now.filters.P), rtol=0.0, atol=1e-7)
    nobody_sound_is_out_and_the_errors_are_as_said(sim.advance())


@pytest.mark.parametrize(
    "faults",
    [
        (wrong("gyro", "2x", 300.0), wrong("accelerometer", "1x", 5.0)),
        (Fault(channel="gps.pseudorange.C1", kind="ramp", magnitude=3.0, start=12.0, end=45.0),),
        (Fault(channel="doppler.velocity.x", kind="bias", magnitude=2.0, start=12.0, end=45.0),),
    ],
    ids=["one instrument of each cluster", "a satellite", "doppler"],
)
def test_given_nobody_contradicts_the_rest_then_nothing_is_opened(faults):
    sim = flight(*faults, duration=45.0).advance()
    assert of_kind(sim, "subsystem.isolated")
    assert not of_kind(sim, "filter.reopened")
    assert not of_kind(sim, "integrity.cannot-isolate")
    assert not state(sim)[0].imu.series.any()


@pytest.mark.parametrize("used", [(True, True, True), (True, False, True)], ids=["three", "two"])
def test_the_noise_follows_the_parity_vector(used):
    """By its definition: with the variance that is believed, a parity vector as short has a probability of 0.1; and the
    errors of n epochs add up to n^2 variances."""
    reference = parity.calibrate(CLUSTER, np.zeros((1, 1, 6)), 1.0, 0.0)
    readings = np.array([[30.0, 0.0, 0.0, 5.0, -20.0, 0.0], [0.5, -0.3, 0.2, 0.1, 0.0, 0.4]])
    sight = parity.look(reference, readings, 1e-3, np.array([used, used]))
    series, total = np.zeros(2, np.int64), np.zeros(2)
    for _ in range(5):
        variance, series = contradiction.extra_variance(sight, series)
        total = total + variance
    assert series.tolist() == [5, 0]
    assert total[1] == 0.0
    dof = 3 if all(used) else 1
    assert chi2.cdf(sight.FD[0] / (total[0] / 25.0), dof) == pytest.approx(0.1)


def votes(there, out, contradictory, epochs=40):
    s, due = overruling.start(1), []
    there, out = np.array([there]), np.array([out])
    for k in range(epochs):
        agree = overruling.asked(s, out, there)
        s, now = overruling.step(s, np.array([contradictory and k == 0]), out, agree)
        due.append(bool(now[0]))
    return due


def test_given_one_aid_is_out_then_it_has_a_vote_only_if_the_inertial_unit_is_doubted():
    assert not any(votes((True, True), (True, False), contradictory=False))
    assert not any(votes((True, False), (True, False), contradictory=False))
    assert votes((True, True), (True, False), contradictory=True).index(True) == overruling.PATIENCE


def test_given_all_aids_are_out_and_agree_then_they_overrule():
    assert votes((True, True), (True, True), contradictory=False).index(True) == overruling.PATIENCE - 1


def test_the_opening_is_the_smallest_that_agrees():
    """One unknown of a known position, measured twice: 10 off needs a sigma of 10 / 3.29 at a tail of 1e-3, but for the
    noise: 4 of 1, 2, 4. Two measurements that differ by 10 agree with no opening."""
    H, R = np.ones((1, 3, 1)), np.full((1, 3), 1e-4)
    there, determined = np.ones((1, 3), bool), np.array([1])
    for y, expected in (([10.0, 10.0, 10.0], 4.0), ([10.0, 10.0, 20.0], np.inf), ([0.0, 0.0, 0.0], 1.0)):
        found = overruling.smallest_opening(
            np.zeros((1, 1)), np.zeros((1, 1, 1)), np.array([y]), H, R, there, np.array([1.0]), determined
        )
        assert found[0] == expected
