"""The F-16 of Stevens and Lewis: nonlinear flight dynamics, trim, linear model and regulator."""

from ftcore.world.aircraft.dynamics import CONTROLS, GRAVITY, STATES, Aircraft, C, S, derivative, f16, step
from ftcore.world.aircraft.tables import FOOT
from ftcore.world.aircraft.trim import REGULATED, Trim, linearise, lqr, regulator, trim

__all__ = [
    "CONTROLS",
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
    "regulator",
    "step",
    "trim",
]
