"""Names that the parts of the redundant-IMU system share, and the order of their columns."""

from __future__ import annotations

EPOCH = 0.02
AXES = ("1x", "1y", "2x", "2y", "3x", "3y")
INSTRUMENTS = 3

FLOWN = ("protected", "unprotected", "healthy")
"""The three aircraft, in the order of every array: with FDI, without, and one that nothing breaks."""
AIRCRAFT = len(FLOWN)
PROTECTED, UNPROTECTED, HEALTHY = range(AIRCRAFT)
ESTIMATORS = {"protected": "with FDI", "unprotected": "without FDI"}
FLOWN_LABELS = {**ESTIMATORS, "healthy": "healthy twin"}
ROLES = {"protected": "protected", "unprotected": "unprotected", "healthy": "local"}

GYRO, AIR = "imu.gyro", "air"
SUBJECTS = tuple(f"{GYRO}.{k}" for k in range(1, INSTRUMENTS + 1))
PER_INSTRUMENT = ("isolation-angle", "fault-plane", "glt", "optimal-parity", "ukf")
TESTS = (
    ("parity", GYRO),
    ("parity-trusted", GYRO),
    *((test, subject) for test in PER_INSTRUMENT for subject in SUBJECTS),
)
TEST_LABELS = {
    "parity": "fault detection FD",
    "parity-trusted": "FD of the trusted gyros",
    "isolation-angle": "isolation angle FI",
    "fault-plane": "distance from the fault plane",
    "glt": "GLT",
    "optimal-parity": "optimal parity vector",
    "ukf": "UKF residual",
}
AIR_DATA = ("speed", "alpha", "beta", "height")
ERRORS = {
    "position": ("m", ("east", "north", "up")),
    "velocity": ("m/s", ("east", "north", "up")),
    "attitude": ("deg", ("roll", "pitch", "heading")),
    "rate": ("deg/s", ("roll", "pitch", "yaw")),
}


def subject_label(subject: str) -> str:
    """How a person calls a subject of a test."""
    return "all gyros" if subject == GYRO else f"gyro {subject[-1]}"
