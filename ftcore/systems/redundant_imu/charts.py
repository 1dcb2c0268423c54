"""The charts that the redundant-IMU system offers; the first ones are the paper's figures 5 to 8."""

from __future__ import annotations

from typing import Literal

from ftcore.description import Chart, Trace
from ftcore.systems.redundant_imu.names import (
    AXES,
    ERRORS,
    ESTIMATORS,
    FLOWN,
    FLOWN_LABELS,
    GYRO,
    ROLES,
    SUBJECTS,
    subject_label,
)


def charts() -> list[Chart]:
    """All of them; those marked as shown are open at first."""
    found = [
        Chart(
            id="detection",
            title="Fault detection FD (figure 5)",
            unit="1",
            group="tests",
            scale="log",
            traces=(
                Trace(signal=f"test.parity.{GYRO}.statistic", label="FD / sigma²", role="statistic"),
                Trace(signal=f"test.parity.{GYRO}.threshold", label="T_D / sigma²", role="threshold"),
            ),
            shown=True,
        ),
        _of_instruments("isolation-angle", "Fault isolation FI (figure 6)", "deg", "linear", shown=True),
        _of_instruments("ukf", "UKF residuals (figure 7)", "1", "log", shown=True),
        Chart(
            id="distance",
            title="Distance from the healthy twin (figure 8)",
            unit="m",
            group="flight",
            scale="log",
            traces=tuple(
                Trace(signal=f"{name}.distance", label=label, role=ROLES[name])  # type: ignore[arg-type]
                for name, label in ESTIMATORS.items()
            ),
            shown=True,
        ),
        _of_aircraft("height", "Height", [f"height.{a}" for a in FLOWN], shown=True),
        _of_aircraft("path-east", "Way east", [f"path.{a}.east" for a in FLOWN]),
        _of_aircraft("path-north", "Way north", [f"path.{a}.north" for a in FLOWN]),
        Chart(
            id="residual-axes",
            title="UKF residuals by axis",
            unit="rad/s",
            group="tests",
            traces=tuple(Trace(signal=f"residual.ukf.{axis}", label=f"gyro {axis}") for axis in AXES),
        ),
        Chart(
            id="parity-vector",
            title="Parity vector",
            unit="rad/s",
            group="parity",
            traces=tuple(Trace(signal=f"parity.{i}", label=f"component {i}") for i in (1, 2, 3)),
        ),
        Chart(
            id="parity-trusted",
            title="FD of the trusted gyros",
            unit="1",
            group="tests",
            scale="log",
            traces=(
                Trace(signal=f"test.parity-trusted.{GYRO}.statistic", label="FD / sigma²", role="statistic"),
                Trace(signal=f"test.parity-trusted.{GYRO}.threshold", label="threshold", role="threshold"),
            ),
        ),
        _of_instruments("fault-plane", "Distance from the fault planes", "1", "log"),
        _of_instruments("glt", "GLT", "1", "log"),
        _of_instruments("optimal-parity", "Optimal parity vector", "1", "log"),
        Chart(
            id="used",
            title="Gyros in use, UKF, ambiguity",
            unit="1",
            group="decisions",
            traces=(
                *(Trace(signal=f"used.{s}", label=f"{subject_label(s)} used", role="weight") for s in SUBJECTS),
                Trace(signal="ukf.active", label="UKF runs"),
                Trace(signal="isolation.ambiguous", label="ambiguous"),
            ),
        ),
    ]
    for quantity, (unit, parts) in ERRORS.items():
        for part in parts:
            title = f"{quantity.capitalize()}, {part}: off the healthy twin's"
            if quantity == "rate":
                title = f"{part.capitalize()} rate: error of what control flies on"
            found.append(
                Chart(
                    id=f"{quantity}-{part}",
                    title=title,
                    unit=unit,
                    group="errors",
                    traces=tuple(
                        Trace(signal=f"{name}.error.{quantity}.{part}", label=label, role=ROLES[name])  # type: ignore[arg-type]
                        for name, label in ESTIMATORS.items()
                    ),
                )
            )
    found += [
        Chart(
            id="attitude",
            title="True attitude, with FDI",
            unit="deg",
            group="flight",
            traces=tuple(Trace(signal=f"truth.{a}", label=a) for a in ("roll", "pitch", "heading", "alpha", "beta")),
        ),
        Chart(
            id="surfaces",
            title="Control surfaces, with FDI",
            unit="deg",
            group="flight",
            traces=tuple(Trace(signal=f"control.{s}", label=s) for s in ("elevator", "aileron", "rudder")),
        ),
    ]
    return found


def _of_instruments(test: str, title: str, unit: str, scale: Literal["linear", "log"], shown: bool = False) -> Chart:
    """A test's statistic of all three gyros, and the threshold they share."""
    traces = [Trace(signal=f"test.{test}.{s}.statistic", label=subject_label(s), role="statistic") for s in SUBJECTS]
    traces.append(Trace(signal=f"test.{test}.{SUBJECTS[0]}.threshold", label="threshold", role="threshold"))
    return Chart(
        id=test,
        title=title,
        unit=unit,
        group="tests",
        scale=scale,
        traces=tuple(traces),
        shown=shown,
    )


def _of_aircraft(id: str, title: str, signals: list[str], shown: bool = False) -> Chart:
    """The same signal [m] of the three aircraft."""
    return Chart(
        id=id,
        title=title,
        unit="m",
        group="flight",
        traces=tuple(
            Trace(signal=signal, label=FLOWN_LABELS[a], role=ROLES[a])  # type: ignore[arg-type]
            for signal, a in zip(signals, FLOWN, strict=True)
        ),
        shown=shown,
    )
