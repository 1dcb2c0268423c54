"""FTLab's fault-tolerant core: good in a notebook, without any web.

    from ftcore import Fault, Scenario, Simulation
    sim = Simulation(Scenario.load("zhang-1992-visible"), runs=100, seed=7).advance()
    sim["fused.error.position.up"]            # (epochs, runs), metres

Data types. Every array leads with the run axis, ``(runs, ...)``; states, readings and outputs are frozen values.
Units. SI and radians inside; :mod:`ftcore.units` at the edges.
Frames. ``n``: local level, x east, y north, z up. ``b``: body, forward, right, down. ``e``: Earth-centred,
Earth-fixed. ``v_n`` is a vector given in n; ``C_nb`` turns a vector of b into n. Position is latitude, longitude,
height on WGS-84.
Signs. Error = indicated - true.
"""

from ftcore import catalogue
from ftcore.commands import CommandError, FlightError
from ftcore.faults import Fault
from ftcore.scenario import Scenario
from ftcore.simulation import Simulation

__all__ = ["CommandError", "Fault", "FlightError", "Scenario", "Simulation", "catalogue"]
