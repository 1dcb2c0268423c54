"""The clock: it keeps its pace, alone and in company, and whoever commands gets in between.

Nothing here looks at the machine's clock: pace is counted in epochs against a clock that the test moves by hand. How
fast a machine really is, `make bench` says.
"""

from __future__ import annotations

import asyncio
import time
from itertools import pairwise

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from hand_clock import HandClock, laboratory
from rest_lab import Flight, wait_until

from ftcore import Fault, Scenario, commands
from server.commands import Clock
from server.experiments import Experiment
from server.pacing import SLIP, Pacer


def flown(flight: Flight) -> float:
    return float(flight.get()["clock"]["time"])


def epochs(experiment: Experiment) -> int:
    return experiment._simulation.epoch


def test_given_ten_seconds_at_five_times_real_time_then_fifty_seconds_are_flown_and_none_while_paused() -> None:
    """By a clock of its own: an epoch of the toy lasts 0.1 s, so 50 a second are due."""

    async def story() -> None:
        clock = HandClock()
        async with laboratory(clock) as registry:
            experiment = await registry.create(Scenario.model_validate(toy.scenario(duration=100.0)))
            await experiment.do(Clock(time=0.0, state="running", speed=5.0))
            for tenth in range(1, 101):
                await clock.move(0.1, [experiment])
                assert epochs(experiment) == 5 * tenth
            await experiment.do(Clock(time=50.0, state="paused"))
            await asyncio.sleep(0.01)
            clock.time += 3.0
            await asyncio.sleep(0.01)
            assert epochs(experiment) == 500

    asyncio.run(story())


def test_the_speed_can_be_changed_in_flight(flight: Flight) -> None:
    flight.do("PATCH", "/clock", {"state": "running", "speed": 0.5})
    assert flight.do("PATCH", "/clock", {"speed": "max"})["clock"]["speed"] == "max"
    wait_until(lambda: flight.get()["clock"]["state"] == "finished")
    assert flown(flight) == 60.0


def test_given_a_running_experiment_when_it_is_advanced_then_it_keeps_its_pace_from_where_it_is() -> None:
    """Not standing still until the time flown by hand has gone by, nor racing after it."""

    async def story() -> None:
        clock = HandClock()
        async with laboratory(clock) as registry:
            experiment = await registry.create(Scenario.model_validate(toy.scenario()))
            await experiment.do(Clock(time=0.0, state="running", speed=1.0))
            await clock.settled([experiment])
            await experiment.do(commands.Advance(time=0.0, epochs=300))
            assert experiment.describe(experiment._simulation).clock.state == "running"
            await clock.move(0.1, [experiment])  # finds itself elsewhere, and counts from here
            at = epochs(experiment)
            assert 300 <= at <= 301
            await clock.move(1.0, [experiment])
            assert epochs(experiment) == at + 10
            await experiment.do(commands.Inject(time=experiment.now, fault=toy_fault()))
            await experiment.do(commands.Rewind(time=experiment.now, to=2.0))
            assert experiment.describe(experiment._simulation).clock.state == "paused"
            clock.time += 5.0
            await asyncio.sleep(0.01)
            assert epochs(experiment) == 20

    asyncio.run(story())


def toy_fault() -> Fault:
    return Fault(channel="ruler.position.x", kind="bias", magnitude=1.0)


def test_a_clock_that_fails_says_why(client: TestClient) -> None:
    flight = Flight(client, toy.scenario(parameters={"fails_at": 3}))
    flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
    wait_until(lambda: flight.get()["clock"]["state"] == "failed")
    assert flight.get()["clock"]["reason"].startswith("ArithmeticError")


def test_given_twenty_experiments_at_their_own_speeds_then_each_flies_what_is_due() -> None:
    async def story() -> None:
        clock = HandClock()
        async with laboratory(clock) as registry:
            fleet = [await registry.create(Scenario.model_validate(toy.scenario())) for _ in range(20)]
            for k, experiment in enumerate(fleet):
                await experiment.do(Clock(time=0.0, state="running", speed=1.0 + k % 4))
            await clock.settled(fleet)
            for _ in range(8):
                await clock.move(0.5, fleet)
            assert [epochs(e) for e in fleet] == [40 * (1 + k % 4) for k in range(20)]

    asyncio.run(story())


def test_given_a_flight_at_full_speed_then_a_command_waits_for_one_slice_at_most() -> None:
    """A look at this clock costs 4 ms and a slice lasts 12 ms, so a slice ends after three epochs.

    The command is given while a slice is under way: that slice ends, and the command comes before the next one.
    """

    async def story() -> None:
        async with laboratory(HandClock(tick=0.004)) as registry:
            racer = await registry.create(Scenario.model_validate(toy.scenario(duration=3000.0)))
            await racer.do(Clock(time=0.0, state="running", speed="max"))
            for _ in range(20):
                while epochs(racer) == 0:
                    await asyncio.sleep(0)
                asked = epochs(racer)
                done = (await racer.do(commands.Clear(time=0.0))).state.clock.epoch
                assert asked <= done <= asked + 4, "the slice under way, of three epochs, and the one being flown"
                await asyncio.sleep(0.002)
            assert not racer._simulation.finished, "it was racing all the time"

    asyncio.run(story())


def test_due_epochs_do_not_drift() -> None:
    pacer = Pacer(period=1.0, speed=10.0, epoch=0, now=100.0)
    epoch = 0
    for k in range(1, 1001):
        now = 100.0 + 0.1 * k + 0.03  # woken late every time
        assert pacer.wait(epoch, now) == 0.0
        due = pacer.due(epoch, now)
        assert due == k
        epoch = due
        pacer.flown(epoch)


def test_a_flight_that_cannot_keep_up_gives_up_what_it_missed() -> None:
    pacer = Pacer(period=1.0, speed=10.0, epoch=0, now=0.0)
    due = pacer.due(0, 50.0)
    assert due == int(SLIP * 10.0)
    pacer.flown(due)
    assert pacer.wait(due, 50.0) == pytest.approx(0.1)


def test_a_flight_that_was_moved_is_paced_from_where_it_is() -> None:
    pacer = Pacer(period=1.0, speed=1.0, epoch=0, now=0.0)
    assert pacer.due(0, 1.5) == 1
    pacer.flown(1)
    assert pacer.due(90, 2.5) == 90
    assert pacer.due(90, 3.5) == 91


def test_a_slow_flight_is_not_taken_for_a_late_one() -> None:
    pacer = Pacer(period=1.0, speed=0.5, epoch=0, now=0.0)
    for epoch in range(10):
        assert pacer.due(epoch, 2.0 * epoch + 2.1) == epoch + 1
        pacer.flown(epoch + 1)


def test_a_pacer_at_full_speed_never_waits() -> None:
    pacer = Pacer(period=1.0, speed="max", epoch=0, now=0.0)
    assert pacer.due(0, 0.0) is None
    assert pacer.wait(0, 0.0) == 0.0


def test_events_of_a_running_flight_are_in_order(client: TestClient) -> None:
    flight = Flight(client, toy.scenario(settings={"threshold": 1.0}))
    flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
    time.sleep(0.3)
    flight.do("PATCH", "/clock", {"state": "paused"})
    events = flight.get("/events")
    assert [event["index"] for event in events] == list(range(len(events)))
    assert all(a["time"] <= b["time"] for a, b in pairwise(events))
