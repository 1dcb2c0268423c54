"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write a file beside another and put it in its place when all of it is on disk.

    Yields the path to write to, in the same folder. What breaks on the way leaves the old file as it was, and nothing
    beside it. A link is followed; the mode of a file that is replaced is kept.

    Raises:
        OSError: the folder cannot be written to, the old file is write-protected or no regular file, or the disk is
            full.
    """
    target = Path(os.path.realpath(path))
    unfinished = _made_beside(target)
    try:
        yield unfinished
        with unfinished.open("rb") as written:
            os.fsync(written.fileno())
        unfinished.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        raise
    _remember(target.parent)


def check_replaceable(path: str | Path) -> None:
    """Find out whether :func:`replacing` could write there, and leave nothing behind. Raises OSError if not."""
    _made_beside(Path(os.path.realpath(path))).unlink()


def _made_beside(target: Path) -> Path:
    """An empty file in the folder of the target, with the mode that the target has or would have."""
    mode = None
    with contextlib.suppress(FileNotFoundError):
        found = target.stat()
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(target))
        if not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, "the file is write-protected", str(target))
        mode = stat.S_IMODE(found.st_mode)
    # The name is short whatever the target's is, and the end is kept: some writers go by it.
    unfinished = target.with_name(f".ftlab-{secrets.token_hex(6)}{target.suffix}")
    os.close(os.open(unfinished, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    if mode is not None:
        with contextlib.suppress(OSError):  # of another owner's file in a shared folder it cannot be set
            unfinished.chmod(mode)
    return unfinished


def _remember(folder: Path) -> None:
    """Put the folder's new entry on disk too, where the system can."""
    with contextlib.suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)
