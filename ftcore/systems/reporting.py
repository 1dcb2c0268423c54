"""What the reporters of several systems do alike: columns of the recording, and the state of diagram and scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.description import BlockView, Health, ItemView, SystemDescription, View
from ftcore.parts.ledger import Layout, Ledger
from ftcore.systems.base import HEALTH, Controls, LeftOut, Notice, Output

Array = NDArray[np.float64]

LEVEL = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
"""Body to level for level flight to the north: what is shown before the first epoch."""


def healths(subjects: Sequence[str], output: Output | None, controls: Controls) -> dict[str, Health]:
    """Health of every subject in run 0; what the operator has switched off is off, whatever is thought of it."""
    found: dict[str, Health] = {subject: "ok" for subject in subjects}
    if output is not None:
        found |= {s: HEALTH[output.health[0, i]] for i, s in enumerate(subjects)}  # type: ignore[misc]
    return found | {name: "off" for name, on in controls.enabled.items() if not on}


def vector(v: Array) -> tuple[float, float, float]:
    """Three numbers of the scene."""
    return (float(v[0]), float(v[1]), float(v[2]))


def quaternion(C: Array) -> tuple[float, float, float, float]:
    """A rotation matrix ``(3, 3)`` as w, x, y, z."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(C).as_quat()
    return (float(w), float(x), float(y), float(z))


def output(
    say: Ledger, notices: Sequence[Notice] = (), command: Any = None, left_out: Mapping[str, LeftOut] | None = None
) -> Output:
    """What a navigator says at one epoch, once all its parts have written."""
    statistic, threshold, dof, alarm = (say.row[:, columns] for columns in say.layout.of_test.values())
    return Output(
        statistic=statistic,
        threshold=threshold,
        dof=dof,
        alarm=alarm > 0.0,
        health=say.health,
        used=say.used,
        notices=notices,
        detail=None,
        command=command,
        left_out=left_out or {},
        said=say,
    )


@dataclass(frozen=True)
class Now:
    """What the blocks of a diagram are drawn from, run 0.

    Attributes:
        said: by all parts, errors included; None before the first epoch, or while there is nothing to fly.
        controls: what the operator has set.
        health: of every subject, as the navigator sees it.
        faulted: names of the channels with a live fault.
    """

    said: Ledger | None
    controls: Controls
    health: Mapping[str, Health]
    faulted: frozenset[str]


class Reporter:
    """See :class:`ftcore.systems.base.Reporter`: numbers and pictures of a system that writes a ledger.

    Args:
        description: of the system.
        layout: of its ledger.
        errors: adds what follows from truth to the ledger: ``errors(truth, say)``.
        blocks: state of some blocks of the diagram, each: ``blocks(now)``. The others are shown as waiting.
        items: state of scene items that are marked by more than health and faults, each: ``items(now)``.
        fixed: scene item -> a vector that never changes, or those of its members.
        draw: adds what only a picture needs to the ledger: ``draw(time, truth, say)``.
    """

    def __init__(
        self,
        description: SystemDescription,
        layout: Layout,
        errors: Callable[[Any, Ledger], None],
        blocks: Sequence[Callable[[Now], dict[str, BlockView]]],
        items: Sequence[Callable[[Now], dict[str, Health]]] = (),
        fixed: Mapping[str, Array] | None = None,
        draw: Callable[[float, Any, Ledger], None] | None = None,
    ) -> None:
        self._description = description
        self._layout = layout
        self._errors = errors
        self._blocks = blocks
        self._items = items
        self._draw = draw
        self._fixed = layout.vectors(fixed or {})
        channels = {channel.name: channel for channel in description.channels}
        self._covers = {
            item.id: {
                other.name
                for other in description.channels
                if other.group == channels[item.channel].group and set(other.parts) >= set(channels[item.channel].parts)
            }
            if item.channel
            else set()
            for item in description.scene
        }

    def row(self, truth: Any, output: Output) -> Array:
        """``(runs, signals)``, SI."""
        return self.complete(truth, output).row

    def view(self, time: float, truth: Any, output: Output | None, controls: Controls, faulted: frozenset[str]) -> View:
        """Diagram and scene of run 0."""
        said = None if output is None else self.complete(truth, output)
        if said is not None and self._draw is not None:
            self._draw(time, truth, said)
        now = Now(said, controls, healths(self._layout.subjects, output, controls), faulted)
        blocks = {block.id: BlockView(health="ok", text="waiting") for block in self._description.blocks}
        for part in self._blocks:
            blocks |= part(now)
        return View(time=time, blocks=blocks, items=self._scene(now))

    def complete(self, truth: Any, output: Output) -> Ledger:
        """What was said, and what follows from truth."""
        assert output.said is not None
        said = output.said.copy()
        self._errors(truth, said)
        return said

    def _scene(self, now: Now) -> dict[str, ItemView]:
        vectors = self._fixed if now.said is None else self._fixed | self._layout.vectors(now.said.drawn)
        marks: dict[str, Health] = {}
        for part in self._items:
            marks |= part(now)
        found = {}
        for item in self._description.scene:
            thought = marks.get(item.id) or now.health.get(item.subject or "", "ok")
            broken = bool(self._covers[item.id] & now.faulted) and thought not in ("isolated", "off")
            health: Health = "faulted" if broken else thought
            if item.kind == "aircraft":
                turned = None if now.said is None else now.said.turned.get(item.id)
                found[item.id] = ItemView(rotation=LEVEL if turned is None else quaternion(turned), health=health)
                continue
            v = vectors.get(item.id)
            seen = v is not None and bool(np.isfinite(v).all())
            found[item.id] = ItemView(vector=vector(v) if v is not None and seen else None, health=health, visible=seen)
        return found


def sensor_block(now: Now, name: str, text: str) -> BlockView:
    """A sensor's block: switched off, faulted in how many channels, or what ``text`` says of it."""
    number = sum(channel.startswith(name + ".") for channel in now.faulted)
    off = not now.controls.enabled.get(name, True)
    note = f", {number} faulted" if number else ""
    return BlockView(health="off" if off else "faulted" if number else "ok", text="off" if off else text + note)


def supervisor_block(now: Now, trusted: str) -> BlockView:
    """Who is out, who is suspected; ``trusted``: what it says when nobody is."""
    isolated = [s.removeprefix("imu.") for s, state in now.health.items() if state == "isolated"]
    suspects = [s.removeprefix("imu.") for s, state in now.health.items() if state == "suspect"]
    if isolated:
        return BlockView(health="isolated", text=", ".join(isolated) + " out")
    if suspects:
        return BlockView(health="suspect", text="suspects " + ", ".join(suspects))
    return BlockView(health="ok", text=trusted)


def instruments_block(now: Now, cluster: str) -> BlockView:
    """The block of three 2-DOF gyros or accelerometers: how many of their six axes are used."""
    lost = [k for k in (1, 2, 3) if now.health[f"imu.{cluster}.{k}"] != "ok"]
    view = sensor_block(now, f"imu.{cluster}", f"{6 - 2 * len(lost)} of 6 axes")
    worst: Health = "isolated" if lost and view.health == "ok" else view.health
    return BlockView(health=worst, text=view.text)
