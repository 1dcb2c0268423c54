"""Names that the parts of the SINS/GPS/Doppler system share, and the order of their columns."""

from __future__ import annotations

from ftcore.systems.declarations import redundant_imu_tests
from ftcore.world.constellation import almanac

SLOTS = almanac().names
EPOCH = 1.0
ESTIMATORS = {
    "fused": "fault-tolerant",
    "gps": "SINS/GPS alone",
    "doppler": "SINS/Doppler alone",
    "unprotected": "unprotected",
}
AXES = ("1x", "1y", "2x", "2y", "3x", "3y")
CLUSTERS = {"gyro": "gyro", "accelerometer": "accelerometer"}
AIDS = {"gps": "GPS", "doppler": "Doppler"}
AID_TESTS = ("residual", "state", "two-propagator", "glr", "cusum")
IMU_TESTS = ("parity", "glt")
ALTIMETER = "altimeter"
SUBJECTS = (
    *AIDS,
    ALTIMETER,
    *(f"imu.{cluster}.{k}" for cluster in CLUSTERS for k in (1, 2, 3)),
    *(f"gps.{slot}" for slot in SLOTS),
)
ERRORS = {
    "position": ("m", ("east", "north", "up")),
    "velocity": ("m/s", ("east", "north", "up")),
    "attitude": ("mrad", ("east", "north", "up")),
}
TEST_LABELS = {
    "residual": "residual test",
    "state": "state chi-square test",
    "two-propagator": "two-propagator test",
    "glr": "windowed GLR",
    "cusum": "CUSUM",
    "parity": "parity test",
    "glt": "GLT",
    "parity-trusted": "parity test of the trusted",
    "integrity": "satellite integrity test",
    "altimeter": "altimeter test",
}
ROLES = {"fused": "protected", "gps": "local", "doppler": "local", "unprotected": "unprotected"}


SUBSETS = {"sins": "SINS alone", "gps": "with GPS", "doppler": "with Doppler", "gps+doppler": "with both"}
"""Subsets of the aids, in the order of their weights."""


def aid_tests() -> list[tuple[str, str]]:
    """(test, subject) of the tests on GPS and Doppler, in column order."""
    return [(test, subject) for test in AID_TESTS for subject in AIDS]


TESTS = (
    *aid_tests(),
    *redundant_imu_tests(IMU_TESTS),
    *(("parity-trusted", f"imu.{c}") for c in CLUSTERS),
    ("integrity", "gps"),
    ("altimeter", ALTIMETER),
)


def subject_label(subject: str) -> str:
    """How a person calls a subject of a test."""
    if subject in AIDS:
        return f"SINS/{AIDS[subject]}"
    if subject == ALTIMETER:
        return "altimeter"
    words = subject.split(".")
    if words[0] == "gps":
        return f"satellite {words[1]}"
    return words[1] + ("s" if len(words) == 2 else f" {words[2]}")
