"""The covariance cycle, predict and update of 21 states by a real SINS/GPS epoch, against filterpy and dgemm."""

from __future__ import annotations

from dataclasses import dataclass
from unittest import mock

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from ftcore import Scenario, Simulation
from ftcore.estimation import kalman
from ftcore.systems.sins_gps_doppler import bank
from tests.bench.measure import Figure, least

Array = NDArray[np.float64]

RUNS = 100
AGAINST_FILTERPY = 5.0
EPOCH = 50


@dataclass(frozen=True)
class Cycle:
    """One epoch of the SINS/GPS filter in all runs: x (runs, n), P, Phi, Q (runs, n, n), y (runs, m), H, R (m,)."""

    x: Array
    P: Array
    Phi: Array
    Q: Array
    y: Array
    H: Array
    R: Array

    @property
    def rows(self) -> int:
        """Measurements."""
        return self.y.shape[1]

    def ours(self) -> kalman.Update:
        """All runs at once."""
        x, P = kalman.predict(self.x, self.P, self.Phi, self.Q)
        return kalman.update(x, P, self.y, self.H, self.R)

    def filterpy(self) -> list[KalmanFilter]:
        """filterpy's filters, one a run, ready to go."""
        filters = []
        for k in range(len(self.x)):
            f = KalmanFilter(dim_x=self.x.shape[1], dim_z=self.rows)
            f.x, f.P, f.F, f.Q = self.x[k].copy(), self.P[k].copy(), self.Phi[k], self.Q[k]
            f.H, f.R = self.H[k], np.diag(self.R)
            filters.append(f)
        return filters

    def theirs(self, filters: list[KalmanFilter]) -> None:
        """filterpy, one run after the other."""
        for f, z in zip(filters, self.y, strict=True):
            f.predict()
            f.update(z)

    @property
    def flops(self) -> float:
        """Multiplications and additions of one run's matrices, as :mod:`ftcore.estimation.kalman` multiplies them."""
        n, m = self.x.shape[1], self.rows
        predict = 4 * n**3
        innovation = 2 * m * n * n + 2 * m * m * n
        factor = m**3 / 3 + m**3 / 3
        gain = 2 * m * m * n + 2 * n * m * m
        return predict + innovation + factor + gain + 2 * n * n * m


def real_cycle(runs: int = RUNS, epoch: int = EPOCH) -> Cycle:
    """What the SINS/GPS filter of `zhang-1992` is given at one epoch: overheard while it flies."""
    sim = Simulation(Scenario.load("zhang-1992"), runs=runs).advance(epochs=epoch - 1)
    with (
        mock.patch.object(bank, "predict", wraps=bank.predict) as predict,
        mock.patch.object(kalman, "update", wraps=kalman.update) as update,
    ):
        sim.step()
    filters, Phi, Q = predict.call_args_list[0].args[:3]
    _, _, y, H, R, valid = update.call_args_list[0].args
    assert valid.all(), "every satellite has both its readings before the fault"
    alone, ins = bank.ALONE[0], bank.INS_OF_FILTER[bank.ALONE[0]]
    copies = [filters.x[:, alone], filters.P[:, alone], Phi[:, ins], Q[:, ins], y[:, 0], H[:, 0]]
    return Cycle(*(np.ascontiguousarray(a) for a in copies), R=np.ravel(R))


def peak(tries: int, n: int = 768) -> float:
    """Floating-point operations a second of a large matrix product on one thread."""
    A = np.random.default_rng(0).standard_normal((n, n))
    (taken,) = least([lambda: A @ A], tries)
    return 2.0 * n**3 / taken


def compare(cycle: Cycle, tries: int, repeats: int = 5) -> tuple[float, float]:
    """Processor seconds of one cycle of all runs: ours, filterpy's."""
    filters = cycle.filterpy()

    def ours() -> None:
        for _ in range(repeats):
            cycle.ours()

    one, two = least([ours, lambda: cycle.theirs(filters)], tries)
    return one / repeats, two


def figures(tries: int) -> list[Figure]:
    """Throughput beside filterpy's, and beside what the machine could do."""
    cycle = real_cycle()
    n, m, runs = cycle.x.shape[1], cycle.rows, len(cycle.x)
    ours, theirs = compare(cycle, tries)
    best = peak(tries)

    def predict() -> None:
        for _ in range(5):
            kalman.predict(cycle.x, cycle.P, cycle.Phi, cycle.Q)

    (predicted,) = least([predict], tries)
    whole, first = runs * cycle.flops / ours, 5 * runs * 4 * n**3 / predicted
    subject = f"{n} states, {m} measurements, {runs} runs"
    return [
        Figure(
            subject,
            "covariance cycle, throughput against filterpy",
            theirs / ours,
            "x",
            AGAINST_FILTERPY,
            "least",
            f"{1e6 * ours / runs:.1f} us a run, filterpy {1e6 * theirs / runs:.0f}",
        ),
        Figure(
            subject,
            "covariance cycle, share of dgemm's peak",
            100.0 * whole / best,
            "%",
            note=f"{whole / 1e9:.1f} of {best / 1e9:.1f} GFlop/s; prediction alone {first / 1e9:.1f}",
        ),
    ]
