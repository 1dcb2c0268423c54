"""Files of the field, damaged in any way: they fly, or one sentence says why not; nothing else ever happens."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from ftcore import CommandError, Scenario, Simulation
from ftcore.sensors import rinex
from ftcore.sensors.rinex import LogError
from ftcore.systems.gps_receiver.logs import log_scenario
from tests import packing

FIELD = Path(__file__).parents[1] / "field"
PAIRS = [
    *((FIELD / name / "a.15o", FIELD / name / "a.15n") for name in ("bom", "duplicate-epoch", "event4-new-types")),
    *((FIELD / name / "a.15o", FIELD / name / "a.15n") for name in ("event2-3-moving-new-site", "event6-cycle-slips")),
    *((FIELD / name / "a.15o", FIELD / name / "a.15n") for name in ("health-newer-set", "seconds-60")),
    (FIELD / "c1-blank-p1-given" / "half.15o", FIELD / "c1-blank-p1-given" / "a.15n"),
    (FIELD / "nav-305-glonass" / "a.rnx", FIELD / "nav-305-glonass" / "a_MN.rnx"),
]


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three damages of one kind or another."""
    for _ in range(int(rng.integers(1, 4))):
        lines = content.splitlines(keepends=True) or [b""]
        at, line = int(rng.integers(len(content) + 1)), int(rng.integers(len(lines)))
        kind = int(rng.integers(12))
        if kind == 0:
            content = content[:at]
        elif kind == 1:
            content = content[:at] + bytes([int(rng.integers(256))]) + content[at + 1 :]
        elif kind == 2:
            content = b"".join(lines[:line] + lines[line + 1 :])
        elif kind == 3:
            content = b"".join([*lines[: line + 1], *lines[line:]])
        elif kind == 4:
            other = int(rng.integers(len(lines)))
            lines[line], lines[other] = lines[other], lines[line]
            content = b"".join(lines)
        elif kind == 5:
            lines[line] = lines[line][: int(rng.integers(len(lines[line]) + 1))]
            content = b"".join(lines)
        elif kind == 6:
            first = int(rng.integers(0, 70))
            lines[line] = lines[line][:first] + b" " * 14 + lines[line][first + 14 :]
            content = b"".join(lines)
        elif kind == 7:
            content = content[:at] + bytes(rng.integers(0, 256, 20, dtype=np.uint8)) + content[at:]
        elif kind == 8:
            digits = [k for k, byte in enumerate(lines[line]) if 48 <= byte <= 57]
            if digits:
                own = bytearray(lines[line])
                for k in rng.choice(digits, min(4, len(digits))).tolist():
                    own[k] = 48 + int(rng.integers(10))
                lines[line] = bytes(own)
            content = b"".join(lines)
        elif kind == 9:
            content = content.replace(b"\n", (b"\r\n", b"\r", b"\n\n")[int(rng.integers(3))])
        elif kind == 10:
            content = packing.packed(content, "gz")[: int(rng.integers(40, 4000))] if rng.integers(3) == 0 else content
        else:
            content = content + content[content.find(b"\n", at) + 1 :]
    return content


def outcomes(count: int, seed: int, folder: Path, fly_every: int) -> Counter[str]:
    """What came of so many damaged pairs; every so many that can be read are flown."""
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    sentences: list[str] = []
    for k in range(count):
        pair = [path.read_bytes() for path in PAIRS[k % len(PAIRS)]]
        victim = int(rng.integers(2))
        pair[victim] = damaged(pair[victim], rng)
        paths = [folder / f"{k}.o", folder / f"{k}.n"]
        for path, content in zip(paths, pair, strict=True):
            path.write_bytes(content)
        try:
            if k % fly_every:
                log = rinex.parse(*pair)
                assert np.isfinite(log.week_seconds).all()
            else:
                sim = Simulation(Scenario.model_validate(log_scenario(*map(str, paths))))
                sim.advance(epochs=4)
                sim.score()
            counts["read" if k % fly_every else "flown"] += 1
        except (LogError, CommandError) as error:
            counts["refused"] += 1
            sentences.append(str(error))
        for path in paths:
            path.unlink()
    assert all(sentence.isprintable() and len(sentence) < 400 for sentence in sentences)
    return counts


def test_given_damaged_files_then_they_are_flown_or_refused_in_one_sentence(tmp_path):
    counts = outcomes(150, 11, tmp_path, 5)
    assert min(counts["read"], counts["flown"], counts["refused"]) > 5, counts


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_given_thousands_of_damaged_files_then_the_same(tmp_path, seed):
    counts = outcomes(1000, 100 + seed, tmp_path, 10)
    assert min(counts["read"], counts["flown"], counts["refused"]) > 20, counts
