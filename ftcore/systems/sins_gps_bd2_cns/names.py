"""Names that the parts of the SINS/GPS/BD2/CNS system share, and the order of their columns."""

from __future__ import annotations

from ftcore.systems.declarations import redundant_imu_tests

EPOCH = 1.0
AIDS = {"gps": "GPS", "bd2": "BD2", "cns": "CNS"}
AID_READINGS = {"gps": "gps.position", "bd2": "bd2.position", "cns": "cns.attitude"}
ESTIMATORS = {
    "fused": "fault-tolerant, IMM",
    "without-imm": "fault-tolerant, without IMM",
    "unprotected": "unprotected",
    "gps": "SINS/GPS alone",
    "bd2": "SINS/BD2 alone",
    "cns": "SINS/CNS alone",
}
ROLES = {
    "fused": "protected",
    "without-imm": "component",
    "unprotected": "unprotected",
    "gps": "local",
    "bd2": "local",
    "cns": "local",
}
BODY = ("x", "y", "z")
PAIRS = ("1x", "1y", "2x", "2y", "3x", "3y")
AXES = (*BODY, *PAIRS)
"""Columns of the inertial groups: the plain IMU's axes, then the redundant IMU's. One of the two is fitted."""
CLUSTERS = {"gyro": "gyro", "accelerometer": "accelerometer"}
INSTRUMENTS = tuple(f"imu.{cluster}.{k}" for cluster in CLUSTERS for k in (1, 2, 3))
SUBJECTS = (*AIDS, *INSTRUMENTS)
AID_TESTS = ("two-propagator", "two-propagator-state", "two-propagator-without-imm")
IMU_TESTS = ("parity", "glt")
TEST_LABELS = {
    "two-propagator": "two-propagator test, innovation form",
    "two-propagator-state": "two-propagator test, state form",
    "two-propagator-without-imm": "two-propagator test without IMM",
    "parity": "parity test",
    "glt": "GLT",
}
ERRORS = {
    "position": ("m", ("east", "north", "up")),
    "velocity": ("m/s", ("east", "north", "up")),
    "attitude": ("arcsec", ("east", "north", "up")),
}
SUBSETS = ("sins", "gps", "bd2", "gps-bd2", "cns", "gps-cns", "bd2-cns", "gps-bd2-cns")
"""Which aids a weight stands for: bit 0 GPS, bit 1 BD2, bit 2 CNS."""
SUBSET_LABELS = tuple("SINS alone" if s == "sins" else " + ".join(AIDS[a] for a in s.split("-")) for s in SUBSETS)
MODELS = ("small", "large")


def aid_tests() -> list[tuple[str, str]]:
    """(test, subject) of the tests on the aids, in column order."""
    return [(test, subject) for test in AID_TESTS for subject in AIDS]


TESTS = (*aid_tests(), *redundant_imu_tests(IMU_TESTS))


def subject_label(subject: str) -> str:
    """How a person calls a subject of a test."""
    if subject in AIDS:
        return AIDS[subject]
    words = subject.split(".")
    return words[1] + ("s" if len(words) == 2 else f" {words[2]}")
