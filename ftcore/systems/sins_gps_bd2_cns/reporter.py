"""Truth and output to recorded numbers, and to the state of diagram and scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import BlockView, Health, ItemView, View
from ftcore.estimation.ins_error import navigation_error
from ftcore.estimation.strapdown import InsState
from ftcore.systems.base import Controls, Output
from ftcore.systems.reporting import (
    LEVEL,
    Truth,
    columns_of_tests,
    flight_columns,
    healths,
    navigation_columns,
    quaternion,
    vector,
)
from ftcore.systems.sins_gps_bd2_cns.names import AXES, CLUSTERS, PAIRS, SUBJECTS, SUBSET_LABELS
from ftcore.systems.sins_gps_bd2_cns.sky import Sky

Array = NDArray[np.float64]

OWN_STRAPDOWN = 2
"""Which estimator corrects the unprotected strapdown, where there is one."""


@dataclass(frozen=True)
class Detail:
    """What the navigator hands to the reporter.

    Attributes:
        ins: protected (and unprotected) strapdown, leading axes ``(runs, 1 or 2)``.
        x, P: the nine navigation errors as the six estimators see them, ``(runs, 6, 9)`` and ``(runs, 6, 9, 9)``.
        alpha: weights of the subsets ``(runs, 8)``; mu: probabilities of the models ``(runs, 2)``.
        beta: validity of each aid ``(runs, 3)``; doubt: the lower threshold of its q, NaN where it has no reading.
        reference: which propagator is the reference, 0 or 1 ``(runs,)``; age: seconds since their resets ``(runs, 2)``.
        parity: ``(runs, 2, 3)`` parity vectors of the redundant IMU, gyros and accelerometers [SI]; None without one.
    """

    ins: InsState
    x: Array
    P: Array
    alpha: Array
    mu: Array
    beta: Array
    doubt: Array
    reference: NDArray[np.int64]
    age: Array
    parity: Array | None


class Reporter:
    """See :class:`ftcore.systems.base.Reporter`. ``axes (k, 3)``: input axes of the IMU that is fitted."""

    def __init__(self, axes: Array, sky: Sky) -> None:
        self._axes = axes
        self._sky = sky
        self._redundant = len(axes) == len(PAIRS)

    def row(self, truth: Truth, output: Output) -> Array:
        """``(runs, signals)``; the order is that of the description's signals."""
        d: Detail = output.detail
        runs = len(d.x)
        true = InsState(truth.lla[:, None], truth.v_n[:, None], truth.C_nb[:, None])
        truth_error = navigation_error(d.ins, true)
        which = np.zeros(d.x.shape[1], int)
        which[OWN_STRAPDOWN] = truth_error.shape[1] - 1
        error = truth_error[:, which] - d.x
        parity = np.full((runs, 6), np.nan) if d.parity is None else d.parity.reshape(runs, -1)
        return np.concatenate(
            [
                navigation_columns(error, d.P),
                columns_of_tests(output),
                d.doubt,
                d.beta,
                d.alpha,
                d.mu,
                d.reference[:, None] + 1.0,
                d.age,
                d.age[np.arange(runs), d.reference][:, None],
                output.used,
                parity,
                flight_columns(truth, runs),
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
            blocks=self._blocks(output, controls, health, faulted),
            items=self._items(time, truth, output, health, faulted),
        )

    def _blocks(
        self, output: Output | None, controls: Controls, health: dict[str, Health], faulted: frozenset[str]
    ) -> dict[str, BlockView]:
        d: Detail | None = None if output is None else output.detail
        settings = controls.settings

        def sensor(name: str, text: str) -> BlockView:
            number = sum(c.startswith(name + ".") for c in faulted)
            off = not controls.enabled.get(name, True)
            note = f", {number} faulted" if number else ""
            return BlockView(health="off" if off else "faulted" if number else "ok", text="off" if off else text + note)

        def instruments(cluster: str) -> BlockView:
            if not self._redundant:
                return sensor(f"imu.{cluster}", "3 axes")
            lost = [k for k in (1, 2, 3) if health[f"imu.{cluster}.{k}"] != "ok"]
            view = sensor(f"imu.{cluster}", f"{6 - 2 * len(lost)} of 6 axes")
            worst: Health = "isolated" if lost and view.health == "ok" else view.health
            return BlockView(health=worst, text=view.text)

        def local(i: int, name: str) -> BlockView:
            if health[name] == "off":
                return BlockView(health="off", text="switched off")
            if output is None or d is None:
                return BlockView(health="ok", text="waiting")
            q = output.statistic[0, i]
            if not np.isfinite(q):
                return BlockView(health="off", text="no reading")
            return BlockView(health=health[name], text=f"q {q:.3g}, weight {d.beta[0, i]:.2g}")

        reference = "no. 1" if d is None else f"no. {int(d.reference[0]) + 1}, {_older(d):.0f} s old"
        driver = {"two-propagator": "innovation", "two-propagator-state": "state"}.get(settings.driving_test, "no test")
        models = "waiting" if d is None else f"Q large {100.0 * d.mu[0, 1]:.0f} %"
        isolated = [s for s in SUBJECTS if health[s] == "isolated"]
        suspects = [s for s in SUBJECTS if health[s] == "suspect"]
        best = "waiting" if d is None else SUBSET_LABELS[int(d.alpha[0].argmax())]
        share = 0.0 if d is None else float(d.alpha[0].max())
        alone = d is not None and float(d.alpha[0, 0]) > 0.5
        return {
            "gps": sensor("gps", "position"),
            "bd2": sensor("bd2", "position"),
            "cns": sensor("cns", "attitude"),
            "gyro": instruments("gyro"),
            "accelerometer": instruments("accelerometer"),
            "sins": BlockView(
                health="isolated" if any(s.startswith("imu") for s in isolated) else "ok",
                text="redundant IMU" if self._redundant else "strapdown",
            ),
            "models": BlockView(health="ok", text=models),
            "propagators": BlockView(health="ok", text=reference),
            "filter-gps": local(0, "gps"),
            "filter-bd2": local(1, "bd2"),
            "filter-cns": local(2, "cns"),
            "supervisor": BlockView(
                health="isolated" if isolated else "suspect" if suspects else "ok",
                text=(", ".join(s.removeprefix("imu.") for s in isolated) + " out")
                if isolated
                else ("suspects " + ", ".join(s.removeprefix("imu.") for s in suspects))
                if suspects
                else f"all trusted ({driver})",
            ),
            "master": BlockView(
                health="suspect" if alone else "ok",
                text="waiting" if d is None else f"{100.0 * share:.0f} % {best}",
            ),
        }

    def _items(
        self,
        time: float,
        truth: Truth | None,
        output: Output | None,
        health: dict[str, Health],
        faulted: frozenset[str],
    ) -> dict[str, ItemView]:
        items: dict[str, ItemView] = {}
        fitted = PAIRS if self._redundant else AXES[:3]
        for cluster, length in zip(CLUSTERS, (1.0, 0.65), strict=True):
            for axis in AXES:
                name = f"imu.{cluster}.{axis}"
                if axis not in fitted:
                    items[f"axis.{cluster}.{axis}"] = ItemView(visible=False)
                    continue
                subject = f"imu.{cluster}.{axis[0]}"
                fate: Health = "faulted" if name in faulted else health.get(subject, "ok")
                line = length * self._axes[fitted.index(axis)]
                items[f"axis.{cluster}.{axis}"] = ItemView(vector=vector(line), health=fate)
        lla = None if truth is None else truth.lla[0]
        for name, line in self._sky.lines(time, lla).items():
            aid = "gps" if name.startswith("gps") else "bd2"
            broken = any(channel.startswith(aid + ".") for channel in faulted)
            fate = "faulted" if broken else health[aid] if health[aid] in ("isolated", "off") else "ok"
            items[f"satellite.{name}"] = ItemView(
                vector=None if line is None else vector(1.5 * line), health=fate, visible=line is not None
            )
        broken = any(channel.startswith("cns.") for channel in faulted)
        items["boresight"] = ItemView(
            vector=(0.0, 0.0, -1.2),
            health="faulted" if broken else "ok" if health["cns"] == "suspect" else health["cns"],
        )
        rotation = LEVEL if truth is None else quaternion(truth.C_nb[0])
        items["aircraft"] = ItemView(rotation=rotation)
        return items


def _older(d: Detail) -> float:
    return float(d.age[0, d.reference[0]])
