"""Truth and output to recorded numbers, and to the state of diagram and scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import BlockView, Health, ItemView, View
from ftcore.detection import ambiguity, geometry, parity
from ftcore.detection.geometry import Cluster
from ftcore.rotation import rpy_to_matrix
from ftcore.systems.base import Controls, Flags, Output
from ftcore.systems.redundant_imu.names import (
    AIR,
    AXES,
    FLOWN,
    GYRO,
    HEALTHY,
    INSTRUMENTS,
    PROTECTED,
    SUBJECTS,
    TESTS,
)
from ftcore.systems.redundant_imu.pictures import KILOMETRE
from ftcore.systems.redundant_imu.plant import RATES, Truth
from ftcore.systems.reporting import healths, quaternion, vector
from ftcore.world.aircraft import S

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Detail:
    """What the navigator hands to the reporter; aircraft as in :data:`names.FLOWN`.

    Attributes:
        p: ``(runs, 3)`` parity vector [rad/s].
        rates, rpy: ``(runs, aircraft, 3)`` rates handed to the control law, and attitude carried on with them.
        residual: ``(runs, 6)`` of the UKF, by axis [rad/s]; NaN where nobody is judged.
        active, open, tied: ``(runs,)`` the UKF runs, it works on a doubt, nobody can tell who is at fault.
        suspects: ``(runs, 3)`` whom it leaves out.
        doubted: ``(runs, 3)`` of whom it is not known whether they are at fault.
        from_model: ``(runs,)`` the rates are the UKF's.
        used: ``(runs, 3)`` gyros in the solution.
        u: ``(runs, aircraft, 4)`` controls commanded.
    """

    p: Array
    rates: Array
    rpy: Array
    residual: Array
    active: Flags
    open: Flags
    tied: Flags
    suspects: Flags
    doubted: Flags
    from_model: Flags
    used: Flags
    u: Array


class Reporter:
    """See :class:`ftcore.systems.base.Reporter`."""

    def __init__(self, cluster: Cluster, noise: float, start: Array) -> None:
        self._axes = cluster.H
        pairs = cluster.H.reshape(INSTRUMENTS, 2, 3)
        self._spin = np.cross(pairs[:, 0], pairs[:, 1])
        columns = cluster.V.T.reshape(INSTRUMENTS, 2, 3)
        normals = np.cross(columns[:, 0], columns[:, 1])
        self._normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        lines = {singular.instruments: singular.line for singular in geometry.singular_faults(cluster)}
        self._lines = [lines.get(pair) for pair in ((0, 1), (0, 2), (1, 2))]
        self._gnc, self._fdi = float(geometry.gnc_index(cluster.H)), float(geometry.fdi_index(cluster.H))
        self._expected = parity.uncalibrated(cluster, noise, 0.0)
        self._shares: dict[float, float] = {}
        self._start = start[0, HEALTHY, S.EAST : S.UP + 1]

    def row(self, truth: Truth, output: Output) -> Array:
        """``(runs, signals)``; the order is that of the description's signals."""
        d: Detail = output.detail
        x = truth.x
        runs = len(x)
        where = x[..., S.EAST : S.UP + 1]
        off = where - where[:, HEALTHY:]
        velocity = _velocity(x)
        angles = x[..., S.ROLL : S.HEADING + 1]
        turned = np.remainder(angles - angles[:, HEALTHY:] + np.pi, 2.0 * np.pi) - np.pi
        errors = np.concatenate([off, velocity - velocity[:, HEALTHY:], turned, d.rates - x[..., RATES]], axis=-1)
        distance = np.linalg.norm(off, axis=-1, keepdims=True)
        both = np.concatenate([errors, distance], axis=-1)[:, :HEALTHY].reshape(runs, -1)
        statistic = np.where(output.dof > 0.0, output.statistic, np.nan)  # nothing was judged there
        tests = np.stack([statistic, output.threshold, output.dof, output.alarm], axis=-1).reshape(runs, -1)
        flags = np.stack([d.active, d.open, d.tied, d.from_model], axis=-1)
        mine = x[:, PROTECTED]
        flight = mine[:, [S.SPEED, S.ALPHA, S.BETA, S.ROLL, S.PITCH, S.HEADING]].copy()
        flight[:, -1] = np.remainder(flight[:, -1], 2.0 * np.pi)
        index = np.broadcast_to([self._gnc, self._fdi], (runs, 2))
        return np.concatenate(
            [
                both,
                tests,
                d.p,
                d.residual,
                d.used,
                flags,
                (where - self._start).reshape(runs, -1),
                x[..., S.UP],
                flight,
                d.u[:, PROTECTED],
                index,
            ],
            axis=-1,
        )

    def view(
        self, time: float, truth: Truth | None, output: Output | None, controls: Controls, faulted: frozenset[str]
    ) -> View:
        """Diagram and scene of run 0."""
        health = healths(SUBJECTS, output, controls)
        return View(
            time=time,
            blocks=self._blocks(truth, output, controls, health, faulted),
            items=self._items(truth, output, health, faulted),
        )

    def _blocks(
        self,
        truth: Truth | None,
        output: Output | None,
        controls: Controls,
        health: dict[str, Health],
        faulted: frozenset[str],
    ) -> dict[str, BlockView]:
        settings = controls.settings
        blocks: dict[str, BlockView] = {}
        for k, subject in enumerate(SUBJECTS):
            broken = any(c.startswith(f"{GYRO}.{k + 1}") for c in faulted)
            state: Health = "faulted" if broken and health[subject] != "off" else health[subject]
            in_doubt = "in doubt" if output is not None and output.used[0, k] else "withheld"
            words = {"ok": "used", "suspect": in_doubt, "isolated": "isolated", "off": "off", "faulted": "faulted"}
            blocks[f"gyro-{k + 1}"] = BlockView(
                health=state, text=words[health[subject]] + (", fault" if broken else "")
            )
        lost = any(c.startswith(f"{AIR}.") for c in faulted)
        air: Health = "off" if not controls.enabled[AIR] else "faulted" if lost else "ok"
        blocks["air"] = BlockView(
            health=air, text="off" if air == "off" else "faulted" if lost else "speed, angles, height"
        )
        share = self._ambiguous_share(settings.angle_threshold)
        blocks["geometry"] = BlockView(health="ok", text=f"J_FDI {self._fdi:.2f}, J_GNC {self._gnc:.3f}")
        blocks["mission"] = BlockView(health="ok", text="climb, then turn" if truth is None else self._flying(truth))
        blocks["supervisor"] = BlockView(health="ok", text="all trusted")
        blocks["control"] = BlockView(health="ok", text="rates of 3 gyros")
        if output is None:
            blocks["detection"] = BlockView(health="ok", text="waiting")
            blocks["isolation"] = BlockView(health="ok", text=f"{100.0 * share:.0f} % of faults ambiguous")
            blocks["ukf"] = BlockView(health="off", text="rests" if settings.hybrid else "off")
            return blocks
        d: Detail = output.detail
        ratio = output.statistic[0, 0] / max(float(output.threshold[0, 0]), 1e-30)
        detected = bool(output.alarm[0, 0])
        blocks["detection"] = BlockView(health="suspect" if detected else "ok", text=f"FD at {ratio:.2f} of T_D")
        angle = TESTS.index(("isolation-angle", SUBJECTS[0]))
        declared = output.alarm[0, angle : angle + INSTRUMENTS]
        text = " ".join(f"{math.degrees(v):.0f}°" for v in output.statistic[0, angle : angle + INSTRUMENTS])
        blocks["isolation"] = BlockView(health="suspect" if declared.any() else "ok", text=f"FI {text}")
        isolated = [s[-1] for s in SUBJECTS if health[s] == "isolated"]
        suspects = [s[-1] for s in SUBJECTS if health[s] == "suspect"]
        if d.active[0]:
            text = "without gyros " + ", ".join(str(k + 1) for k in np.flatnonzero(d.suspects[0]))
            text = "cannot tell" if d.tied[0] else text if d.suspects[0].any() else "flies along"
            blocks["ukf"] = BlockView(health="suspect" if d.tied[0] else "ok", text=text)
        else:
            blocks["ukf"] = BlockView(health="off", text="rests" if settings.hybrid else "off")
        if isolated or suspects:
            out = f"gyro {', '.join(isolated)} out" if isolated else ""
            doubts = f"{'cannot tell: ' if d.tied[0] else 'doubts '}{', '.join(suspects)}" if suspects else ""
            both = "; ".join(text for text in (out, doubts) if text)
            blocks["supervisor"] = BlockView(health="isolated" if isolated else "suspect", text=both)
        number = int(d.used[0].sum())
        text = f"rates of {number} gyros" if number > 1 else ("gyro rates held", "1 gyro, third rate held")[number]
        blocks["control"] = BlockView(
            health="suspect" if d.from_model[0] or number < 2 or (d.used & d.doubted)[0].any() else "ok",
            text="rates of the UKF" if d.from_model[0] else text,
        )
        return blocks

    def _items(
        self, truth: Truth | None, output: Output | None, health: dict[str, Health], faulted: frozenset[str]
    ) -> dict[str, ItemView]:
        items: dict[str, ItemView] = {}
        for i, axis in enumerate(AXES):
            state = health[f"{GYRO}.{axis[0]}"]
            if state not in ("isolated", "off") and f"{GYRO}.{axis}" in faulted:
                state = "faulted"
            items[f"axis.{axis}"] = ItemView(vector=vector(self._axes[i]), health=state)
        for k in range(INSTRUMENTS):
            items[f"spin.{k + 1}"] = ItemView(vector=vector(0.8 * self._spin[k]))
            items[f"plane.{k + 1}"] = ItemView(vector=vector(self._normals[k]), health=self._plane(k, output, health))
        for name, line in zip(("12", "13", "23"), self._lines, strict=True):
            items[f"singular.{name}"] = ItemView(
                vector=None if line is None else vector(0.7 * line), visible=line is not None
            )
        parity_vector, detected = (0.0, 0.0, 0.0), False
        if output is not None:
            p = output.detail.p[0]
            ratio = math.sqrt(output.statistic[0, 0] / max(float(output.threshold[0, 0]), 1e-30))
            parity_vector = vector(p / max(float(np.linalg.norm(p)), 1e-30) * min(ratio, 1.6))
            detected = bool(output.alarm[0, 0])
        items["parity"] = ItemView(
            vector=parity_vector, health="suspect" if detected else "ok", visible=output is not None
        )
        # The parity vector is drawn in units of its threshold: detection is leaving this ball.
        items["threshold"] = ItemView(vector=(0.0, 0.0, 1.0))
        for a, name in enumerate(FLOWN):
            point = None
            if truth is not None:
                point = vector((truth.x[0, a, S.EAST : S.UP + 1] - self._start) / KILOMETRE)
            items[f"path.{name}"] = ItemView(vector=point, visible=truth is not None)
        turned = (1.0, 0.0, 0.0, 0.0)
        if truth is not None:
            turned = quaternion(rpy_to_matrix(truth.x[0, PROTECTED, S.ROLL : S.HEADING + 1]))
        items["aircraft"] = ItemView(rotation=turned)
        return items

    def _plane(self, k: int, output: Output | None, health: dict[str, Health]) -> Health:
        """A fault plane is marked while the angle test declares its gyro, and where the gyro is out."""
        if health[SUBJECTS[k]] in ("isolated", "off"):
            return health[SUBJECTS[k]]
        declared = output is not None and output.alarm[0, TESTS.index(("isolation-angle", SUBJECTS[k]))]
        return "suspect" if declared else "ok"

    def _flying(self, truth: Truth) -> str:
        x = truth.x[0, PROTECTED]
        if x[S.UP] <= 0.0:
            return "on the ground"
        return f"bank {round(math.degrees(x[S.ROLL]))}°, {x[S.UP]:.0f} m"

    def _ambiguous_share(self, degrees: float) -> float:
        """Share of all directions of a fault that the angle test cannot place."""
        if degrees not in self._shares:
            self._shares[degrees] = float(ambiguity.ambiguity_map(self._expected, math.radians(degrees))[2].mean())
        return self._shares[degrees]


def _velocity(x: Array) -> Array:
    """Velocity ``(..., 3)``, east, north, up [m/s], of states ``(..., 13)``."""
    V, alpha, beta = x[..., S.SPEED], x[..., S.ALPHA], x[..., S.BETA]
    along = V * np.cos(beta)
    v_b = np.stack([along * np.cos(alpha), V * np.sin(beta), along * np.sin(alpha)], axis=-1)
    return np.asarray(np.matvec(rpy_to_matrix(x[..., S.ROLL : S.HEADING + 1]), v_b))
