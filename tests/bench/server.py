"""How soon a server answers: a command's event on the stream, the event loop's lag, twenty flights at their pace.

These are seconds of the wall, of work that waits for other work: run it on a machine that does nothing else.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

import httpx
import websockets

from ftcore import Scenario
from server.app import SWITCH_INTERVAL
from server.registry import ExperimentRegistry
from server.settings import REPOSITORY, Settings
from server.uploads import Uploads
from tests.bench.measure import Figure, percentile

API = "/api/v1"


@contextmanager
def served() -> Iterator[str]:
    """Address of a server of its own, in a process of its own."""
    command = [sys.executable, "-c", "from server.cli import main; main()", "serve", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=REPOSITORY, bufsize=1)
    try:
        assert process.stdout is not None
        base = process.stdout.readline().split()[2].rstrip("/")
        for _ in range(300):
            try:
                httpx.get(f"{base}{API}/health")
                break
            except httpx.HTTPError:
                time.sleep(0.1)
        yield base
    finally:
        process.terminate()
        process.wait(10)


async def inject_to_event(base: str) -> list[float]:
    """Delays [s] of 25 injections into the first system at 10x, 60 signals subscribed."""
    async with httpx.AsyncClient(base_url=base + API, timeout=10.0) as client:
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
            await asyncio.sleep(1.0)
            listening.cancel()
        await client.delete(f"/experiments/{id}")
    return [heard[k] - asked[k] for k in asked]


async def loop_lag() -> list[float]:
    """How late [s] the loop wakes while two experiments race and ten keep pace."""
    uploads = Uploads(1000)
    registry = ExperimentRegistry(Settings(), uploads)
    scenario = Scenario.load("zhang-1992").model_copy(update={"duration": 3000.0})
    experiments = [await registry.create(scenario) for _ in range(12)]
    for k, experiment in enumerate(experiments):
        experiment.set_clock("running", "max" if k < 2 else 1.0)
    late, end = [], time.perf_counter() + 3.0
    while time.perf_counter() < end:
        asleep = time.perf_counter()
        await asyncio.sleep(0.005)
        late.append(time.perf_counter() - asleep - 0.005)
    await registry.close()
    uploads.close()
    return late


def pace_of(base: str, count: int, seconds: float) -> float:
    """Least share of what was due that any of ``count`` flights at 1x has flown in ``seconds``."""
    with httpx.Client(base_url=base + API, timeout=30.0) as client:
        ids = [client.post("/experiments", json={"scenario": "zhang-1992"}).json()["id"] for _ in range(count)]
        for id in ids:
            client.patch(f"/experiments/{id}/clock", json={"state": "running", "speed": 1})
        begun = {id: (time.monotonic(), _flown(client, id)) for id in ids}
        time.sleep(seconds)
        # What is flown comes in whole epochs of a second, so up to one is under way at either end.
        shares = [(_flown(client, id) - at + 1.0) / (time.monotonic() - then) for id, (then, at) in begun.items()]
        for id in ids:
            client.delete(f"/experiments/{id}")
    return min(1.0, *shares)


def _flown(client: httpx.Client, id: str) -> float:
    return float(client.get(f"/experiments/{id}").json()["clock"]["time"])


def figures() -> list[Figure]:
    """Latency and pace."""
    with served() as base:
        delays = asyncio.run(inject_to_event(base))
        held = pace_of(base, 20, 8.0)
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        lag = asyncio.run(loop_lag())
    finally:
        sys.setswitchinterval(before)
    late, woken = percentile(delays, 0.95), percentile(lag, 0.99)
    return [
        Figure(
            "server",
            "inject to the event on the stream at 10x, 95th percentile",
            1e3 * late,
            "ms",
            100.0,
            "most",
            f"median {1e3 * median(delays):.0f} ms, wall",
        ),
        Figure(
            "server",
            "event loop's lag, two flights racing, ten at 1x, 99th percentile",
            1e3 * woken,
            "ms",
            50.0,
            "most",
            f"median {1e3 * median(lag):.1f} ms, wall",
        ),
        Figure("server", "20 flights at 1x: least share of what was due", 100.0 * held, "%", 99.0),
    ]
