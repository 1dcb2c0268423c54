"""What a whole flight costs: one run, and a hundred of them."""

from __future__ import annotations

from ftcore import Scenario, Simulation, catalogue
from tests.bench.measure import Figure, seconds

REAL_TIME_FACTOR = 200.0
COST_OF_A_BATCH = 10.0
BATCH = 100


def default_scenario(system: str) -> Scenario:
    """The ready scenario of a system that a person is shown first."""
    return next(s for s in catalogue.scenarios() if s.system == system)


def fly(scenario: Scenario, runs: int = 1) -> Simulation:
    """A whole flight."""
    return Simulation(scenario, runs=runs).advance()


def cost(scenario: Scenario, rounds: int) -> tuple[float, float]:
    """Processor seconds of one run and of :data:`BATCH` runs of a whole scenario, everything on: the least of each.

    A single run is short and feels every disturbance, so it is tried three times a round.
    """
    Simulation(scenario).advance(epochs=3)  # imports and tables are nobody's cost
    one, many = [], []
    for _ in range(rounds):
        one += [seconds(lambda: fly(scenario)) for _ in range(3)]
        many += [seconds(lambda: fly(scenario, BATCH))]
    return min(one), min(many)


def figures(rounds: int) -> list[Figure]:
    """Two lines for every system there is."""
    found = []
    for system in catalogue.systems():
        scenario = default_scenario(system.id)
        one, many = cost(scenario, rounds)
        flown = Simulation(scenario).last_epoch * system.epoch
        found += [
            Figure(
                system.id,
                "real-time factor, one run, everything on",
                flown / one,
                "x",
                REAL_TIME_FACTOR,
                "least",
                f"{scenario.id}: {flown:g} s in {1e3 * one:.0f} ms",
            ),
            Figure(
                system.id,
                f"cost of {BATCH} runs, in single runs",
                many / one,
                "x",
                COST_OF_A_BATCH,
                "most",
                f"{1e3 * many / BATCH:.1f} ms a run, real-time factor {BATCH * flown / many:.0f}",
            ),
        ]
    return found
