"""The 3-D scenes that are being looked at: one viser server an experiment, made at the first look.

viser's own port is open to this machine and checks nobody, so each server takes only clients that know a secret: the
proxy on FTLab's port, which does check.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import secrets

import numpy as np
import rich
import viser
from viser import _messages as viser_messages
from viser import infra

from ftcore import Simulation
from ftcore.description import View
from server.experiments import Experiment
from server.problems import Refused
from server.scene import Scene, Trails

INTERVAL = 0.1
"""Least time between two updates of a scene [s]."""
TRAIL_POINTS = 600
"""About how many points of a path are drawn."""
SECRET_HEADER = "x-ftlab-scene"
_log = logging.getLogger("ftlab")


class LiveScene:
    """The scene of one experiment, kept up to date while someone looks. Lives on the event loop."""

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.secret = secrets.token_hex(16)
        self.port = 0
        self.viewers = 0
        self._news = asyncio.Event()
        self._server: viser.ViserServer | None = None
        self._scene: Scene | None = None
        self._task: asyncio.Task[None] | None = None
        self._shown: tuple[int, float | None, str] | None = None

    async def open(self) -> None:
        """Start the viser server and draw the newest epoch."""
        self._server = await asyncio.to_thread(_start, self.secret)
        self.port = self._server.get_port()
        self._scene = await asyncio.to_thread(Scene, self._server, self.experiment.description.scene)
        await self._draw()
        self.experiment.subscribers.add(self)
        self._task = asyncio.create_task(self._keep_up(), name=f"scene of {self.experiment.id}")

    def changed(self, at_once: bool) -> None:
        """There is something new."""
        self._news.set()

    def rewound(self, to: float) -> None:
        """Something later was undone; the next drawing shows it."""
        self._news.set()

    def entered(self) -> None:
        """Someone looks; what was not drawn meanwhile is drawn now."""
        self.viewers += 1
        self._news.set()

    def left(self) -> None:
        """Someone looks no longer."""
        self.viewers -= 1

    async def close(self) -> None:
        """Stop drawing and stop the viser server."""
        self.experiment.subscribers.discard(self)
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        if self._server is not None:
            await asyncio.to_thread(self._server.stop)

    async def _keep_up(self) -> None:
        while True:
            await self._news.wait()
            self._news.clear()
            if self.viewers and not self.experiment.closed:
                try:
                    await self._draw()
                except Exception:
                    _log.exception("the scene of experiment %s cannot be drawn", self.experiment.id)
            await asyncio.sleep(INTERVAL)

    async def _draw(self) -> None:
        cursor, picture = self.experiment.cursor, self.experiment.picture
        wanted = (self.experiment.version if cursor is None else -1, cursor, picture)
        if wanted == self._shown:
            return
        view, trails = await self._view_at(cursor, picture)
        assert self._scene is not None
        await asyncio.to_thread(self._scene.show, view, picture, trails)
        self._shown = wanted

    async def _view_at(self, cursor: float | None, picture: str) -> tuple[View, Trails]:
        """What is to be seen, and the ways up to there of the points that have one."""
        trailed = [i for i in self.experiment.description.scene if i.picture == picture and i.trail is not None]

        def look(simulation: Simulation, view: View | None) -> tuple[View, Trails]:
            now = simulation.now if cursor is None else min(cursor, simulation.now)
            trails: Trails = {}
            for item in trailed:
                assert item.trail is not None
                _, columns = simulation.columns(list(item.trail), end=now, points=TRAIL_POINTS)
                trails[item.id] = np.stack([columns[name] for name in item.trail], axis=-1) / item.unit_length
            return view or simulation.view(now), trails

        view = await self.experiment.view() if cursor is None else None
        return await self.experiment.read(lambda simulation: look(simulation, view))


class Scenes:
    """Scenes by experiment, opened at the first look."""

    def __init__(self) -> None:
        self._open: dict[str, asyncio.Task[LiveScene]] = {}

    async def of(self, experiment: Experiment) -> LiveScene:
        """The scene of an experiment; everyone who asks while it opens gets the same.

        Raises:
            Refused: the experiment was deleted meanwhile.
        """
        if experiment.closed:
            raise Refused(404, f"experiment {experiment.id!r} was deleted")
        if experiment.id not in self._open:
            self._open[experiment.id] = asyncio.create_task(_opened(experiment))
        task = self._open[experiment.id]
        try:
            return await asyncio.shield(task)
        except Exception:
            self._open.pop(experiment.id, None)
            raise

    async def forget(self, id: str) -> None:
        """Close the scene of an experiment that is deleted, if it was ever opened."""
        task = self._open.pop(id, None)
        if task is not None:
            with contextlib.suppress(Exception):
                await (await task).close()

    async def close(self) -> None:
        """Close all."""
        await asyncio.gather(*(self.forget(id) for id in list(self._open)))


async def _opened(experiment: Experiment) -> LiveScene:
    scene = LiveScene(experiment)
    await scene.open()
    return scene


def _start(secret: str) -> viser.ViserServer:
    """A viser server on a free port of this machine that takes only clients with the secret, and opens no tunnel."""
    rich.get_console().quiet = True  # viser announces every server there; here they are an inner matter
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    websocket = server._websock_server
    websocket.unregister_handler(viser_messages.ShareUrlRequest)

    async def only_with_the_secret(client: infra.WebsockClientConnection) -> None:
        connection = websocket._live_connections[client.client_id]
        given = connection.request.headers.get(SECRET_HEADER, "") if connection.request is not None else ""
        if not hmac.compare_digest(given.encode(), secret.encode()):
            await connection.close(1008, "refused")

    # First in line: a stranger is sent away before viser knows of it.
    websocket._client_connect_cb.insert(0, only_with_the_secret)
    server.gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
    server.gui.main_panel.minimize()
    return server
