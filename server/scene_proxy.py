"""viser on the page's own origin: its client as one file, its socket through a filter.

The browser talks to FTLab's port only. Whatever a browser says to viser is decoded, checked and written anew: it may
tell where its camera is, and nothing else. So no tunnel, no file, no script can be asked for, and viser hears nothing
that it would stumble over.
"""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import logging
import math
from functools import lru_cache
from pathlib import Path

import msgspec
import viser
import websockets
from fastapi import APIRouter, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import RedirectResponse

from server.dependencies import Live, LiveSocket
from server.limits import Budget
from server.scenes import SECRET_HEADER, Scenes
from server.security import SCENE_POLICY
from server.settings import Settings
from server.tasks import until_one_ends

MAX_INBOUND = 4096
"""Longest message that a browser may send [bytes]; a camera has about 300."""
MESSAGES_A_SECOND, MESSAGES_AT_ONCE = 100.0, 200
"""How many messages a browser may send: in the long run (viser's client tells its camera 50 times), and in a burst."""
FLOOD = 1008
HIDE = (
    b"<style>[data-floating-window],#root .mantine-Paper-root,#webgl-software-rendering{display:none!important}</style>"
)
"""viser's own panels; a browser test guards that this hides them."""
QUIET = (
    b"<script>for (const kind of ['error', 'unhandledrejection']) addEventListener(kind, (event) => {"
    b"if ((event.reason ?? event.error) instanceof EvalError) event.preventDefault(); });</script>"
)
"""viser's sorter of Gaussian splats, which no scene here has, builds itself by evaluating strings. The policy forbids
that, rightly; this keeps the browser from reporting it as an error of the page."""
CAMERA = (
    b"<script>{ const post = Worker.prototype.postMessage; Worker.prototype.postMessage = function (said, ...rest) {"
    b"if (said?.type === 'send' && said.message?.type === 'ViewerCameraMessage') {"
    b"window.ftlabCamera = said.message; dispatchEvent(new Event('ftlab-camera')); }"
    b"return post.call(this, said, ...rest); }; }</script>"
)
"""Lets the page that holds the scene know where its camera is: the page lays the names over it. viser tells its server
of every move of the camera through a worker, and this listens."""
_PASSED_CLOSE_CODES = (1000, 1001, 1002, 1003, 1008, 1011)

router = APIRouter(include_in_schema=False)
_log = logging.getLogger("ftlab")


class Camera(msgspec.Struct, tag="ViewerCameraMessage", tag_field="type"):
    """Where a browser's camera is: the one message that viser may hear from it."""

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Refuse what is no number."""
        single = (self.fov, self.near, self.far, self.image_height, self.image_width)
        if not all(map(math.isfinite, (*self.wxyz, *self.position, *self.look_at, *self.up_direction, *single))):
            raise ValueError("a camera is somewhere")


_decoder, _encoder = msgspec.msgpack.Decoder(Camera), msgspec.msgpack.Encoder()


def passed(message: bytes) -> bytes | None:
    """What viser hears of a browser's message: the camera in it, written anew; None for everything else."""
    if len(message) > MAX_INBOUND:
        return None
    try:
        return _encoder.encode(_decoder.decode(message))
    except (msgspec.MsgspecError, ValueError, RecursionError, OverflowError):
        return None


@lru_cache(maxsize=1)
def client_page() -> tuple[bytes, bytes, str]:
    """viser's client with its panels hidden: plain, compressed, and its entity tag."""
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    # Ours comes first: before the first script of viser's runs.
    page = page.replace(b"<head>", b"<head>" + QUIET + CAMERA, 1).replace(b"</head>", HIDE + b"</head>", 1)
    return page, gzip.compress(page, 6), f'"{hashlib.sha256(page).hexdigest()[:16]}"'


@router.get("/experiments/{id}/scene")
async def scene_without_slash(experiment: Live, request: Request) -> Response:
    """The scene's address ends with a slash, since its socket is found beside it."""
    query = f"?{request.url.query}" if request.url.query else ""
    return RedirectResponse(f"/experiments/{experiment.id}/scene/{query}", status_code=307)


@router.get("/experiments/{id}/scene/")
async def scene_page(experiment: Live, request: Request) -> Response:
    """viser's client. ``?darkMode`` darkens it."""
    plain, compressed, tag = client_page()
    headers = {"content-security-policy": SCENE_POLICY, "etag": tag, "cache-control": "no-cache"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers |= {"content-encoding": "gzip", "vary": "accept-encoding"}
        return Response(compressed, media_type="text/html", headers=headers)
    return Response(plain, media_type="text/html", headers=headers)


@router.websocket("/experiments/{id}/scene")
@router.websocket("/experiments/{id}/scene/")
async def scene_socket(socket: WebSocket, experiment: LiveSocket) -> None:
    """viser's socket, filtered. Connected to viser first, so that the same subprotocol can be accepted."""
    scenes: Scenes = socket.app.state.scenes
    if experiment is None or experiment.closed:
        await socket.close(1008)
        return
    scene = await scenes.of(experiment)
    settings: Settings = socket.app.state.settings
    if scene.viewers >= settings.streams_per_experiment:
        await socket.close(1008, f"{settings.streams_per_experiment} browsers see this scene already")
        return
    protocols = [websockets.Subprotocol(p) for p in socket.scope.get("subprotocols", []) if p.startswith("viser-v")]
    async with websockets.connect(
        f"ws://127.0.0.1:{scene.port}/",
        subprotocols=protocols or None,
        additional_headers={SECRET_HEADER: scene.secret},
        compression=None,
        max_size=None,
        open_timeout=5,
        proxy=None,
    ) as upstream:
        await socket.accept(subprotocol=upstream.subprotocol)
        scene.entered()
        try:
            heard = Inbound(experiment.id)
            await until_one_ends(_to_browser(upstream, socket), heard.pass_on(socket, upstream))
        finally:
            scene.left()
            heard.summary()
        code = upstream.close_code if upstream.close_code in _PASSED_CLOSE_CODES else 1000
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(code)


async def _to_browser(upstream: websockets.ClientConnection, socket: WebSocket) -> None:
    async for message in upstream:
        if isinstance(message, bytes):
            await socket.send_bytes(message)


class Inbound:
    """What one browser says: passed on, or dropped and counted."""

    def __init__(self, experiment: str) -> None:
        self._experiment = experiment
        self._budget = Budget(MESSAGES_A_SECOND, MESSAGES_AT_ONCE)
        self._dropped = 0

    async def pass_on(self, socket: WebSocket, upstream: websockets.ClientConnection) -> None:
        """Pass cameras on to viser until the browser leaves, or says too much."""
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if not self._budget.spend():
                await socket.close(FLOOD, f"more than {MESSAGES_A_SECOND:g} messages a second")
                return
            camera = passed(message.get("bytes") or b"")
            if camera is None:
                self._dropped += 1
            else:
                await upstream.send(camera)

    def summary(self) -> None:
        """One line in the log if anything was dropped, however much it was."""
        if self._dropped:
            _log.warning(
                "a browser sent %d messages to the scene of experiment %s that are no camera; viser did not hear them",
                self._dropped,
                self._experiment,
            )
