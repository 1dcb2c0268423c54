"""A system's geometry drawn with viser: whatever its scene items say, and nothing known about any single system.

Handles are made once; an update only says what has changed. Colour tells the family, health overrides it. Names, with
the health in words so that colour is never alone, are laid over the scene by the page, which knows where there is room.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import viser
from numpy.typing import NDArray

from ftcore.description import Health, ItemView, SceneItem, View
from server import shapes

Colour = tuple[int, int, int]
Vector = tuple[float, float, float]
Trails = dict[str, NDArray[np.float64]]
"""Ways of points up to the moment shown: item id -> (n, 3), in scene units."""

FAMILIES: tuple[Colour, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (0, 114, 178),
    (148, 148, 160),
    (170, 136, 80),
    (140, 110, 210),
)
"""Okabe-Ito in the order of the charts' lines, without vermilion and yellow, which mean something here."""

HEALTH: dict[Health, Colour] = {
    "faulted": (213, 94, 0),
    "suspect": (240, 228, 66),
    "isolated": (128, 128, 128),
    "off": (84, 84, 84),
}
LEVEL_FLIGHT = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
"""Body (forward, right, down) to level (east, north, up), flying north: shown until an attitude is known."""

FIELD_OF_VIEW = math.radians(50.0)
FROM = np.array([0.62, -0.68, 0.40])
"""Where the camera stands, as a direction from the middle."""
LEAST_RADIUS = 1.1
MOST_PATH_POINTS = 2000
WIDE = 1.5
"""Width over height of a picture in which the height decides how far the camera stands."""


class Drawn(Protocol):
    """Something in the scene that can be brought up to date."""

    def show(self, view: ItemView, time: float) -> None:
        """Draw the item as it is at ``time``."""


HIDDEN = ItemView(visible=False)


class Scene:
    """The drawing of one system on one viser server. Not thread-safe."""

    def __init__(self, server: viser.ViserServer, items: Sequence[SceneItem]) -> None:
        self._server = server
        self._radius = self._ways_radius = 0.0
        families = {family: i for i, family in enumerate(dict.fromkeys(item.family for item in items))}
        scene = server.scene
        scene.set_up_direction("+z")
        # Without a graphics card a reflecting environment and shadows stop the whole page for seconds (measured: 11 s
        # at the first frame with both, under 2 s without), and arrows need neither.
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=True, cast_shadow=False)
        scene.add_light_ambient("/ambient", intensity=1.2)  # a patch that faces no lamp is not black
        self._body = scene.add_frame("/body", show_axes=False, wxyz=LEVEL_FLIGHT)
        self._grounded = {item.picture for item in items if item.frame == "level"}
        self._ground = _draw_level(scene) if self._grounded else ()
        self._pictures = {item.id: item.picture for item in items}
        self._picture = next((item.picture for item in items), "")
        self._drawn: dict[str, Drawn] = {}
        for i, item in enumerate(items):
            turning = item.frame == "body" or (item.kind == "aircraft" and item.frame == "level")
            name = f"/body/item{i}" if turning else f"/item{i}"
            colour = FAMILIES[families[item.family] % len(FAMILIES)]
            self._drawn[item.id] = _DRAW[item.kind](scene, name, item, colour)
        self._shown: dict[str, ItemView] = {}
        self._rotation: tuple[float, float, float, float] | None = None
        self._turn_to(self._picture)
        server.on_client_connect(self._welcome)

    def show(self, view: View, picture: str | None = None, trails: Trails | None = None) -> None:
        """Bring the drawing up to date, in one go; ``picture`` absent: the one that is shown."""
        with self._server.atomic():
            if picture is not None and picture != self._picture:
                self._turn_to(picture)
            trails = trails or {}
            for id, drawn in self._drawn.items():
                item = view.items.get(id)
                if item is None:
                    continue
                if item.rotation is not None and item.rotation != self._rotation:
                    self._rotation = self._body.wxyz = item.rotation
                if self._pictures[id] != self._picture:
                    item = HIDDEN
                if isinstance(drawn, _Path):
                    drawn.follow(item, view.time, trails.get(id))
                elif self._shown.get(id) != item:
                    drawn.show(item, view.time)
                self._shown[id] = item
            here = [v for id, v in self._shown.items() if v.visible and v.vector is not None]
            reach = max((math.hypot(*v.vector) for v in here if v.vector is not None), default=0.0)
            if trails:
                self._look_over(np.concatenate(list(trails.values())))
            elif reach > self._radius:
                self._look(reach)
        self._server.flush()

    def _turn_to(self, picture: str) -> None:
        """Show another picture: its ground, and the camera where a person first stands."""
        self._picture = picture
        for part in self._ground:
            part.visible = picture in self._grounded
        self._ways_radius = 0.0
        self._look(LEAST_RADIUS)

    def _look_over(self, points: NDArray[np.float64]) -> None:
        """Stand where the ways ``(n, 3)`` are seen from start to end; well back, so as not to move at every step."""
        points = points[np.isfinite(points).all(axis=-1)]
        if not len(points):
            return
        low, high = np.minimum(points.min(axis=0), 0.0), np.maximum(points.max(axis=0), 0.0)
        radius = max(0.5 * float(np.linalg.norm(high - low)), 0.25)
        if not 0.55 * self._ways_radius < radius < self._ways_radius:
            self._ways_radius = 1.2 * radius
            east, north = points[-1, :2]
            # From the right-hand side of the way, so that its length and its height are seen.
            side = np.array([north, -east, 0.45 * math.hypot(east, north)])
            self._look(self._ways_radius, 0.5 * (low + high), side if side.any() else FROM)

    def _look(self, radius: float, middle: NDArray[np.float64] | None = None, side: NDArray[np.float64] = FROM) -> None:
        """Stand where everything within ``radius`` is seen; who is looking already is taken along.

        What reaches far is in the sky, so the camera looks at a point a little above the middle.
        """
        self._radius = radius
        if middle is None:
            middle = np.array([0.0, 0.0, 0.3 * (radius - LEAST_RADIUS)])
        self._stand = (radius, middle, side / np.linalg.norm(side))
        self._place(self._server.initial_camera, WIDE)
        for client in self._server.get_clients().values():
            self._place(client.camera, client.camera.aspect)

    def _place(self, camera: Any, aspect: float) -> None:
        """Put a camera where everything is seen in a picture of this width over height."""
        radius, middle, side = self._stand
        position = middle + side * distance(radius, aspect)
        camera.fov, camera.position, camera.look_at = FIELD_OF_VIEW, tuple(position), tuple(middle)

    def _welcome(self, client: Any) -> None:
        """Step back for someone whose picture is narrow."""
        if client.camera.aspect < WIDE:
            self._place(client.camera, client.camera.aspect)


