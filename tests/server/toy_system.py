"""A fifth system, known to nobody: a drifting point watched by one threshold test.

It costs microseconds an epoch, uses every kind of scene item, and can be told to fail. That server and routes serve it
unchanged shows that they know no system by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from pydantic import Field

from ftcore.description import (
    Block,
    BlockView,
    Channel,
    Chart,
    ItemView,
    SceneItem,
    Signal,
    Subsystem,
    SystemDescription,
    Test,
    Trace,
    View,
    Wire,
)
from ftcore.faults import ALL_KINDS
from ftcore.readings import Group, Readings
from ftcore.systems.base import Assembly, Controls, Form, Output

EPOCH = 0.1


class Parameters(Form):
    fails_at: int | None = Field(default=None, ge=0, description="epoch at which the plant breaks down")
    seconds_per_epoch: float = Field(default=0.0, ge=0.0, le=1.0, description="time an epoch takes, for pace tests")


class Settings(Form):
    threshold: float = Field(default=4.0, gt=0.0, le=100.0)


DESCRIPTION = SystemDescription(
    id="toy",
    title="Toy",
    summary="A point and one sensor.",
    source="tests",
    epoch=EPOCH,
    channels=(
        Channel(
            name="ruler.position.x",
            label="ruler",
            unit="m",
            sensor="ruler",
            group="ruler.position",
            parts=(0,),
            kinds=ALL_KINDS,
            typical=10.0,
        ),
        Channel(
            name="ruler.position.y",
            label="ruler y",
            unit="m",
            sensor="ruler",
            group="ruler.position",
            parts=(1,),
            kinds=("bias", "ramp"),
            typical=10.0,
        ),
    ),
    subsystems=(Subsystem(name="ruler", label="ruler"),),
    estimators={"fused": "fused"},
    tests=(Test(name="size", label="size", subjects=("ruler",), dof="1", source="tests", probability="exact"),),
    signals=(
        Signal(name="fused.error.position.x", label="error", unit="m", group="error"),
        Signal(name="fused.error.angle", label="angle", unit="deg", group="error"),
        Signal(name="test.size.ruler.statistic", label="statistic", unit="1", group="test"),
        Signal(name="test.size.ruler.alarm", label="alarm", unit="1", group="test"),
        Signal(name="gap", label="a signal without a value", unit="1", group="other"),
        *(Signal(name=f"extra.{i}", label=f"extra {i}", unit="1", group="other") for i in range(100)),
    ),
    charts=(
        Chart(
            id="error",
            title="Error",
            unit="m",
            group="errors",
            shown=True,
            traces=(Trace(signal="fused.error.position.x", label="error", role="protected"),),
        ),
    ),
    blocks=(Block(id="ruler", label="Ruler", kind="sensor", x=1, y=1, sensor="ruler", subsystem="ruler"),),
    wires=(Wire(source="ruler", target="ruler"),),
    scene=tuple(
        SceneItem(id=kind, label=kind, kind=kind, frame=frame, family=kind)
        for kind, frame in (
            ("axis", "body"),
            ("spin", "body"),
            ("plane", "body"),
            ("vector", "body"),
            ("line-of-sight", "level"),
            ("aircraft", "level"),
            ("path", "level"),
        )
    ),
    settings_schema=Settings.model_json_schema(),
    parameters_schema=Parameters.model_json_schema(),
    score_headline=("fused.error.position.x",),
)


@dataclass(frozen=True)
class Plant:
    parameters: Parameters
    noise: Any

    def initial(self) -> float:
        return 0.0

    def step(self, state: float, epoch: int, command: Any) -> tuple[float, float, Readings]:
        if self.parameters.fails_at == epoch:
            raise ArithmeticError("the toy broke, as it was told to")
        if self.parameters.seconds_per_epoch:
            import time

            time.sleep(self.parameters.seconds_per_epoch)
        truth = state + EPOCH
        clean = truth + self.noise.normal("ruler", epoch, (2,))
        runs = len(self.noise.runs)
        clean = np.broadcast_to(clean, (runs, 2)).copy()
        group = Group(clean, np.ones((runs, 2), bool), np.array(epoch * EPOCH))
        return truth, truth, Readings(epoch * EPOCH, {"ruler.position": group}, ())


class Navigator:
    def initial(self, controls: Controls) -> float:
        return 0.0

    def step(self, state: float, readings: Readings, controls: Controls) -> tuple[float, Output]:
        value = np.abs(readings["ruler.position"].values[:, :1] - readings.time)
        alarm = value > controls.settings.threshold
        runs = len(value)
        return state, Output(
            statistic=value,
            threshold=np.full((runs, 1), controls.settings.threshold),
            dof=np.ones((runs, 1)),
            alarm=alarm,
            health=np.where(alarm, 2, 0).astype(np.int8),
            used=~alarm,
            notices=(),
            detail=readings["ruler.position"].values[:, :1] - readings.time,
        )


class Reporter:
    def row(self, truth: float, output: Output) -> np.ndarray:
        error = output.detail
        runs = len(error)
        rest = error * np.arange(1.0, 101.0)
        columns = [error, error * 1e-3, output.statistic, output.alarm.astype(float), np.full((runs, 1), np.nan), rest]
        return np.concatenate(columns, axis=1)

    def view(self, time: float, truth: Any, output: Output | None, controls: Controls, faulted: frozenset[str]) -> View:
        health = "faulted" if faulted else "ok"
        turn = 0.1 * time
        items = {
            "axis": ItemView(vector=(1.0, 0.0, 0.0), health=health),
            "spin": ItemView(vector=(0.0, 0.8, 0.0)),
            "plane": ItemView(vector=(0.0, 0.6, 0.8)),
            "vector": ItemView(vector=(np.cos(turn), np.sin(turn), 0.3), visible=output is not None),
            "line-of-sight": ItemView(vector=(1.0, 1.0, 1.5)),
            "aircraft": ItemView(rotation=(np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))),
            "path": ItemView(vector=(0.1 * time, 0.0, 0.5)),
        }
        return View(time=time, blocks={"ruler": BlockView(health=health, text=f"{time:.1f} s")}, items=items)


class Toy:
    description = DESCRIPTION
    Parameters = Parameters
    Settings = Settings

    def assemble(self, parameters: Any, duration: float, runs: range, noise: Any) -> Assembly:
        return Assembly(Plant(parameters, noise), Navigator(), Reporter(), (("size", "ruler"),), ("ruler",))

    def headline(self, signals: Mapping[str, Any], run: int) -> list[dict[str, Any]]:
        return []


def scenario(**changes: Any) -> dict[str, Any]:
    """A toy scenario document."""
    return {"id": "toy", "title": "Toy", "system": "toy", "duration": 60.0, "seed": 3} | changes


NOTHING: Mapping[str, Any] = MappingProxyType({})
