"""How soon things happen, in seconds at the reference machine's pace. A machine shared with others is late at times, so
each is measured up to three times."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable

import httpx
import pytest
import websockets
from rest_lab import API

from ftcore import Scenario
from server.app import SWITCH_INTERVAL
from server.registry import ExperimentRegistry
from server.settings import REPOSITORY, Settings
from server.uploads import Uploads
from tests.bench.measure import pace, reached

pytestmark = pytest.mark.alone


def percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def at_best(measure: Callable[[], Awaitable[float]], limit: float) -> None:
    """All of it is work that waits for other work: ten times slower a machine, ten times later."""
    said = []
    for _ in range(3):
        before, late = pace(), asyncio.run(measure())
        slower = max(1.0, 0.5 * (before + pace()))
        said.append(f"{late:.3f} s, {late / slower:.3f} s at the reference pace (pace {slower:.2f})")
        if late / slower <= limit:
            print(said[-1])
            return
    reached(False, f"wanted at most {limit} s, measured {'; '.join(said)}")


def test_from_inject_to_the_event_on_the_stream_at_ten_times_the_pace() -> None:
    command = [sys.executable, "-c", "from server.cli import main; main()", "serve", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=REPOSITORY, bufsize=1)
    try:
        assert process.stdout is not None
        base = process.stdout.readline().split()[2].rstrip("/")
        at_best(lambda: _inject_to_event(base), 0.100)
    finally:
        process.terminate()
        process.wait(10)


async def _inject_to_event(base: str) -> float:
    """95th percentile [s] of 25 injections into the first system at 10x, 60 signals subscribed."""
    async with httpx.AsyncClient(base_url=base + API, timeout=10.0) as client:
        for _ in range(100):
            try:
                await client.get("/health")
                break
            except httpx.HTTPError:
                await asyncio.sleep(0.1)
        id = (await client.post("/experiments", json={"scenario": "zhang-1992"})).json()["id"]
        asked, heard = {}, {}
        async with websockets.connect(f"{base.replace('http', 'ws')}{API}/experiments/{id}/stream") as socket:
            hello = json.loads(await socket.recv())
            names = [signal["name"] for signal in hello["signals"]][:60]
            await socket.send(json.dumps({"type": "subscribe", "signals": names}))
            await client.patch(f"/experiments/{id}/clock", json={"state": "running", "speed": 10})

            async def listen() -> None:
                async for text in socket:
                    message = json.loads(text)
                    if message["type"] == "frames":
                        await socket.send(json.dumps({"type": "ack", "time": message["time"][-1]}))
                    elif message["type"] == "event" and message["kind"] == "fault.injected":
                        heard[message["detail"]["id"]] = time.perf_counter()

            listening = asyncio.create_task(listen())
            for k in range(25):
                await asyncio.sleep(0.07)
                asked[f"k{k}"] = time.perf_counter()
                fault = {"id": f"k{k}", "channel": "gps.pseudorange.C1", "kind": "bias", "magnitude": 1.0}
                await client.post(f"/experiments/{id}/faults", json=fault)
            await asyncio.sleep(0.3)
            listening.cancel()
        await client.delete(f"/experiments/{id}")
    assert set(asked) <= set(heard)
    return percentile([heard[k] - asked[k] for k in asked], 0.95)


def test_the_event_loop_stays_free_while_experiments_race() -> None:
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        at_best(_loop_lag, 0.050)
    finally:
        sys.setswitchinterval(before)


async def _loop_lag() -> float:
    """99th percentile [s] of how late the loop wakes while two experiments race and ten keep pace."""
    uploads = Uploads(1000)
    registry = ExperimentRegistry(Settings(), uploads)
    scenario = Scenario.load("zhang-1992").model_copy(update={"duration": 3000.0})
    experiments = [await registry.create(scenario) for _ in range(12)]
    for k, experiment in enumerate(experiments):
        experiment.set_clock("running", "max" if k < 2 else 1.0)
    late, end = [], time.perf_counter() + 1.5
    while time.perf_counter() < end:
        asleep = time.perf_counter()
        await asyncio.sleep(0.005)
        late.append(time.perf_counter() - asleep - 0.005)
    await registry.close()
    uploads.close()
    return percentile(late, 0.99)
