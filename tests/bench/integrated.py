"""SINS/GPS/BD2/CNS against pyins' navigation filter, 15 states as well, on the same samples of the same flight.

pyins is given what costs it least: one aid, GPS; its covariance carried once a second (ten times by default); all
readings in one call, its strapdown compiled. FTLab does what it always does: world, sensors and faults, strapdown, two
fault-tolerant filters with two models and two propagators each, all tests, an unprotected filter, three filters with
one aid each, recording and scoring.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pyins.filters
import pyins.inertial_sensor
import pyins.measurements
import pyins.strapdown
from numpy.typing import NDArray

from ftcore import Scenario, Simulation
from ftcore.estimation.ins_error import navigation_error
from ftcore.estimation.strapdown import InsState
from ftcore.readings import Readings
from ftcore.rotation import matrix_to_rpy, rpy_to_matrix
from ftcore.systems.sins_gps_bd2_cns.navigator import Navigator
from tests.bench.flights import by_epochs
from tests.bench.measure import Figure, Taken, least, taken

Array = NDArray[np.float64]

SYSTEM = "sins-gps-bd2-cns"
AGAINST_PYINS = 5.0
SECONDS = 120
HOUR = 18.0
"""Processor seconds that an hour's flight may cost."""
BATCH, COST_OF_A_BATCH = 50, 8.0


def scenario(duration: float = SECONDS) -> Scenario:
    """A flight with everything on and nothing failing."""
    return Scenario(
        id="bench", title="Bench", summary="", hint="", source="FTLab", system=SYSTEM, seed=5, duration=duration
    )


@dataclass(frozen=True)
class Flight:
    """What one run's sensors said: rates and forces ``(epochs, samples, 3)``, GPS ``(epochs, 3)`` in deg and m,
    where it began by its own account, and where FTLab's strapdown was at the end."""

    omega_b: Array
    f_b: Array
    gps: Array
    begin: InsState
    end: InsState


@contextmanager
def overheard(heard: list[tuple[Any, Readings, Any]]) -> Iterator[None]:
    """What the navigators of all simulations in here are given, and the state that they return."""
    original = Navigator.step

    def step(self: Navigator, state: Any, readings: Readings, controls: Any) -> Any:
        answer = original(self, state, readings, controls)
        heard.append((state, readings, answer[0]))
        return answer

    with mock.patch.object(Navigator, "step", step):
        yield


def flight() -> Flight:
    """:data:`SECONDS` of high manoeuvre."""
    heard: list[tuple[Any, Readings, Any]] = []
    with overheard(heard):
        sim = Simulation(scenario()).advance()
    navigator = sim._assembly.navigator
    chart = navigator._chart
    imu = [
        np.stack([np.moveaxis(r[f"imu.{name}"].values[0, :3], 0, -1) for _, r, _ in heard])
        for name in ("gyro", "accelerometer")
    ]
    metres = np.stack([r["gps.position"].values[0] for _, r, _ in heard]) / chart.metres
    gps = chart.datum + metres[:, [1, 0, 2]]
    gps[:, :2] = np.degrees(gps[:, :2])
    return Flight(*imu, gps, heard[0][0].ins, heard[-1][2].ins)


def pyins_inputs(f: Flight) -> tuple[pd.Series, pd.DataFrame, list[pyins.measurements.Measurement]]:
    """The same for pyins: initial state, increments, measurements."""
    samples = f.omega_b.shape[1]
    dt = 1.0 / samples
    rows = np.concatenate([f.omega_b, f.f_b], axis=-1).reshape(-1, 6) * dt
    columns = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    rows = np.vstack([rows[:1], rows])
    imu = pd.DataFrame(rows, index=np.arange(len(rows)) * dt, columns=columns)
    lla, v, rpy = f.begin.lla[0], f.begin.v_n[0], np.degrees(matrix_to_rpy(f.begin.C_nb)[0])
    pva = pd.Series(
        [*np.degrees(lla[:2]), lla[2], v[1], v[0], -v[2], *rpy],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=0.0,
    )
    times = np.arange(1, len(f.gps) + 1, dtype=float)
    gps = pyins.measurements.Position(pd.DataFrame(f.gps, index=times, columns=["lat", "lon", "alt"]), 3.0)
    return pva, pyins.strapdown.compute_increments_from_imu(imu, "increment"), [gps]


def theirs(inputs: tuple[pd.Series, pd.DataFrame, list[pyins.measurements.Measurement]]) -> InsState:
    """pyins' filter with feedback over all of it; where it ends."""
    pva, increments, aids = inputs
    model = pyins.inertial_sensor.EstimationModel
    done = pyins.filters.run_feedback_filter(
        pva,
        5.0,
        0.02,
        np.degrees(1e-4),
        np.degrees(1e-3),
        increments,
        model(bias_sd=np.radians(1.0) / 3600.0, noise=np.radians(0.01) / 60.0),
        model(bias_sd=6e-4, noise=1e-4),
        aids,
        time_step=1.0,
    )
    p = done.trajectory.iloc[-1]
    return InsState(
        np.array([[np.radians(p.lat), np.radians(p.lon), p.alt]]),
        np.array([[p.VE, p.VN, -p.VD]]),
        rpy_to_matrix(np.radians([[p.roll, p.pitch, p.heading]])),
    )


def compare(tries: int) -> tuple[float, float, float]:
    """Processor seconds of the flight: ours, pyins'; and the distance [m] between where both end up."""
    f = flight()
    inputs = pyins_inputs(f)
    end = theirs(inputs)  # compiles
    apart = float(np.linalg.norm(navigation_error(f.end, end)[0, :3]))
    here, there = least([lambda: Simulation(scenario()).advance(), lambda: theirs(inputs)], tries)
    return here, there, apart


def hour() -> Taken:
    """An hour's flight, one run, everything on."""
    return taken(by_epochs(scenario(3600.0)))


def batch(tries: int) -> tuple[float, float]:
    """Processor seconds of the flight of one run and of :data:`BATCH`."""
    one, many = least(
        [lambda: Simulation(scenario()).advance(), lambda: Simulation(scenario(), runs=BATCH).advance()], tries
    )
    return one, many


def figures(tries: int) -> list[Figure]:
    """pyins, the hour, the batch."""
    here, there, apart = compare(tries)
    one, many = batch(tries)
    whole = hour()
    subject = f"{SYSTEM}, {SECONDS} s of high manoeuvre"
    return [
        Figure(
            subject,
            "speed against pyins' 15-state filter with one aid",
            there / here,
            "x",
            AGAINST_PYINS,
            "least",
            f"{1e3 * here / SECONDS:.2f} ms a second of flight, pyins {1e3 * there / SECONDS:.1f}; {apart:.1f} m apart",
        ),
        Figure(subject, f"cost of {BATCH} runs, in single runs", many / one, "x", COST_OF_A_BATCH, "most"),
        Figure(
            f"{SYSTEM}, one hour",
            "one run, everything on",
            whole.seconds,
            "s",
            HOUR,
            "most",
            at_reference=whole.at_reference,
        ),
    ]
