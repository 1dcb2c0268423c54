"""The parts compose: every driving test with every master and every IMU, and with them every mode and integrity.

Each combination flies until half a minute after its last fault, system A a whole one, and must end finite, with the
right subject isolated where its driver can see it, and *consistent*: the position within SIGMAS of its own sigma, and
NEES of the nine navigation states, over all runs, within the band of chi-square. Where nobody guards the estimate the
same band must be left while the fault lasts, which shows that it can be.

All combinations of all settings are many (`long`). The normal suite flies every driving test with every master and
every IMU; the other settings are chosen so that any two choices meet at least once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from ftcore import Fault, Scenario, Simulation
from tests.settings import that_matter

Choices = Mapping[str, tuple[str, ...]]
Combination = dict[str, str]

SECONDS, RUNS, SEED = 140.0, 4, 5
P_BAND = 1e-6
"""How often a flight that is consistent leaves the band of NEES."""
SIGMAS, SIGMAS_AFTERWARDS = 5.5, 4.0
"""One of three axes of RUNS runs is further off than these in 5e-7, and in 8e-4, of epochs."""


def every(choices: Choices) -> Iterator[Combination]:
    """All combinations."""
    for values in product(*choices.values()):
        yield dict(zip(choices, values, strict=True))


def covering(choices: Choices, whole: Choices) -> list[Combination]:
    """Every combination of the choices in ``whole``, with the others such that every two choices of different settings
    meet; greedily the one with most new pairs, and what is missing then besides."""

    def pairs(combination: Combination) -> set[tuple[tuple[str, str], ...]]:
        return set(combinations(sorted(combination.items()), 2))

    candidates = list(every(choices))
    missing = set().union(*map(pairs, candidates))
    chosen = []

    def choose(among: list[Combination]) -> None:
        best = max(among, key=lambda c: len(pairs(c) & missing))
        missing.difference_update(pairs(best))
        chosen.append(best)

    for needed in every(whole):
        choose([c for c in candidates if needed.items() <= c.items()])
    while missing:
        choose(candidates)
    return chosen


def few_at_once(chosen: list[Combination], quick: int = 5) -> list[Any]:
    """The same as parameters of a test: ``quick`` of them spread over the list, the others among the long tests."""
    every_so_many = max(1, len(chosen) // quick)
    return [
        pytest.param(combination, marks=[] if i % every_so_many == 0 else [pytest.mark.long])
        for i, combination in enumerate(chosen)
    ]


def name(combination: Combination) -> str:
    return "-".join(combination.values())


def assert_finite(sim: Simulation, may_lack: tuple[str, ...]) -> None:
    """Numbers wherever there should be some; a test has a statistic just where it had something to judge."""
    for signal, column in sim.recording.column.items():
        finite = np.isfinite(sim.recording.rows[..., column])
        stem, _, part = signal.rpartition(".")
        if signal.startswith("test.") and part in ("statistic", "threshold"):
            judged = sim[f"{stem}.dof"] > 0
            assert finite[judged].all(), signal
            assert part == "threshold" or not finite[~judged].any(), signal
        elif not signal.startswith(may_lack):
            assert finite.all(), signal


def changed(sim: Simulation, what: str, subject: str, start: float, end: float = np.inf) -> bool:
    """Whether this subject was isolated, or readmitted, in every run at start <= t <= end."""
    kind = f"subsystem.{what}"
    times = [(e.run, e.time) for e in sim.events if e.kind == kind and e.subject == subject]
    return len({run for run, time in times if start - 1e-9 <= time <= end + 1e-9}) == sim.runs


def isolated(sim: Simulation, subject: str, start: float, end: float) -> bool:
    return changed(sim, "isolated", subject, start, end)


def ever_isolated(sim: Simulation) -> set[str]:
    return {e.subject for e in sim.events if e.kind == "subsystem.isolated"}


def back_while_faulty(sim: Simulation, subject: str, start: float, end: float) -> bool:
    """Whether this subject was readmitted in any run while its fault lasted."""
    return any(
        e.kind == "subsystem.readmitted" and e.subject == subject and start < e.time < end - 1e-9 for e in sim.events
    )


def nees(sim: Simulation, time: float) -> float:
    """NEES of the fused estimate, over all runs, in units of the upper end of its band."""
    mean = sim["fused.nees"][np.searchsorted(sim.time, time - 1e-9)].mean()
    return float(mean / (chi2.isf(P_BAND / 2.0, 9 * RUNS) / RUNS))


LOWEST = chi2.ppf(P_BAND / 2.0, 9 * RUNS) / chi2.isf(P_BAND / 2.0, 9 * RUNS)
"""The lower end of the band, in units of the upper one."""


def assert_consistent(sim: Simulation, time: float, sigmas: float = SIGMAS) -> None:
    """The fused estimate is as good as it says, no worse and not much better."""
    assert LOWEST < nees(sim, time) < 1.0, f"NEES at {time:g} s is {nees(sim, time):g} of what chance allows"
    epoch = np.searchsorted(sim.time, time - 1e-9)
    for part in ("east", "north", "up"):
        error, sigma = sim[f"fused.error.position.{part}"][epoch], sim[f"fused.sigma.position.{part}"][epoch]
        assert (np.abs(error) < sigmas * sigma).all(), f"{part} at {time:g} s: {error} of {sigma}"


# ---- SINS/GPS/Doppler: an accelerometer fails at 30 s, a satellite from 50 to 80 s

DOPPLER_SYSTEM: Choices = {
    "master": ("federated", "covariance-intersection", "tolerant"),
    "driving_test": ("residual", "state", "two-propagator", "glr", "cusum", "none"),
    "imu_driving_test": ("glt", "parity", "none"),
    "fusion_mode": ("fusion-reset", "no-reset", "zero-reset", "rescale"),
    "satellite_integrity": ("off", "snapshot", "innovation"),
}
PROMPT = ("residual", "two-propagator", "glr", "cusum")
"""Tests that see 100 m within seconds; the state test is blind to it. Then the estimate is cleaned a few epochs later,
because it contradicts GPS; while the fault lasts it may be wrong for those."""


def fly_doppler_system(combination: Combination) -> Simulation:
    scenario = Scenario.load("zhang-1992-visible").model_copy(
        update={
            "duration": SECONDS,
            "settings": combination,
            "faults": (
                Fault(channel="imu.accelerometer.3y", kind="bias", magnitude=1.0, unit="mg", start=30.0),
                Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=100.0, start=50.0, end=80.0),
            ),
        }
    )
    return Simulation(scenario, runs=RUNS, seed=SEED).advance()


def check_doppler_system(combination: Combination) -> None:
    sim = fly_doppler_system(combination)
    assert_finite(sim, ("discrepancy.", "reading.", "gps.hdop"))
    accused = ever_isolated(sim)
    whole = combination["satellite_integrity"] == "off"
    imu_guarded = combination["imu_driving_test"] != "none"
    prompt = not whole or combination["driving_test"] in PROMPT
    gps_guarded = prompt or combination["driving_test"] != "none"

    assert isolated(sim, "imu.accelerometer.3", 30.0, 33.0) == imu_guarded
    if whole:
        assert isolated(sim, "gps", 50.0, 55.0) == (combination["driving_test"] in PROMPT)
    else:
        assert isolated(sim, "gps.C1", 50.0, 53.0)
        assert changed(sim, "readmitted", "gps.C1", 80.0)
    if imu_guarded:
        allowed = {"imu.accelerometer.3", "gps.C1"} | ({"gps"} if whole else set())
        # A state test that was blind to the fault sees its consequences when the filter has swallowed it.
        allowed |= {"gps", "doppler"} if combination["driving_test"] == "state" else set()
        assert accused <= allowed, accused
    if combination["driving_test"] in ("residual", "two-propagator"):
        assert sim["used.gps"][-1].all(), "GPS is in the master again"

    if prompt:
        assert not back_while_faulty(sim, "gps" if whole else "gps.C1", 50.0, 80.0)

    error = np.abs([sim[f"fused.error.position.{part}"] for part in ("east", "north", "up")])
    assert error.max() < 1000.0
    if imu_guarded and gps_guarded:
        # Doppler alone never learns its position: with no-reset, or the filters that are alone, it is all there is.
        alone = combination["fusion_mode"] == "no-reset" or combination["master"] == "covariance-intersection"
        assert error[:, 40:].max() < (400.0 if alone and whole else 25.0)
        for time in (49.0, 79.0) if prompt else (49.0,):
            assert_consistent(sim, time)
        assert_consistent(sim, SECONDS, SIGMAS_AFTERWARDS)
    else:
        assert max(nees(sim, 49.0), nees(sim, 79.0)) > 1.0


DOPPLER_MATRIX = {n: DOPPLER_SYSTEM[n] for n in ("master", "driving_test")} | {"imu_driving_test": ("glt",)}
"""Its IMU is always the redundant one: with its fault detection on, or nothing can be said of the estimate."""


@pytest.mark.parametrize("combination", few_at_once(covering(DOPPLER_SYSTEM, DOPPLER_MATRIX)), ids=name)
def test_given_any_combination_then_sins_gps_doppler_ends_finite_consistent_and_with_the_right_one_out(combination):
    """Four runs: a wrong isolation comes by chance in 2e-4 of runs."""
    check_doppler_system(combination)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_given_all_combinations_of_all_settings_then_sins_gps_doppler_ends_finite_and_consistent():
    """648 combinations."""
    wrong = {}
    for combination in every(DOPPLER_SYSTEM):
        try:
            check_doppler_system(combination)
        except AssertionError as error:
            wrong[name(combination)] = str(error)
    assert not wrong


# ---- SINS/GPS/BD2/CNS: an instrument of the redundant IMU fails at 30 s, GPS is 60 m off from 60 to 90 s

STAR_SYSTEM: Choices = {
    "master": ("tolerant", "federated"),
    "driving_test": ("two-propagator", "two-propagator-state", "none"),
    "configuration": ("three-axis", "redundant"),
    "fusion_mode": ("fusion-reset", "no-reset", "zero-reset", "rescale"),
    "exclusion": ("weights", "isolation"),
    "imu_driving_test": ("glt", "parity"),
}
STAR_SECONDS = 120.0
STAR_MATRIX = {name: STAR_SYSTEM[name] for name in ("master", "driving_test", "configuration")}


def fly_star_system(combination: Combination) -> Simulation:
    faults = [Fault(channel="gps.position.all", kind="bias", magnitude=60.0, start=60.0, end=90.0)]
    if combination["configuration"] == "redundant":
        faults.append(Fault(channel="imu.accelerometer.3y", kind="bias", magnitude=20.0, unit="mg", start=30.0))
    parameters = {"inertial": {"configuration": combination["configuration"]}}
    settings = {k: v for k, v in combination.items() if k != "configuration"}
    scenario = Scenario.model_validate(
        {
            "id": "composition",
            "title": "composition",
            "system": "sins-gps-bd2-cns",
            "seed": SEED,
            "duration": STAR_SECONDS,
            "parameters": parameters,
            "settings": that_matter("sins-gps-bd2-cns", parameters, settings),
        }
    ).model_copy(update={"faults": tuple(faults)})
    return Simulation(scenario, runs=RUNS).advance()


def check_star_system(combination: Combination) -> None:
    sim = fly_star_system(combination)
    redundant, driver = combination["configuration"] == "redundant", combination["driving_test"]
    assert_finite(sim, ("discrepancy.", "reading.", *(() if redundant else ("parity.",))))
    accused = ever_isolated(sim)
    assert isolated(sim, "imu.accelerometer.3", 30.0, 33.0) == redundant
    assert {subject for subject in accused if subject.startswith("imu")} <= {"imu.accelerometer.3"}
    # Three of four epochs confirm; the state form sees the fault a second or two after it came.
    assert isolated(sim, "gps", 60.0, 65.0) == (driver != "none")
    assert not back_while_faulty(sim, "gps", 60.0, 90.0)

    error = np.abs([sim[f"fused.error.position.{part}"] for part in ("east", "north", "up")])
    assert_consistent(sim, 59.0)
    if driver == "none":
        assert error.max() < 60.0, "two of the three know better"
        assert nees(sim, 89.0) > 1.0
        return
    # The state form sees the fault when the filter has taken it in; so much of it there is before that.
    late = driver == "two-propagator-state"
    assert error[:, 59:].max() < (15.0 if late else 5.0)
    for time in (89.0, STAR_SECONDS):
        assert_consistent(sim, time)


@pytest.mark.parametrize("combination", few_at_once(covering(STAR_SYSTEM, STAR_MATRIX)), ids=name)
def test_given_any_combination_then_sins_gps_bd2_cns_ends_finite_consistent_and_with_the_right_one_out(combination):
    check_star_system(combination)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_given_all_combinations_of_all_settings_then_sins_gps_bd2_cns_ends_finite_and_consistent():
    """192 combinations."""
    wrong = {}
    for combination in every(STAR_SYSTEM):
        try:
            check_star_system(combination)
        except AssertionError as error:
            wrong[name(combination)] = str(error)
    assert not wrong
