"""Where an instrument says no reading in one run of a batch, the others go on, and each run is what it is alone."""

import numpy as np
import pytest

from ftcore import Scenario, Simulation
from ftcore.faults import largest
from ftcore.systems.registry import SYSTEMS
from tests.faulting import lay, sized

EPOCHS = 8
FITTED = [*((system, {}) for system in SYSTEMS), ("sins-gps-bd2-cns", {"inertial": {"configuration": "redundant"}})]


def start(system, parameters, runs=1, first_run=0):
    duration = 1.0 if system == "redundant-imu" else 60.0
    return Simulation(Scenario(system=system, duration=duration, parameters=parameters), runs=runs, first_run=first_run)


def flown(system, parameters, group, runs, first_run=0):
    """Noise beyond what the instrument can say, on every channel of a group: no reading here and there, by run."""
    sim = start(system, parameters, runs, first_run).step()
    for channel in sim.description.channels:
        if channel.group == group and len(channel.parts) == 1 and channel.name not in sim.unavailable:
            for kind in ("noise", "random-walk"):
                lay(sim, sized(channel.name, kind, largest(kind, channel.unit)))
    for _ in range(EPOCHS):
        sim.step()
    return sim


@pytest.mark.parametrize(
    ("system", "parameters", "group"),
    [
        pytest.param(system, parameters, group, id=f"{system}-{'redundant-' * bool(parameters)}{group}")
        for system, parameters in FITTED
        for sim in [start(system, parameters)]
        for group in sorted({c.group for c in sim.description.channels if c.name not in sim.unavailable})
    ],
)
def test_given_no_reading_in_some_runs_then_each_run_is_what_it_is_alone(system, parameters, group):
    together = flown(system, parameters, group, runs=2)
    for run in range(2):
        alone = flown(system, parameters, group, runs=1, first_run=run)
        for name in together.signals:
            a, b = together.recording[name][:, run], alone.recording[name][:, 0]
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9, err_msg=name)