def distance(radius: float, aspect: float) -> float:
    """How far a camera stands from the middle to see the sky within ``radius``, and what is below it.

    Args:
        radius: how far the things reach [scene units].
        aspect: the picture's width over its height.
    """
    half = math.tan(0.5 * FIELD_OF_VIEW)
    return radius * max(0.93 / math.sin(math.atan(half)), 1.0 / math.sin(math.atan(half * aspect)))


def colour_of(health: Health, family: Colour) -> Colour:
    """Colour of an item: its health's, or its family's where all is well."""
    return HEALTH.get(health, family)


def _draw_level(scene: Any) -> tuple[Any, ...]:
    """A quiet ground: its parts."""
    grid = scene.add_grid(
        "/level",
        width=3.0,
        height=3.0,
        position=(0.0, 0.0, -0.9),
        cell_size=0.5,
        section_size=1.5,
        cell_color=(112, 112, 112),
        section_color=(128, 128, 128),
        cell_thickness=0.6,
        section_thickness=0.9,
        shadow_opacity=0.0,
    )
    return (grid,)


class _Coloured:
    """The part that all items share: the colour of their health, or of their family."""

    def __init__(self, colour: Colour) -> None:
        self._family = colour
        self._health: Health = "ok"

    def _mark(self, view: ItemView, paint: Callable[[Colour], None]) -> None:
        if view.health != self._health:
            self._health = view.health
            paint(colour_of(view.health, self._family))


class _Arrow(_Coloured):
    """An axis, a spin axis or a free vector: an arrow from the origin of its frame."""

    def __init__(self, scene: Any, name: str, item: SceneItem, colour: Colour) -> None:
        super().__init__(colour)
        radius = {"axis": 0.014, "spin": 0.008, "vector": 0.022}[item.kind]
        self._arrow = scene.add_arrows(
            name,
            _from_origin(item.vector or (0.0, 0.0, 1e-3)),
            _linear(colour),
            shaft_radius=radius,
            head_radius=2.6 * radius,
            head_length=7.0 * radius,
            visible=False,
        )

    def show(self, view: ItemView, time: float) -> None:
        vector = view.vector or (0.0, 0.0, 0.0)
        length = math.hypot(*vector)
        visible = view.visible and math.isfinite(length) and length > 1e-6
        self._arrow.visible = visible
        if visible:
            self._arrow.points = _from_origin(vector)
        self._mark(view, self._paint)

    def _paint(self, colour: Colour) -> None:
        self._arrow.colors = _linear(colour)


class _Plane(_Coloured):
    """A square patch through the origin, given by its normal."""

    def __init__(self, scene: Any, name: str, item: SceneItem, colour: Colour) -> None:
        super().__init__(colour)
        vertices, faces = shapes.square(0.7)
        self._patch = scene.add_mesh_simple(
            name, vertices, faces, color=colour, opacity=0.3, side="double", cast_shadow=False, receive_shadow=False,
            visible=False,
        )  # fmt: skip

    def show(self, view: ItemView, time: float) -> None:
        vector = view.vector or (0.0, 0.0, 1.0)
        self._patch.visible = view.visible
        self._patch.wxyz = shapes.turn_z_to(vector)
        self._mark(view, self._paint)

    def _paint(self, colour: Colour) -> None:
        self._patch.color = colour


