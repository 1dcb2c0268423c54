"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any

import pytest

from ftcore import Scenario, Simulation, recording
from ftcore.files import check_replaceable, replacing


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "out.csv"
    path.write_text("old")
    return path


class Break(Exception):
    """Whatever goes wrong."""


@pytest.mark.parametrize("breaks", [Break, KeyboardInterrupt, MemoryError, SystemExit])
def test_what_breaks_while_it_is_written_leaves_the_old_file_and_nothing_else(
    old: Path, breaks: type[BaseException]
) -> None:
    def write() -> None:
        with replacing(old) as unfinished:
            unfinished.write_text("half of the n")
            raise breaks

    with pytest.raises(breaks):
        write()
    assert old.read_text() == "old"
    assert os.listdir(old.parent) == ["out.csv"]


def test_until_it_is_whole_the_old_file_is_there(old: Path) -> None:
    old.chmod(0o640)
    with replacing(old) as unfinished:
        unfinished.write_text("new")
        assert old.read_text() == "old"
        assert (unfinished.parent, unfinished.suffix) == (old.parent, ".csv")
    assert old.read_text() == "new"
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    assert os.listdir(old.parent) == ["out.csv"]


def test_a_new_file_has_the_mode_that_any_new_file_has(tmp_path: Path) -> None:
    (tmp_path / "other").touch()
    with replacing(tmp_path / "new.csv") as unfinished:
        unfinished.write_text("x")
    assert (tmp_path / "new.csv").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_link_stays_a_link(old: Path, tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    link = tmp_path / "deep" / "link.csv"
    link.symlink_to(old)
    with replacing(link) as unfinished:
        unfinished.write_text("new")
    assert link.is_symlink()
    assert old.read_text() == "new"
    assert os.listdir(tmp_path / "deep") == ["link.csv"]


def test_what_cannot_be_replaced_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "pipe.csv", tmp_path / "none" / "x.csv", tmp_path / "file" / "x.csv",
                 Path("/proc/x.csv")):  # fmt: skip
        for look in (check_replaceable, lambda path: replacing(path).__enter__()):
            with pytest.raises(OSError, match=r"."):
                look(path)
    check_replaceable(tmp_path / ("x" * 250 + ".csv"))
    assert sorted(os.listdir(tmp_path)) == ["file", "pipe.csv"]


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is write-protected for root")
def test_what_is_write_protected_is_refused(old: Path) -> None:
    old.chmod(0o444)
    with pytest.raises(PermissionError, match="write-protected"):
        check_replaceable(old)
    old.parent.chmod(0o555)
    with pytest.raises(PermissionError):
        check_replaceable(old.with_name("new.csv"))
    old.parent.chmod(0o755)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_disk_that_is_full_costs_no_recording_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    import pyarrow.csv
    import pyarrow.parquet

    def full(_: Any, path: Path) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    simulation = Simulation(Scenario.load("chey-2004")).advance(epochs=3)
    out, write = tmp_path / f"out.{suffix}", getattr(recording, f"to_{suffix}")
    write(simulation.recording, out)
    before = out.read_bytes()
    monkeypatch.setattr(pyarrow.csv, "write_csv", full)
    monkeypatch.setattr(pyarrow.parquet, "write_table", full)
    with pytest.raises(OSError, match="No space"):
        write(simulation.recording, out)
    assert out.read_bytes() == before
    assert os.listdir(tmp_path) == [out.name]
