"""The same bits however many threads the BLAS may use, and the threads given back afterwards."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

from ftcore import Scenario, Simulation, threads
from ftcore.commands import FlightError
from ftcore.threads import one_blas_thread

REPOSITORY = Path(__file__).parents[2]
FLIGHT = """
import hashlib, sys
from ftcore import Scenario, Simulation
for runs in (1, 40):
    simulation = Simulation(Scenario.load(sys.argv[1]), runs=runs, seed=5).advance(epochs=int(sys.argv[2]))
    print(hashlib.sha256(simulation.recording.rows.tobytes()).hexdigest())
"""
"""As in a notebook: nothing is set, the simulation is stepped."""


def bits(threads: int, scenario: str, epochs: int) -> str:
    """Digests of a single flight and of a batch, flown by a process whose BLAS may use so many threads."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    command = [sys.executable, "-c", FLIGHT, scenario, str(epochs)]
    return subprocess.run(
        command, env=environment, cwd=REPOSITORY, check=True, capture_output=True, text=True, timeout=250
    ).stdout


class Library:
    """A BLAS that uses so many threads."""

    def __init__(self, threads: int) -> None:
        self.threads = threads

    def get_num_threads(self) -> int:
        return self.threads

    def set_num_threads(self, threads: int) -> None:
        self.threads = threads


def test_a_flight_and_a_batch_have_the_same_bits_on_one_thread_and_on_two() -> None:
    one = bits(1, "zhang-1992-visible", 2)
    assert len(one.split()) == 2
    assert bits(2, "zhang-1992-visible", 2) == one


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["zhang-1992-visible", "chey-2004", "kim-2005", "yang-2016-scenario-1"])
def test_every_system_has_the_same_bits_on_any_number_of_threads(scenario: str) -> None:
    one = bits(1, scenario, 12)
    assert bits(2, scenario, 12) == one
    assert bits(4, scenario, 12) == one


def test_one_thread_flies_and_the_others_are_given_back_by_whoever_leaves_last(monkeypatch: pytest.MonkeyPatch) -> None:
    libraries = (Library(8), Library(3), Library(1))
    monkeypatch.setattr(threads, "_libraries", lambda: libraries)

    def used() -> list[int]:
        return [library.threads for library in libraries]

    entered, leave = threading.Event(), threading.Event()

    def neighbour() -> None:
        with one_blas_thread:
            entered.set()
            leave.wait(10.0)

    other = threading.Thread(target=neighbour)
    with one_blas_thread:
        with one_blas_thread:
            other.start()
            assert entered.wait(10.0)
        assert used() == [1, 1, 1]
    assert used() == [1, 1, 1]  # the neighbour still flies
    leave.set()
    other.join()
    assert used() == [8, 3, 1]
    simulation = Simulation(Scenario.load("chey-2004"))
    seen: list[list[int]] = []
    monkeypatch.setattr(simulation, "_fly", lambda *_: seen.append(used()) or _stop())
    for look in (simulation.step, simulation.advance):
        with pytest.raises(FlightError):
            look()
    assert seen == [[1, 1, 1]] * 2
    assert used() == [8, 3, 1]


def _stop() -> None:
    raise InterruptedError


def test_every_blas_of_this_process_is_known() -> None:
    assert {library.filepath for library in threads._libraries()} == {
        library["filepath"] for library in threadpool_info() if library["user_api"] == "blas"
    }
