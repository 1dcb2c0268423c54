"""The charts that the SINS/GPS/Doppler system offers."""

from __future__ import annotations

from ftcore.description import Chart, Trace
from ftcore.systems.declarations import capital, chart_of_test, nees_chart, parity_charts
from ftcore.systems.sins_gps_doppler.names import (
    AID_TESTS,
    AIDS,
    ALTIMETER,
    CLUSTERS,
    ERRORS,
    ESTIMATORS,
    IMU_TESTS,
    ROLES,
    SLOTS,
    SUBSETS,
    TEST_LABELS,
    subject_label,
)


def _error_chart(quantity: str, part: str, title: str, shown: bool = False) -> Chart:
    unit = ERRORS[quantity][0]
    traces = tuple(
        Trace(
            signal=f"{estimator}.error.{quantity}.{part}",
            label=label,
            role=ROLES[estimator],  # type: ignore[arg-type]
            sigma=f"fused.sigma.{quantity}.{part}" if estimator == "fused" else None,
        )
        for estimator, label in ESTIMATORS.items()
        # Doppler alone never learns its position: tens of metres, that would flatten the others.
        if not (quantity == "position" and estimator == "doppler")
    )
    return Chart(id=f"{quantity}-{part}", title=title, unit=unit, group="errors", traces=traces, shown=shown)


def _test_chart(test: str, subject: str, shown: bool = False) -> Chart:
    title = f"{capital(TEST_LABELS[test])}, {subject_label(subject)}"
    return chart_of_test(f"{test}-{subject}", title, f"test.{test}.{subject}", shown)


def _both_chart(test: str) -> Chart:
    """One test of both aids: a fault of either is seen in the first charts."""
    traces = [
        Trace(signal=f"test.{test}.{subject}.{part}", label=label + words, role=role)  # type: ignore[arg-type]
        for part, words, role in (("statistic", "", "statistic"), ("threshold", " threshold", "threshold"))
        for subject, label in AIDS.items()
    ]
    title = f"{capital(TEST_LABELS[test])}, both aids"
    return Chart(id=f"{test}-aids", title=title, unit="1", group="tests", scale="log", traces=tuple(traces), shown=True)


def charts() -> list[Chart]:
    """All of them; those marked as shown are open at first."""
    names = {"east": "East", "north": "North"}
    found = [_error_chart("position", "up", "Altitude error", shown=True)]
    found += [_error_chart("position", p, f"{n} position error") for p, n in names.items()]
    found += [_error_chart("velocity", "east", "East velocity error", shown=True)]
    found += [
        _error_chart("velocity", "north", "North velocity error"),
        _error_chart("velocity", "up", "Vertical velocity error"),
        _error_chart("attitude", "east", "East tilt error"),
        _error_chart("attitude", "north", "North tilt error"),
        _error_chart("attitude", "up", "Azimuth error"),
    ]
    found.append(
        Chart(
            id="position-doppler",
            title="Position error of SINS/Doppler alone",
            unit="m",
            group="errors",
            traces=tuple(
                Trace(signal=f"doppler.error.position.{p}", label=p, role="component") for p in ("east", "north", "up")
            ),
        )
    )
    found += [_both_chart(test) for test in ("residual", "state")]
    found += [_test_chart(test, subject) for test in AID_TESTS for subject in AIDS]
    found.append(_test_chart("integrity", "gps"))
    found.append(_test_chart("altimeter", ALTIMETER))
    for test in IMU_TESTS:
        for cluster in CLUSTERS:
            found.append(_test_chart(test, f"imu.{cluster}", shown=(test, cluster) == ("parity", "accelerometer")))
    found += [_test_chart("parity-trusted", f"imu.{cluster}") for cluster in CLUSTERS]
    found += parity_charts()
    found.append(
        Chart(
            id="isolation-accelerometer",
            title="GLT of each accelerometer",
            unit="1",
            group="parity",
            scale="log",
            traces=tuple(
                Trace(signal=f"test.glt.imu.accelerometer.{k}.statistic", label=f"accelerometer {k}") for k in (1, 2, 3)
            ),
        )
    )
    found.append(
        Chart(
            id="isolation-gyro",
            title="GLT of each gyro",
            unit="1",
            group="parity",
            scale="log",
            traces=tuple(Trace(signal=f"test.glt.imu.gyro.{k}.statistic", label=f"gyro {k}") for k in (1, 2, 3)),
        )
    )
    found.append(
        Chart(
            id="doppler-output",
            title="Doppler forward velocity: reading and estimate",
            unit="m/s",
            group="outputs",
            traces=(
                Trace(signal="estimate.doppler.x", label="estimated output", role="protected"),
                Trace(signal="reading.doppler.x", label="reading", role="local"),
            ),
        )
    )
    found.append(
        Chart(
            id="gps-discrepancy",
            title="Pseudoranges: reading minus estimated output",
            unit="m",
            group="outputs",
            traces=tuple(Trace(signal=f"discrepancy.gps.{slot}", label=slot) for slot in SLOTS),
        )
    )
    found.append(
        Chart(
            id="altimeter-discrepancy",
            title="Altimeter: reading minus its prediction",
            unit="m",
            group="outputs",
            traces=(Trace(signal="discrepancy.altimeter", label="altimeter"),),
        )
    )
    found.append(nees_chart(ESTIMATORS, ROLES))
    found.append(
        Chart(
            id="geometry",
            title="Satellites in use and left out, and HDOP",
            unit="1",
            group="outputs",
            traces=(
                Trace(signal="gps.satellites", label="satellites in use"),
                Trace(signal="gps.excluded", label="satellites left out"),
                Trace(signal="gps.hdop", label="HDOP"),
            ),
        )
    )
    found.append(
        Chart(
            id="weights",
            title="Weights of the aids in the fused estimate",
            unit="1",
            group="weights",
            stacked=True,
            traces=tuple(Trace(signal=f"weight.{n}", label=label, role="weight") for n, label in SUBSETS.items()),
        )
    )
    return found
