"""Names of the GPS receiver's satellites, estimators and tests, in the order of the columns."""

from __future__ import annotations

from typing import Final

from ftcore.world.constellation import almanac

SLOTS: Final = almanac().names
"""Satellites of the simulated constellation, by their slots."""
PRNS: Final = tuple(f"G{prn:02d}" for prn in range(1, 33))
"""Satellites of a receiver's log."""
SATELLITES: Final = (*SLOTS, *PRNS)
EPOCH: Final = 1.0
"""Seconds between epochs of the simulated receiver; a log has its own."""

ESTIMATORS: Final = {
    "snapshot": "snapshot",
    "filter": "filter",
    "combined": "combined",
    "unprotected": "unprotected",
}
SUBJECTS: Final = ("gps", *(f"gps.{name}" for name in SATELLITES))
TESTS: Final = (
    *(("snapshot", subject) for subject in SUBJECTS),
    *(("innovation", subject) for subject in SUBJECTS),
    ("parity", "gps"),
    ("agreement", "gps"),
)
"""(test, subject) of every test column."""
TEST_LABELS: Final = {
    "snapshot": "snapshot test",
    "innovation": "innovation test",
    "parity": "parity-space test",
    "agreement": "agreement of combined filter and snapshot",
}
