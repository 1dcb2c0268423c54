"""A fault as the API shows it."""

from __future__ import annotations

from ftcore import Fault, Simulation
from ftcore.operator import LiveFault, ended_by
from server.models import FaultState


def fault_state(simulation: Simulation, fault: Fault) -> FaultState:
    """A fault as the API shows it; one that is no longer in the simulation has ended."""
    for live in simulation.faults:
        if live.fault.id == fault.id:
            return shown(live)
    ended = ended_by(fault, simulation.now)
    return shown(LiveFault(ended, fault.unit, "ended", silent_because="cleared before it began"))


def shown(live: LiveFault) -> FaultState:
    """A fault with its state, in the words of the API."""
    fault = live.fault
    return FaultState(
        id=str(fault.id),
        channel=fault.channel,
        kind=fault.kind,
        magnitude=fault.magnitude,
        unit=live.unit,
        start=fault.start or 0.0,
        end=fault.end,
        angular_frequency=fault.angular_frequency,
        rate=fault.rate,
        state=live.state,
        acting=live.acting,
        acted_epochs=live.acted_epochs,
        silent_because=live.silent_because,
    )
