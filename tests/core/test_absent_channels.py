"""A fault on what is not fitted is refused with the reason; what is described and there takes it."""

import pytest

from ftcore import CommandError, Fault, Scenario, Simulation, catalogue


def flight(system, parameters=None, faults=()):
    document = {
        "id": "absent",
        "title": "Absent",
        "summary": "",
        "hint": "",
        "source": "FTLab",
        "system": system,
        "duration": 10.0,
        "parameters": parameters or {},
        "faults": faults,
    }
    return Simulation(Scenario.model_validate(document))


@pytest.mark.parametrize(
    ("configuration", "there", "missing"),
    [("three-axis", "imu.gyro.x", "imu.gyro.2y"), ("redundant", "imu.accelerometer.3x", "imu.accelerometer.z")],
)
def test_given_one_of_two_imus_then_the_channels_of_the_other_are_refused(configuration, there, missing):
    sim = flight("sins-gps-bd2-cns", {"inertial": {"configuration": configuration}})
    with pytest.raises(CommandError, match=f"the {configuration} IMU is fitted; parameter inertial.configuration"):
        sim.inject(Fault(channel=missing, kind="bias", magnitude=5.0))
    assert sim.faults == []
    sim.inject(Fault(channel=there, kind="bias", magnitude=5.0))
    with pytest.raises(CommandError) as refused:
        sim.change(sim.faults[0].fault.id, channel=missing)
    assert refused.value.field == "channel"
    assert [f.fault.channel for f in sim.faults] == [there]


def test_given_a_scenario_with_a_fault_on_what_is_not_fitted_then_it_says_which_fault():
    faults = [
        {"channel": "gps.position.east", "kind": "bias", "magnitude": 5.0},
        {"channel": "imu.gyro.1x", "kind": "bias", "magnitude": 5.0},
    ]
    with pytest.raises(CommandError, match=r"imu\.gyro\.1x is not there") as refused:
        flight("sins-gps-bd2-cns", faults=faults)
    assert refused.value.field == "faults.1.channel"


def test_given_the_simulated_receiver_then_satellites_of_logs_are_refused():
    sim = flight("gps-receiver")
    with pytest.raises(CommandError, match="A1 to F4"):
        sim.inject(Fault(channel="gps.pseudorange.G11", kind="bias", magnitude=50.0))


@pytest.mark.parametrize("system", [s.id for s in catalogue.systems()])
def test_given_any_system_then_what_is_absent_is_described(system):
    sim = flight(system)
    assert set(sim.unavailable) <= {c.name for c in sim.description.channels}
