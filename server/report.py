"""One self-contained page about a flight (first version)."""

from __future__ import annotations

from typing import Any

from ftcore import Simulation


def gather(simulation: Simulation, title: str) -> dict[str, Any]:
    """Everything the page shows."""
    return {"title": title}


def render(facts: dict[str, Any]) -> bytes:
    """The page."""
    return f"<!doctype html><title>{facts['title']}</title>".encode()
