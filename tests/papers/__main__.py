"""Prints the README's table of results again: ``python -m tests.papers [ROWS ...] [--seed N]``.

Each row says what is measured: signal, window, runs, seed. Without ``--seed`` each scenario flies on its own seed
(Yang's on 100, as the tests do). An RMS is over all runs and epochs of the window, its beginning excluded.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from ftcore import Scenario, Simulation
from ftcore.detection.geometry import improve_angles
from ftcore.score import intervals
from tests.papers.flights import CALM, RUNS, between, flown, position_rms, rms, runs_with

Array = NDArray[np.float64]
Row = tuple[str, str]
UP, HORIZONTAL = "error.position.up", "error.position.horizontal"


def said(sim: Simulation) -> str:
    """Runs and seed, as every row ends."""
    return f"({sim.runs} runs, seed {sim.seed})"


def share(count: int, of: int, what: str = "runs") -> str:
    """So many of so many with the exact interval."""
    low, high = intervals.of_share(count, of)
    return f"{count} of {of} {what} ({intervals.between(low, high)})"


def first(sim: Simulation, kind: str, subject: str, start: float, end: float = np.inf) -> Array:
    """Time of the first such event of exactly this subject in each run that has one, from ``start`` to ``end`` [s]."""
    found: dict[int, float] = {}
    for event in sim.events:
        if (event.kind, event.subject) == (kind, subject) and start - 1e-9 <= event.time <= end + 1e-9:
            found.setdefault(event.run, event.time)
    return np.array(sorted(found.values()))


def spread(times: Array, since: float, digits: int = 3) -> str:
    """Least, median and greatest delay."""
    if not len(times):
        return "never"
    least, middle, most = (f"{x - since:.{digits}g}" for x in (times.min(), np.median(times), times.max()))
    return f"after {least} to {most} s, median {middle} s"


# ---- Zhang and Zhang 1992


def zhang(seed: int | None) -> Iterator[Row]:
    """System A: accelerometer at 30 s, 100 m on satellite C1 at 50 s."""
    sim = flown("zhang-1992-visible", seed=seed)
    windows = ((40.0, 50.0), (70.0, 80.0), (90.0, 100.0))
    for name, title in (("gps", "SINS/GPS alone"), ("fused", "fault-tolerant system")):
        up, level = ([f"{rms(sim, f'{name}.{s}', *w):.2f}" for w in windows] for s in (UP, HORIZONTAL))
        yield (
            f"zhang-1992-visible: {title}, RMS at 40 to 50, 70 to 80, 90 to 100 s",
            f"altitude {', '.join(up)} m; horizontal {', '.join(level)} m {said(sim)}",
        )
    culprit = first(sim, "subsystem.isolated", "imu.accelerometer.3", 30.0)
    gps, named = (first(sim, kind, s, 50.0) for kind, s in (("subsystem.isolated", "gps"), ("channel.named", "gps.C1")))
    doppler = len(runs_with(sim, "subsystem.isolated", "doppler"))
    yield (
        "zhang-1992-visible: who is isolated from its fault on",
        f"accelerometer 3 in {share(len(culprit), RUNS)} {spread(culprit, 30.0)}; GPS in {share(len(gps), RUNS)} "
        f"{spread(gps, 50.0)}, its satellite C1 named in {share(len(named), RUNS)}; Doppler, at any time, in "
        f"{share(doppler, RUNS)} {said(sim)}",
    )


def printed(seed: int | None) -> Iterator[Row]:
    """System A as the paper prints it: 1 ug from 30 s, 100 m at 50 s."""
    small, calm = flown("zhang-1992", seed=seed), flown(CALM, seed=seed)
    moved = max(
        np.abs(
            between(small, f"unprotected.error.position.{p}", 30.0, 49.0)
            - between(calm, f"unprotected.error.position.{p}", 30.0, 49.0)
        ).max()
        for p in ("east", "north", "up")
    )
    rates = [between(s, "test.parity.imu.accelerometer.alarm", 30.0, 100.0) > 0.5 for s in (small, calm)]
    yield (
        "zhang-1992, as printed: accelerometer bias of 1 ug from 30 s",
        f"moves the unprotected position by at most {1e3 * moved:.2g} mm by 49 s; parity alarms at 31 to 100 s in "
        f"{share(int(rates[0].sum()), rates[0].size, 'epochs')}, without it in {int(rates[1].sum())} {said(small)}",
    )
    at_once = {t: int(between(small, f"test.{t}.gps.alarm", 49.0, 50.0).sum()) for t in ("residual", "two-propagator")}
    alarms = between(small, "test.state.gps.alarm", 49.0, 60.0) > 0.5
    yield (
        "zhang-1992: 100 m at 50 s, seen by the state test with a propagator that is never reset",
        f"at some time from 50 to 60 s in {share(int(alarms.any(axis=0).sum()), RUNS)}; residual test in its "
        f"first epoch in {at_once['residual']}, two-propagator test in {at_once['two-propagator']} {said(small)}",
    )


def integrity(seed: int | None) -> Iterator[Row]:
    """System A with satellite-level integrity."""
    sim, without = (flown(s, seed=seed) for s in ("zhang-1992-satellite-integrity", "zhang-1992-visible"))
    satellite, gps = (first(sim, "subsystem.isolated", s, 50.0) for s in ("gps.C1", "gps"))
    back = first(sim, "subsystem.readmitted", "gps.C1", 80.0)
    grown = [rms(s, f"gps.{UP}", 70.0, 80.0) / rms(s, f"gps.{UP}", 40.0, 50.0) for s in (sim, without)]
    yield (
        "zhang-1992-satellite-integrity: 100 m on satellite C1 from 50 to 80 s",
        f"C1 isolated in {share(len(satellite), RUNS)} {spread(satellite, 50.0)}, GPS as a whole in "
        f"{share(len(gps), RUNS)}; SINS/GPS altitude RMS at 70 to 80 s {grown[0]:.2f} times that at 40 to 50 s, "
        f"without integrity {grown[1]:.2f} times; C1 back in {share(len(back), RUNS)} {spread(back, 80.0)} {said(sim)}",
    )


def outage(seed: int | None) -> Iterator[Row]:
    """System A, Doppler drifting while GPS is out."""
    ours = flown("doppler-drift-gps-outage", seed=seed)
    tolerant = flown("doppler-drift-gps-outage", seed=seed, master="tolerant", driving_test="two-propagator")
    values = [position_rms(s, "fused", 90.0, 100.0) for s in (tolerant, ours)]
    yield (
        "doppler-drift-gps-outage: fused position RMS at 90 to 100 s, the last 10 s of the outage",
        f"tolerant fusion with the two-propagator test {values[0]:.1f} m; federated master with the residual test "
        f"{values[1]:.1f} m {said(ours)}",
    )


# ---- Chey, Jee and Lee 2004


def chey(seed: int | None) -> Iterator[Row]:
    """System B: ramp or step on one satellite from 30 to 80 s."""
    phases = {"chey-2004": (55.0, 60.0), "chey-2004-step": (30.0, 30.0)}
    for name, starts in phases.items():
        sim = flown(name, seed=seed)
        for start in dict.fromkeys(starts):
            windows = ((10.0, 29.0), (start, 80.0), (80.0, 100.0))
            errors = {
                m: ", ".join(f"{between(sim, f'{m}.{HORIZONTAL}', *w).mean():.1f}" for w in windows)
                for m in ("snapshot", "filter", "combined", "unprotected")
            }
            yield (
                f"{name}: mean horizontal error at 10 to 29, {start:g} to 80, 80 to 100 s",
                "; ".join(f"{m} {e} m" for m, e in errors.items()) + f" {said(sim)}",
            )


# ---- Kim, Park, Kim and Park 2005


def kim(seed: int | None) -> Iterator[Row]:
    """System D: 0.1 rad/s on both axes of gyro 1 from 1 s."""
    angles, index = improve_angles(np.random.default_rng(seed or 1).uniform(0.0, np.pi, (100, 3)))
    off = np.abs(np.rad2deg(angles) % 90.0 - 45.0).max()
    yield (
        "Kim 2005, section 3: mounting uphill from 100 random starts",
        f"J_FDI {index.min():.4f} to {index.max():.4f}; angles within {off:.2g} degrees of 45 (up to quarter turns)",
    )
    sim = flown("kim-2005", runs=20, seed=seed)
    after = sim.time >= 1.0 - 1e-9
    FD, limit = (sim[f"test.parity.imu.gyro.{what}"][after] for what in ("statistic", "threshold"))
    over = limit < FD
    yield (
        "kim-2005: FD from 1 s, the onset, to 15 s",
        f"over its threshold in {100 * over.mean():.2f} % of the epochs, in the first in {int(over[0].sum())} of "
        f"{sim.runs}; median {np.median(FD):.0f}, threshold {limit[0, 0]:.1f} {said(sim)}",
    )
    FI = {k: np.rad2deg(sim[f"test.isolation-angle.imu.gyro.{k}.statistic"][after]) for k in (1, 2, 3)}
    yield (
        "the same: angles to the fault planes, 1 to 15 s",
        f"both of 1 and 3 below 15 degrees in {100 * ((FI[1] < 15) & (FI[3] < 15)).mean():.1f} % of the epochs, "
        f"medians {np.median(FI[1]):.1f} and {np.median(FI[3]):.1f}; sensor 2 {np.median(FI[2]):.0f} {said(sim)}",
    )
    yield "the same: UKF and isolation", f"{_ukf(sim)} {said(sim)}"
    yield "the same: flight path", f"{_path(sim)} {said(sim)}"
    if find_spec("jsbsim") is not None:
        other = flown("kim-2005-jsbsim", runs=20, seed=seed)
        yield "kim-2005-jsbsim: the same on JSBSim's aircraft", f"{_ukf(other)}; {_path(other)} {said(other)}"


def _ukf(sim: Simulation) -> str:
    after = sim.time >= 1.04 - 1e-9
    rates = []
    for k in (1, 3):
        judged = np.isfinite(sim[f"test.ukf.imu.gyro.{k}.statistic"][after])
        rates.append(100 * sim[f"test.ukf.imu.gyro.{k}.alarm"][after][judged].mean())
    out = first(sim, "subsystem.isolated", "imu.gyro.1", 1.0)
    others = {run for k in (2, 3) for run in runs_with(sim, "subsystem.isolated", f"imu.gyro.{k}")}
    return (
        f"UKF alarms for gyro 1 in {rates[0]:.1f} %, for gyro 3 in {rates[1]:.2f} % of the epochs judged from 1.04 s "
        f"on; gyro 1 isolated in {share(len(out), sim.runs)} by {out.max():.2f} s, others in {len(others)}"
    )


def _path(sim: Simulation) -> str:
    end = sim["unprotected.distance"][-1]
    return (
        f"with FDI at most {sim['protected.distance'].max():.1f} m off the healthy twin at any time, without "
        f"{end.min():.0f} to {end.max():.0f} m at the end, median {np.median(end):.0f} m"
    )


# ---- Yang, Mohammadi and Chen 2016


def yang(seed: int | None) -> Iterator[Row]:
    """System C, hours of flight: Tables 4 to 6, Figures 14 and 15."""
    seed = 100 if seed is None else seed
    calm = _hour("yang-2016-scenario-1", 10, seed, calm=True)
    rates = [
        100 * between(calm, f"test.two-propagator{which}.gps.alarm", 0.0, 3600.0).mean()
        for which in ("", "-without-imm")
    ]
    yield (
        "yang-2016-scenario-1: GPS alarms in an hour without a fault",
        f"{rates[0]:.2f} % with IMM, {rates[1]:.0f} % without {said(calm)}",
    )
    del calm
    sim = _hour("yang-2016-scenario-1", 10, seed, until=2530.0)
    alarm = {
        w: between(sim, "test.two-propagator.gps.alarm", w[0] - 1.0, w[1]) > 0.5 for w in ((1200, 1260), (2400, 2462))
    }
    for window, what in zip(
        alarm, ("6 m on GPS from 1200 to 1260 s", "6 m sin(0.05 t) on GPS from 2400 s"), strict=True
    ):
        hit = alarm[window]
        found = window[0] + np.sort(hit.argmax(axis=0)[hit.any(axis=0)])
        late = int((between(sim, "test.two-propagator.gps.alarm", 1262.0, 1263.0) > 0.5).sum())
        tail = (
            f"; in alarm at 1263 s in {late}" if window[0] == 1200 else f"; by 2415 s in {int((found <= 2415).sum())}"
        )
        yield (
            f"yang-2016-scenario-1: {what}, first alarm",
            f"in {share(len(found), sim.runs)}, {found.min()} to {found.max()} s, median {np.median(found):g} s"
            f"{tail} {said(sim)}",
        )
    del sim
    second = _hour("yang-2016-scenario-2", 5, seed, until=2880.0)
    rates = [
        100 * between(second, "test.two-propagator.cns.alarm", *w).mean() for w in ((2760.0, 2879.0), (2099.0, 2400.0))
    ]
    yield (
        "yang-2016-scenario-2: star tracker 3 arcsec too much",
        f"alarms in {rates[0]:.2f} % of the epochs from 2761 to 2879 s, {rates[1]:.2f} % from 2100 to 2400 s "
        f"{said(second)}",
    )
    del second
    visible = _hour("yang-2016-scenario-2-visible", 8, seed)
    weights = [between(visible, "weight.sins", *w).mean() for w in ((2762.0, 2850.0), (30.0, 1199.0))]
    everything = between(visible, "weight.gps-bd2-cns", 30.0, 1199.0)
    large = [between(visible, "probability.large", *w).mean() for w in ((600.0, 1199.0), (2760.0, 2880.0))]
    yield (
        "yang-2016-scenario-2-visible: weights and model probability",
        f"SINS alone {weights[0]:.2f} on average at 2762 to 2850 s, {weights[1]:.4f} at 30 to 1199 s; all three at "
        f"30 to 1199 s {everything.mean():.2f}, above 0.99 in {100 * (everything > 0.99).mean():.0f} % of the epochs; "
        f"large Q {large[0]:.3f} at 600 to 1199 s, {large[1]:.3f} at 2760 to 2880 s {said(visible)}",
    )


def _hour(name: str, runs: int, seed: int, until: float | None = None, calm: bool = False) -> Simulation:
    ready = Scenario.load(name)
    if calm:
        ready = ready.model_copy(update={"faults": ()})
    return Simulation(ready, runs=runs, seed=seed).advance(until=until)


PARTS: dict[str, Callable[[int | None], Iterable[Row]]] = {
    "zhang": zhang,
    "printed": printed,
    "integrity": integrity,
    "outage": outage,
    "chey": chey,
    "kim": kim,
    "yang": yang,
}


def main() -> None:
    """Print the rows asked for, as they come."""
    parser = argparse.ArgumentParser(prog="python -m tests.papers", description="the README's results, measured again")
    parser.add_argument("rows", nargs="*", metavar="ROWS", help=f"of {', '.join(PARTS)}; all if none is named")
    parser.add_argument("--seed", type=int, default=None, help="instead of each scenario's own")
    given = parser.parse_args()
    unknown = [name for name in given.rows if name not in PARTS]
    if unknown:
        parser.error(f"no rows {', '.join(unknown)}; there are {', '.join(PARTS)}")
    for name in given.rows or PARTS:
        for title, measured in PARTS[name](given.seed):
            print(f"| {title} | {measured} |", flush=True)


if __name__ == "__main__":
    main()
