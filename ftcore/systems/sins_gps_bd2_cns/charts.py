"""The charts that the SINS/GPS/BD2/CNS system offers."""

from __future__ import annotations

from ftcore.description import Chart, Trace
from ftcore.systems.declarations import capital, nees_chart, parity_charts
from ftcore.systems.sins_gps_bd2_cns.names import (
    AID_TESTS,
    AIDS,
    CLUSTERS,
    ERRORS,
    ESTIMATORS,
    IMU_TESTS,
    ROLES,
    SUBSET_LABELS,
    SUBSETS,
    TEST_LABELS,
    subject_label,
)

COMPARED = ("fused", "unprotected")
"""Shown in one chart. Without the IMM a wrong reference may cost kilometres: that has charts of its own."""


def _error_chart(quantity: str, part: str, title: str, shown: bool = False) -> Chart:
    traces = tuple(
        Trace(
            signal=f"{estimator}.error.{quantity}.{part}",
            label=ESTIMATORS[estimator],
            role=ROLES[estimator],  # type: ignore[arg-type]
            sigma=f"fused.sigma.{quantity}.{part}" if estimator == "fused" else None,
        )
        for estimator in COMPARED
    )
    unit = ERRORS[quantity][0]
    return Chart(id=f"{quantity}-{part}", title=title, unit=unit, group="errors", traces=traces, shown=shown)


def _imm_chart(quantity: str, part: str, title: str) -> Chart:
    traces = tuple(
        Trace(
            signal=f"{estimator}.error.{quantity}.{part}",
            label=ESTIMATORS[estimator],
            role=ROLES[estimator],  # type: ignore[arg-type]
            sigma=f"{estimator}.sigma.{quantity}.{part}" if estimator == "without-imm" else None,
        )
        for estimator in ("without-imm", "fused")
    )
    unit = ERRORS[quantity][0]
    return Chart(id=f"imm-{quantity}-{part}", title=title, unit=unit, group="with and without IMM", traces=traces)


def _imm_test_chart(subject: str) -> Chart:
    traces = (
        Trace(signal=f"test.two-propagator-without-imm.{subject}.statistic", label="without IMM", role="unprotected"),
        Trace(signal=f"test.two-propagator.{subject}.statistic", label="with IMM", role="statistic"),
        Trace(signal=f"test.two-propagator.{subject}.threshold", label="rejected from here", role="threshold"),
    )
    return Chart(
        id=f"imm-{subject}",
        title=f"q of {subject_label(subject)}, with and without IMM",
        unit="1",
        group="with and without IMM",
        scale="log",
        traces=traces,
        shown=subject == "gps",
    )


def _alone_chart(quantity: str, part: str, title: str) -> Chart:
    traces = tuple(
        Trace(signal=f"{e}.error.{quantity}.{part}", label=ESTIMATORS[e], role="local")
        for e in AIDS
        # The star tracker says nothing of position: kilometres, that would flatten the others.
        if not (e == "cns" and quantity != "attitude")
    )
    unit = ERRORS[quantity][0]
    return Chart(id=f"alone-{quantity}-{part}", title=title, unit=unit, group="one aid alone", traces=traces)


def _test_chart(test: str, subject: str, shown: bool = False) -> Chart:
    stem = f"test.{test}.{subject}"
    traces = [Trace(signal=f"{stem}.statistic", label="q", role="statistic")]
    if test == "two-propagator" and subject in AIDS:
        traces.append(Trace(signal=f"{stem}.doubt", label="doubted from here", role="threshold"))
        traces.append(Trace(signal=f"{stem}.threshold", label="rejected from here", role="threshold"))
    else:
        traces.append(Trace(signal=f"{stem}.threshold", label="threshold", role="threshold"))
    words = TEST_LABELS[test]
    title = (
        f"q of {subject_label(subject)}" if test == "two-propagator" else f"{capital(words)}, {subject_label(subject)}"
    )
    return Chart(
        id=f"{test}-{subject}", title=title, unit="1", group="tests", scale="log", traces=tuple(traces), shown=shown
    )


