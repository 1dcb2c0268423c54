"""The F-16 of Stevens and Lewis: nonlinear flight dynamics, trim, linear model and regulator."""

from ftcore.world.aircraft.dynamics import (
    CONTROL_MAX,
    CONTROL_MIN,
    CONTROLS,
    GRAVITY,
    STATES,
    Aircraft,
    C,
    S,
    derivative,
    f16,
    midpoint_step,
    power_command,
    power_rate,
    steady_thrust,
    step,
)
from ftcore.world.aircraft.tables import FOOT
from ftcore.world.aircraft.trim import REGULATED, Trim, linearise, lqr, regulator, trim

__all__ = [
    "CONTROLS",
    "CONTROL_MAX",
    "CONTROL_MIN",
    "FOOT",
    "GRAVITY",
    "REGULATED",
    "STATES",
    "Aircraft",
    "C",
    "S",
    "Trim",
    "derivative",
    "f16",
    "linearise",
    "lqr",
    "midpoint_step",
    "power_command",
    "power_rate",
    "regulator",
    "steady_thrust",
    "step",
    "trim",
]