class _LineOfSight(_Coloured):
    """A line with a ball at its end."""

    def __init__(self, scene: Any, name: str, item: SceneItem, colour: Colour) -> None:
        super().__init__(colour)
        self._line = scene.add_line_segments(
            name, _from_origin((0.0, 0.0, 1e-3)), colour, thickness=1.5, thickness_units="screen", visible=False
        )
        self._ball = scene.add_icosphere(
            f"{name}/ball", radius=0.05, color=colour, subdivisions=2, cast_shadow=False, receive_shadow=False
        )

    def show(self, view: ItemView, time: float) -> None:
        visible = view.visible and view.vector is not None
        self._line.visible = visible
        vector = view.vector or (0.0, 0.0, 0.0)
        if visible:
            self._line.points = _from_origin(vector)
            self._ball.position = vector
        self._mark(view, self._paint)

    def _paint(self, colour: Colour) -> None:
        self._line.colors = np.array(colour, np.uint8)
        self._ball.color = colour


class _Aircraft(_Coloured):
    """The aircraft, nose along the body's first axis; the scene turns the body frame."""

    def __init__(self, scene: Any, name: str, item: SceneItem, colour: Colour) -> None:
        super().__init__(colour)
        vertices, faces = shapes.aircraft(0.8)
        self._hull = scene.add_mesh_simple(
            name, vertices, faces, color=colour, opacity=0.32, side="double", flat_shading=True, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip

    def show(self, view: ItemView, time: float) -> None:
        self._hull.visible = view.visible
        self._mark(view, self._paint)

    def _paint(self, colour: Colour) -> None:
        self._hull.color = colour


class _Path(_Coloured):
    """The way of a point: where it has been up to the moment shown."""

    def __init__(self, scene: Any, name: str, item: SceneItem, colour: Colour) -> None:
        super().__init__(colour)
        self._line = scene.add_line_segments(
            name, np.zeros((1, 2, 3), np.float32), colour, thickness=2.0, thickness_units="screen", visible=False
        )
        self._way: list[tuple[float, Vector]] = []

    def follow(self, view: ItemView, time: float, trail: NDArray[np.float64] | None) -> None:
        """The whole way, where it is known (n, 3); else what has been seen of it."""
        if trail is None:
            self.show(view, time)
        else:
            self._draw(view, trail)

    def show(self, view: ItemView, time: float) -> None:
        self._way = [(t, point) for t, point in self._way if t < time]
        if view.vector is not None:
            self._way.append((time, view.vector))
        if len(self._way) > MOST_PATH_POINTS:
            self._way = self._way[::2]
        self._draw(view, np.array([point for _, point in self._way]))

    def _draw(self, view: ItemView, way: NDArray[np.float64]) -> None:
        visible = view.visible and len(way) > 1
        self._line.visible = visible
        self._mark(view, self._paint)
        if visible:
            points = way.astype(np.float32)
            self._line.points = np.stack([points[:-1], points[1:]], axis=1)

    def _paint(self, colour: Colour) -> None:
        self._line.colors = np.array(colour, np.uint8)


class _Ball(_Coloured):
    """A see-through ball around the origin, as large as its vector is long."""

    def __init__(self, scene: Any, name: str, item: SceneItem, colour: Colour) -> None:
        super().__init__(colour)
        self._ball = scene.add_icosphere(
            name, radius=1.0, color=colour, opacity=0.1, subdivisions=3, side="double", cast_shadow=False,
            receive_shadow=False, visible=False,
        )  # fmt: skip

    def show(self, view: ItemView, time: float) -> None:
        radius = math.hypot(*(view.vector or (0.0, 0.0, 0.0)))
        self._ball.visible = view.visible and radius > 0.0
        if self._ball.visible:
            self._ball.scale = radius
        self._mark(view, self._paint)

    def _paint(self, colour: Colour) -> None:
        self._ball.color = colour


_DRAW: dict[str, Callable[[Any, str, SceneItem, Colour], Drawn]] = {
    "axis": _Arrow,
    "spin": _Arrow,
    "vector": _Arrow,
    "plane": _Plane,
    "line-of-sight": _LineOfSight,
    "aircraft": _Aircraft,
    "path": _Path,
    "ball": _Ball,
}


def _linear(colour: Colour) -> np.ndarray:
    """viser takes an arrow's colour for linear light, everything else's for sRGB."""
    return np.array([[round(255.0 * (part / 255.0) ** 2.2) for part in colour]], np.uint8)


def _from_origin(vector: Vector) -> np.ndarray:
    return np.array([[(0.0, 0.0, 0.0), vector]], np.float32)
