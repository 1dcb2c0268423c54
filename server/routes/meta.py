"""Whether the server is alive, and what runs."""

from __future__ import annotations

import platform
from importlib import metadata

import numpy
from fastapi import APIRouter

from server.dependencies import Registry
from server.models import Health, Version
from server.problems import documented

router = APIRouter(tags=["server"])


@router.get("/health", operation_id="getHealth", summary="Alive?", responses=documented())
def get_health(registry: Registry) -> Health:
    """Answers as long as the server can answer at all; needs no token."""
    return Health(status="ok", experiments=len(registry))


@router.get("/version", operation_id="getVersion", summary="What runs here", responses=documented())
def get_version() -> Version:
    """Versions of FTLab, Python and NumPy; the same bits are promised for the same three."""
    return Version(ftlab=metadata.version("ftlab"), python=platform.python_version(), numpy=numpy.__version__)
