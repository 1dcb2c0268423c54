"""Order of the suite, and what stays together where several processes share it (`make test`, by pytest-xdist)."""

from __future__ import annotations

from pathlib import Path

import pytest

TESTS = Path(__file__).parent
ROOMS = ("browser", "papers", "core", "server", "bench")
"""What takes longest comes first, so that all processes end together."""


def room(item: pytest.Item) -> str:
    """The folder of a test."""
    return item.path.relative_to(TESTS).parts[0]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Room by room. A file's tests, and all that drive the page, stay in one process, for they share what is made once.

    Files that share flights with others say so themselves.
    """
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group("browser" if room(item) == "browser" else item.path.stem))
    items.sort(key=lambda item: ROOMS.index(room(item)))
