"""What was uploaded: receivers' logs, in a folder of the server's own, for as long as an experiment flies them.

A file is kept under a name made of its content. So the same file is kept once, and the document of an experiment that
is gone flies again after its log has been uploaded again. Nothing else can be named: names with a path in them are
refused by :func:`ftcore.sensors.rinex.restrict`.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ftcore import Scenario
from server.problems import Refused
from server.temporary import TemporaryFolder

UPLOAD_PATH = "/api/v1/logs"
"""Where files come in: the one place that takes a form instead of JSON, and a larger body."""


class Uploads:
    """Uploaded files, by name. Lives on the event loop, except for the writing.

    Args:
        most: bytes that all files together may have.
    """

    def __init__(self, most: int) -> None:
        self._temporary = TemporaryFolder()
        self._most = most
        self._sizes: dict[str, int] = {}
        self._held: Counter[str] = Counter()

    @property
    def folder(self) -> Path:
        """Where they lie."""
        return self._temporary.path

    def __len__(self) -> int:
        """How many files."""
        return len(self._sizes)

    @contextlib.contextmanager
    def adding(self, *contents: bytes) -> Iterator[list[str]]:
        """Names for these contents, held. Raises Refused (429) where there is no room for them."""
        names = [hashlib.sha256(content).hexdigest()[:32] + ".rnx" for content in contents]
        new = {name: content for name, content in zip(names, contents, strict=True) if name not in self._sizes}
        if sum(self._sizes.values()) + sum(map(len, new.values())) > self._most:
            raise Refused(
                429,
                f"uploaded logs may take {self._most / 1e6:g} MB here in all, and this one no longer fits; delete an "
                "experiment that flies another one first",
            )
        self._sizes |= {name: len(content) for name, content in new.items()}
        with self.holding(names):
            yield names

    def write(self, name: str, content: bytes) -> None:
        """Put a file that was added where it belongs; in a thread, one at a time. Nobody sees a part of it."""
        path = self.folder / name
        if not path.exists():
            unfinished = path.with_suffix(".part")
            unfinished.write_bytes(content)
            unfinished.replace(path)

    @contextlib.contextmanager
    def holding(self, names: Iterable[str]) -> Iterator[None]:
        """Keep these files meanwhile, whoever else stops using them."""
        names = list(names)
        self._held.update(names)
        try:
            yield
        finally:
            self._held.subtract(names)

    def named_in(self, scenario: Scenario) -> set[str]:
        """Files that a scenario uses: their names stand somewhere in its parameters."""
        return self._sizes.keys() & set(_texts(scenario.parameters))

    def keep(self, used: set[str]) -> None:
        """Delete what is neither used nor held."""
        for name in [name for name in self._sizes if name not in used and self._held[name] <= 0]:
            del self._sizes[name]
            (self.folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Delete everything."""
        self._sizes.clear()
        self._temporary.close()


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)
