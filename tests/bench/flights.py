"""What flying costs: one run, and a hundred of them."""

from __future__ import annotations

from ftcore import Scenario, Simulation, catalogue
from tests.bench.measure import Figure, Pieces, Taken, best, seconds

REAL_TIME_FACTOR = 200.0
"""Wanted of systems whose epochs last a second, or more."""
REAL_TIME_FACTOR_IN_CLOSED_LOOP = 5.0
"""Wanted of systems with many epochs a second: they fly whole aircraft."""
COST_OF_A_BATCH = 10.0
BATCH = 100
MOST_EPOCHS = 200
"""Longer scenarios are flown for so many epochs."""
BATCH_EPOCHS = 100
"""A batch and a single run are compared over so many: those of an F-16 have its filter running half of the time."""


def default_scenario(system: str) -> Scenario:
    """The ready scenario of a system that a person is shown first."""
    return next(s for s in catalogue.scenarios() if s.system == system)


def real_time_factor_wanted(system: str) -> float:
    """The target for one run of this system."""
    return REAL_TIME_FACTOR if catalogue.system(system).epoch >= 1.0 else REAL_TIME_FACTOR_IN_CLOSED_LOOP


def fly(scenario: Scenario, runs: int = 1, most: int = MOST_EPOCHS) -> Simulation:
    """A whole flight, of a long one the beginning."""
    return Simulation(scenario, runs=runs).advance(epochs=most)


def flown(scenario: Scenario, most: int = MOST_EPOCHS) -> float:
    """How long that is [s]."""
    sim = Simulation(scenario)
    return min(sim.last_epoch, most) * sim.period


def by_epochs(scenario: Scenario, runs: int = 1, most: int | None = None) -> Pieces:
    """A whole flight, or its first epochs, in pieces: its beginning, and each epoch."""
    sim = Simulation(scenario, runs=runs)
    yield sim
    end = sim.last_epoch if most is None else min(sim.last_epoch, most)
    while sim.epoch < end:
        yield sim.step()


def alone(scenario: Scenario, tries: int) -> Taken:
    """Flying one run, everything on."""
    Simulation(scenario).advance(epochs=3)
    return best(lambda: by_epochs(scenario, most=MOST_EPOCHS), tries)


def cost(scenario: Scenario, rounds: int) -> tuple[float, float]:
    """Processor seconds of flying one run and :data:`BATCH` runs, everything on: the least of each.

    A single run is short and feels every disturbance, so it is tried three times a round.
    """
    Simulation(scenario).advance(epochs=3)  # imports and tables are nobody's cost
    one, many = [], []
    for _ in range(rounds):
        one += [seconds(lambda: fly(scenario, 1, BATCH_EPOCHS)) for _ in range(3)]
        many += [seconds(lambda: fly(scenario, BATCH, BATCH_EPOCHS))]
    return min(one), min(many)


def figures(rounds: int) -> list[Figure]:
    """Two lines for every system there is."""
    found = []
    for system in catalogue.systems():
        scenario = default_scenario(system.id)
        one, many = cost(scenario, rounds)
        together = BATCH * flown(scenario, BATCH_EPOCHS)
        time, single = flown(scenario), alone(scenario, 3 * rounds)
        found += [
            Figure(
                system.id,
                "real-time factor, one run, everything on",
                time / single.seconds,
                "x",
                real_time_factor_wanted(system.id),
                "least",
                f"{scenario.id}: {time:g} s in {1e3 * single.seconds:.0f} ms, epochs of {system.epoch:g} s",
                time / single.at_reference,
            ),
            Figure(
                system.id,
                f"cost of {BATCH} runs, in single runs",
                many / one,
                "x",
                COST_OF_A_BATCH,
                "most",
                f"{1e3 * many / BATCH:.1f} ms a run, real-time factor {together / many:.0f}",
            ),
        ]
    return found
