"""The application: services made and closed, guards around, routes inside."""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import AsyncIterator, Iterator
from importlib import metadata
from typing import Any

from fastapi import APIRouter, Depends, FastAPI
from starlette.middleware.gzip import GZipMiddleware

from ftcore.sensors import rinex
from ftcore.threads import one_blas_thread
from server import pages, problems, scene_proxy
from server.dependencies import known_query
from server.limits import DOCUMENT_PATH, SMALL_BODY, Answered, BodyLimit, SocketLimit
from server.openapi import describe
from server.registry import ExperimentRegistry
from server.routes import experiments, logs, meta, operator, results, scenarios, stream, systems, time
from server.scenes import Scenes
from server.security import Doorkeeper, Security
from server.settings import Settings
from server.uploads import UPLOAD_PATH, Uploads

SWITCH_INTERVAL = 0.001
"""How long [s] a flight may keep the interpreter when the event loop wants it; Python's own is five times that."""


def create_app(settings: Settings | None = None) -> FastAPI:
    """FTLab as an ASGI application.

    Args:
        settings: what can be set; from the environment if absent.
    """
    settings = settings or Settings.from_environment()
    doorkeeper = Doorkeeper(settings)

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.openapi()  # takes a while, so not at someone's first request
        uploads = Uploads(settings.max_upload_bytes)
        before = rinex.restrict(uploads.folder)  # a scenario that comes over the network names no other file
        with _undisturbed(), one_blas_thread:
            app.state.registry = ExperimentRegistry(settings, uploads)
            app.state.scenes = Scenes()
            try:
                yield
            finally:
                await app.state.scenes.close()
                await app.state.registry.close()
                rinex.restrict(before)
                uploads.close()

    app = FastAPI(
        title="FTLab",
        version=metadata.version("ftlab"),
        summary="A laboratory for fault-tolerant navigation.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/v1/openapi.json",
        separate_input_output_schemas=False,
        redirect_slashes=False,  # `DELETE .../faults/` with an empty id must not become `DELETE .../faults`
    )
    app.state.settings, app.state.doorkeeper = settings, doorkeeper
    problems.install(app)
    api = APIRouter(prefix="/api/v1", dependencies=[Depends(known_query)])
    for resource in (systems, scenarios, experiments, logs, time, operator, results, meta, stream):
        api.include_router(resource.router)
    for router in (api, scene_proxy.router, pages.router):
        app.include_router(router)
    app.add_middleware(GZipMiddleware, minimum_size=1400, compresslevel=4)
    wider = {DOCUMENT_PATH: settings.max_body_bytes, UPLOAD_PATH: settings.max_log_bytes}
    app.add_middleware(BodyLimit, most=min(SMALL_BODY, settings.max_body_bytes), wider=wider)
    app.add_middleware(SocketLimit, most=settings.sockets_per_client)
    app.add_middleware(Security, doorkeeper=doorkeeper)
    app.add_middleware(Answered, leaving=lambda: app.state.registry.leaving)
    describe(app, guarded=doorkeeper.guarded)
    return app


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Let neither flights nor the garbage collector hold the event loop up.

    What exists by now stays, so the collector need not look through it: that would take a tenth of a second each time.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)


def __getattr__(name: str) -> Any:
    """``server.app:app`` for those who run the application with their own ASGI server."""
    if name == "app":
        return create_app()
    raise AttributeError(name)
