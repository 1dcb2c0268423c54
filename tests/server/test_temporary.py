"""Folders of servers: kept while their server lives, removed after it, however it ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from server.settings import REPOSITORY
from server.temporary import LOCK, PREFIX, TemporaryFolder

SERVER = """
import sys
from server.temporary import TemporaryFolder
folder = TemporaryFolder()
(folder.path / "log.rnx").write_text("x")
print(folder.path, flush=True)
sys.stdin.read()
folder.close()
"""


class Server:
    """A process with a folder."""

    def __init__(self, parent: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER],
            env=os.environ | {"TMPDIR": str(parent)},
            cwd=REPOSITORY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.folder = Path(self.process.stdout.readline().strip())

    def end(self, by: int | None = None) -> None:
        """Let it go, or kill it."""
        if by is not None:
            self.process.send_signal(by)
        self.process.communicate(timeout=20)


@pytest.fixture
def parent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files of its own."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_what_a_killed_server_left_is_removed_at_the_next_start_and_that_of_a_live_one_is_kept(parent: Path) -> None:
    killed, alive = Server(parent), Server(parent)
    killed.end(signal.SIGKILL)
    assert killed.folder.exists()
    ours = TemporaryFolder()
    assert not killed.folder.parent.exists()
    assert (alive.folder / "log.rnx").exists()
    TemporaryFolder().close()
    assert ours.path.exists()
    ours.close()
    alive.end()
    assert list(parent.iterdir()) == []


def test_what_is_no_folder_of_a_server_is_left_alone(parent: Path) -> None:
    (parent / "precious").mkdir()
    (parent / "precious" / LOCK).touch()
    (parent / f"{PREFIX}link").symlink_to(parent / "precious")
    (parent / f"{PREFIX}file").touch()
    (parent / f"{PREFIX}being-made").mkdir()  # its server has not come to lock it yet
    (parent / "ftlab-other").mkdir()
    (parent / "ftlab-other" / LOCK).touch()
    before = sorted(parent.iterdir())
    TemporaryFolder().close()
    assert sorted(parent.iterdir()) == before
    assert (parent / "precious" / LOCK).exists()


def test_a_folder_that_was_swept_while_it_was_made_is_made_again(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from server import temporary

    made, locked = tempfile.mkdtemp, temporary._locked
    swept: list[Path] = []

    def sweeper_is_quicker(path: Path, create: int = 0) -> int | None:
        lock = locked(path, create)
        if create and not swept:
            swept.append(path.parent)
            path.unlink()
            path.parent.rmdir()
            assert lock is not None
            os.close(lock)
            return None
        return lock

    monkeypatch.setattr(temporary, "_locked", sweeper_is_quicker)
    folder = TemporaryFolder()
    assert made is tempfile.mkdtemp
    assert folder.path.exists()
    assert folder.path.parent != swept[0]
    assert oct(folder.path.parent.stat().st_mode & 0o777) == "0o700"
    folder.close()
