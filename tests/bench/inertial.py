"""The strapdown against pyins, a compiled one, on the same samples of the same hard flight."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyins.earth
import pyins.strapdown

from ftcore import earth
from ftcore.estimation.ins_error import navigation_error
from ftcore.estimation.strapdown import InsState, propagate
from ftcore.rotation import rpy_to_matrix
from ftcore.world.trajectory import Climb, SpeedChange, Straight, Trajectory, Turn, build
from tests.bench.measure import Figure, least

RUNS = 100
EPOCH = 40
SECONDS = 60


def flight() -> Trajectory:
    """A minute of climbing, turning and accelerating, 40 samples a second."""
    segments = [
        Turn(angle=60.0, bank=50.0, entry=1.5),
        Climb(height_change=200.0, rate=30.0, entry=2.0),
        SpeedChange(speed=220.0, acceleration=6.0, entry=1.0),
        Turn(angle=-90.0, bank=60.0, entry=1.0),
        Straight(duration=60.0),
    ]
    return build((np.radians(40.0), np.radians(116.0), 5000.0), 260.0, 1.0, segments, 1.0 / EPOCH)


def ours(path: Trajectory, runs: int) -> InsState:
    """Epoch by epoch, as the navigator flies."""
    count = SECONDS * EPOCH
    start = path.lla[None, 0], path.v_n[None, 0], path.C_nb[None, 0]
    state = InsState(*(np.repeat(a, runs, axis=0) for a in start))
    omega_b, f_b = (np.repeat(a[None, :count], runs, axis=0) for a in (path.omega_b, path.f_b))
    for k in range(0, count, EPOCH):
        state, _ = propagate(state, omega_b[:, k : k + EPOCH], f_b[:, k : k + EPOCH], path.dt)
    return state


def increments_for_pyins(path: Trajectory) -> pd.DataFrame:
    """The same samples; pyins has another gravity, so it is given the difference as specific force."""
    count = SECONDS * EPOCH
    lat, height = path.lla[:, 0], path.lla[:, 2]
    excess = pyins.earth.gravity(np.degrees(lat), height) - earth.gravity(lat, height)
    up_b = 0.5 * (path.C_nb[1:, 2] + path.C_nb[:-1, 2])
    f_b = path.f_b + (0.5 * (excess[1:] + excess[:-1]))[:, None] * up_b
    rows = np.hstack([path.omega_b, f_b])[np.r_[0, :count]] * path.dt
    columns = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    return pd.DataFrame(rows, index=np.arange(count + 1) * path.dt, columns=columns)


def theirs(path: Trajectory, imu: pd.DataFrame) -> InsState:
    """All samples in one call, which is what pyins does best."""
    lla, v, rpy = path.lla[0], path.v_n[0], np.degrees(path.rpy[0])
    pva = pd.Series(
        [*np.degrees(lla[:2]), lla[2], v[1], v[0], -v[2], *rpy],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
    )
    integrator = pyins.strapdown.Integrator(pva)
    integrator.integrate(pyins.strapdown.compute_increments_from_imu(imu, "increment"))
    p = integrator.get_pva()
    return InsState(
        np.array([[np.radians(p.lat), np.radians(p.lon), p.alt]]),
        np.array([[p.VE, p.VN, -p.VD]]),
        rpy_to_matrix(np.radians([[p.roll, p.pitch, p.heading]])),
    )


def figures(tries: int) -> list[Figure]:
    """Time a sample and where both end."""
    path = flight()
    imu = increments_for_pyins(path)
    there = theirs(path, imu)  # compiles
    end = SECONDS * EPOCH
    truth = InsState(path.lla[None, end], path.v_n[None, end], path.C_nb[None, end])
    here = ours(path, 1)
    apart, off, theirs_off = (
        float(np.linalg.norm(navigation_error(a, b)[0, :3])) for a, b in ((here, there), (here, truth), (there, truth))
    )
    one, many, compiled = least([lambda: ours(path, 1), lambda: ours(path, RUNS), lambda: theirs(path, imu)], tries)
    micro = 1e6 / end
    subject = f"{SECONDS} s of hard flight, {EPOCH} Hz"
    note = f"{one * micro:.2f} us a sample, pyins (compiled, all in one call) {compiled * micro:.2f}"
    return [
        Figure(subject, "strapdown, one run: time a sample against pyins", one / compiled, "x", note=note),
        Figure(
            subject,
            f"strapdown, {RUNS} runs: time a sample against pyins",
            many / RUNS / compiled,
            "x",
            note=f"{many / RUNS * micro:.2f} us a sample and run",
        ),
        Figure(
            subject,
            "strapdown, position difference to pyins",
            apart,
            "m",
            note=f"to the truth: ours {1e3 * off:.2f} mm, pyins {1e3 * theirs_off:.0f} mm",
        ),
    ]
