"""A folder for as long as this process lives, and the end of those whose process was killed."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from pathlib import Path

try:
    import fcntl
except ImportError:  # a system without file locks: a folder is still removed at the end, only not after a kill
    fcntl = None  # type: ignore[assignment]

PREFIX = "ftlab-files-"
LOCK = ".lock"


class TemporaryFolder:
    """A folder of this process alone. Its lock is held as long as the process lives, however that ends.

    A folder whose lock nobody holds was left by a process that was killed; making a folder removes such.
    """

    def __init__(self) -> None:
        _sweep(Path(tempfile.gettempdir()))
        while True:
            self._root = Path(tempfile.mkdtemp(prefix=PREFIX))  # 0700: no other user looks in
            lock = _locked(self._root / LOCK, os.O_CREAT)
            if lock is not None:
                break  # another server that starts may have taken it for one that was left, and then it is gone
        self._lock = lock
        self.path = self._root / "files"
        self.path.mkdir(0o700)

    def close(self) -> None:
        """Remove it."""
        shutil.rmtree(self._root, ignore_errors=True)
        os.close(self._lock)


def _sweep(parent: Path) -> None:
    """Remove the folders of this user that were left behind."""
    for folder in parent.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            found = folder.lstat()
            if not stat.S_ISDIR(found.st_mode) or (hasattr(os, "getuid") and found.st_uid != os.getuid()):
                continue
            lock = _locked(folder / LOCK)
            if lock is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)


def _locked(path: Path, create: int = 0) -> int | None:
    """A descriptor that holds the lock of a file; None if somebody else does, or the file is gone."""
    if fcntl is None:
        return os.open(path, os.O_RDWR | create, 0o600) if create else None
    try:
        opened = os.open(path, os.O_RDWR | os.O_NOFOLLOW | create, 0o600)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(opened), os.stat(path)):
            return opened
    except OSError:
        pass
    os.close(opened)
    return None
