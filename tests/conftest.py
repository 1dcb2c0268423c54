"""Order of the suite, and how its properties are searched."""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest

hypothesis.settings.register_profile("same", derandomize=True)
hypothesis.settings.register_profile("search", print_blob=True)
hypothesis.settings.load_profile("same")
"""`make test` tries the same examples everywhere, so that it says the same of the same commit; `make test-all` looks
for new ones (`--hypothesis-profile search`)."""

TESTS = Path(__file__).parent
ROOMS = ("browser", "papers", "core", "server", "bench")
"""What takes longest comes first, so that all processes end together."""

WAITS = "test_api_schema.py"
"""This one waits more than it works, so it comes first of all and the others fill the time."""


def room(item: pytest.Item) -> str:
    """The folder of a test."""
    return item.path.relative_to(TESTS).parts[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Room by room; `make test` keeps a file's tests in one process (`--dist loadfile`), for they share what is made
    once."""
    items.sort(key=lambda item: (item.path.name != WAITS, ROOMS.index(room(item))))
