"""What single pieces cost: a receiver's flight, an epoch's matrices, a second of strapdown, a mounting's figures."""

from __future__ import annotations

from itertools import count

import numpy as np

from ftcore import Scenario, Simulation, catalogue
from ftcore.estimation.ins_error import (
    NoiseDensities,
    damping_transition,
    noise_density,
    process_noise,
    system_matrix,
    transition,
)
from ftcore.estimation.strapdown import InsState, damping_gains, propagate
from tests.bench.flights import by_epochs
from tests.bench.inertial import EPOCH, flight
from tests.bench.measure import Figure, Taken, best, once

DENSITIES = NoiseDensities(
    gyro=(np.radians(0.01) / 60.0) ** 2,
    accelerometer=1e-8,
    clock_phase=0.036,
    clock_frequency=0.141,
    gyro_walk=1e-16,
    altimeter_bias_walk=0.01,
)
ROUNDS = 30
"""Tries of what takes less than a millisecond."""


def at_most(subject: str, name: str, taken: Taken, seconds: float, note: str = "") -> Figure:
    """A figure in milliseconds of processor time, judged at the reference machine's pace."""
    milli = 1e3 * taken.seconds
    return Figure(subject, name, milli, "ms", 1e3 * seconds, "most", note, 1e3 * taken.at_reference)


def receiver(rounds: int) -> list[Figure]:
    """`chey-2004`, one run and a hundred."""
    chey = Scenario.load("chey-2004")
    Simulation(chey).advance(until=5.0)
    one, many = best(lambda: by_epochs(chey), 3 * rounds), best(lambda: by_epochs(chey, 100), rounds)
    return [
        at_most("gps-receiver", "100 s of flight, one run", one, 0.2),
        at_most("gps-receiver", "100 s of flight, 100 runs", many, 2.0),
    ]


def kim(rounds: int) -> list[Figure]:
    """`kim-2005` with both twins: three aircraft, FDI and UKF."""
    scenario = Scenario.load("kim-2005")
    Simulation(scenario).advance(epochs=3)
    one, many = best(lambda: by_epochs(scenario), rounds), best(lambda: by_epochs(scenario, 20), rounds)
    return [
        at_most("redundant-imu", "kim-2005, 15 s with both twins", one, 3.0),
        Figure(
            "redundant-imu", "kim-2005, cost of 20 runs, in single runs", many.seconds / one.seconds, "x", 5.0, "most"
        ),
    ]


def inertial() -> list[Figure]:
    """A second of strapdown, and the error model's matrices of an epoch."""
    path, found = flight(), []
    k1, k2 = damping_gains(30.0)
    for runs, limit in ((1, 0.35e-3), (100, 3e-3)):
        omega, f = (np.repeat(x[None, :EPOCH], runs, axis=0) for x in (path.omega_b, path.f_b))
        begin = InsState(*(np.repeat(x[None, 0], runs, axis=0) for x in (path.lla, path.v_n, path.C_nb)))
        taken = best(lambda begin=begin, omega=omega, f=f: once(lambda: propagate(begin, omega, f, path.dt)), ROUNDS)
        found.append(at_most("strapdown", f"a second of {EPOCH} samples, {runs} runs", taken, limit))
        if runs == 1:
            interval = propagate(begin, omega, f, path.dt)[1]

    def matrices() -> None:
        F = system_matrix(interval)
        transition(F, 1.0)
        damping_transition(interval.lla[:, 2], 1.0, k1, k2)
        process_noise(F, noise_density(interval, DENSITIES), 1.0)

    return [
        *found,
        at_most("error model", "F, Phi, D and Q of an epoch, one run", best(lambda: once(matrices), ROUNDS), 2.5e-4),
    ]


def mounting() -> list[Figure]:
    """J_GNC, J_FDI and the maps of a mounting that was not asked for before."""
    angle = count(10)

    def ask() -> None:
        catalogue.indicators("redundant-imu", {"gyros": {"mounting": [next(angle), 20, 30]}})

    return [at_most("redundant-imu", "figures of a mounting", best(lambda: once(ask), 8), 0.05)]


def figures(rounds: int) -> list[Figure]:
    """All of them."""
    return receiver(rounds) + kim(rounds) + inertial() + mounting()