def charts() -> list[Chart]:
    """All of them; those marked as shown are open at first."""
    found = [
        Chart(
            id="weights",
            title="Weights of the eight subsets of aids",
            unit="1",
            group="weights",
            stacked=True,
            traces=tuple(
                Trace(signal=f"weight.{name}", label=label, role="weight")
                for name, label in reversed(list(zip(SUBSETS, SUBSET_LABELS, strict=True)))
            ),
            shown=True,
        )
    ]
    found += [_test_chart("two-propagator", subject, shown=subject == "gps") for subject in AIDS]
    found += [_imm_test_chart(subject) for subject in AIDS]
    found.append(
        Chart(
            id="models",
            title="Model probabilities",
            unit="1",
            group="weights",
            stacked=True,
            traces=(
                Trace(signal="probability.small", label="Q small: quiet flight"),
                Trace(signal="probability.large", label="Q large: manoeuvre"),
            ),
            shown=True,
        )
    )
    names = {"east": "East", "north": "North", "up": "Altitude"}
    found += [_error_chart("position", p, f"{n} error" if p == "up" else f"{n} position error", shown=p == "east")
              for p, n in names.items()]  # fmt: skip
    names["up"] = "Vertical"
    found += [_error_chart("velocity", p, f"{n} velocity error") for p, n in names.items()]
    names = {"east": "East tilt", "north": "North tilt", "up": "Azimuth"}
    found += [_error_chart("attitude", p, f"{n} error", shown=p == "up") for p, n in names.items()]
    found.append(
        Chart(
            id="propagators",
            title="Propagators: seconds since each was reset, and which is the reference",
            unit="s",
            group="tests",
            traces=(
                Trace(signal="propagator.1.age", label="propagator 1"),
                Trace(signal="propagator.2.age", label="propagator 2"),
                Trace(signal="propagator.reference.age", label="the reference", role="protected"),
            ),
        )
    )
    found += [_test_chart(test, subject) for test in AID_TESTS[1:] for subject in AIDS]
    words = {
        "position": ("East position", "east"),
        "velocity": ("East velocity", "east"),
        "attitude": ("Azimuth", "up"),
    }
    found += [_imm_chart(quantity, part, f"{n} error, with and without IMM") for quantity, (n, part) in words.items()]
    found.append(
        Chart(
            id="validity",
            title="Validity of each aid",
            unit="1",
            group="weights",
            traces=tuple(Trace(signal=f"validity.{aid}", label=label) for aid, label in AIDS.items()),
        )
    )
    found += [_alone_chart("position", p, f"{n} error, one aid alone")
              for p, n in (("east", "East position"), ("north", "North position"), ("up", "Altitude"))]  # fmt: skip
    found.append(_alone_chart("attitude", "up", "Azimuth error, one aid alone"))
    found.append(
        Chart(
            id="position-cns",
            title="Position error of SINS/CNS alone",
            unit="m",
            group="one aid alone",
            traces=tuple(Trace(signal=f"cns.error.position.{p}", label=p) for p in ("east", "north", "up")),
        )
    )
    found += [_test_chart(test, f"imu.{cluster}") for test in IMU_TESTS for cluster in CLUSTERS]
    found += parity_charts(" of the redundant IMU")
    compared = {e: ESTIMATORS[e] for e in ("fused", "without-imm", "unprotected")}
    found.append(nees_chart(compared, ROLES))
    found.append(
        Chart(
            id="attitude-true",
            title="Flight: roll and pitch",
            unit="deg",
            group="flight",
            traces=(Trace(signal="truth.roll", label="roll"), Trace(signal="truth.pitch", label="pitch")),
        )
    )
    found += [
        Chart(
            id="speed", title="Flight: speed", unit="m/s", group="flight",
            traces=(Trace(signal="truth.speed", label="ground speed"),),
        ),
        Chart(
            id="height", title="Flight: height", unit="m", group="flight",
            traces=(Trace(signal="truth.height", label="height"),),
        ),
    ]  # fmt: skip
    return found
