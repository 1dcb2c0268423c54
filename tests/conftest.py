"""Order of the suite: the page last. Playwright keeps an event loop running in the thread of its tests."""

from __future__ import annotations

from pathlib import Path

import pytest

BROWSER = Path(__file__).parent / "browser"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that need a thread without a running loop come before those that drive the page."""
    items.sort(key=lambda item: BROWSER in item.path.parents)
