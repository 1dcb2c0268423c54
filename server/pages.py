"""Files for browsers: the page, its modules, plotly.js, the login form, the API's own page."""

from __future__ import annotations

import gzip
import hashlib
import html
import mimetypes
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from urllib.parse import parse_qs

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from server.limits import client_of
from server.problems import Refused
from server.security import COOKIE, Doorkeeper, TooSoon

router = APIRouter(include_in_schema=False)
_COMPRESSIBLE = ("text/", "application/json", "image/svg+xml", "application/javascript")
REVALIDATE, FOREVER = "no-cache", "public, max-age=31536000, immutable"


@dataclass(frozen=True)
class File:
    """A file ready to be served: plain, compressed where it pays, and tagged by its content."""

    content: bytes
    compressed: bytes | None
    media_type: str
    tag: str


def _file(content: bytes, name: str, level: int) -> File:
    media_type = "text/javascript" if name.endswith((".js", ".mjs")) else mimetypes.guess_type(name)[0]
    media_type = media_type or "application/octet-stream"
    pays = media_type.startswith(_COMPRESSIBLE) and len(content) > 1000
    tag = f'"{hashlib.sha256(content).hexdigest()[:20]}"'
    return File(content, gzip.compress(content, level, mtime=0) if pays else None, media_type, tag)


@lru_cache(maxsize=256)
def _read(path: Path, modified: int, size: int) -> File:
    return _file(path.read_bytes(), path.name, 6)


@lru_cache(maxsize=1)
def plotly() -> File:
    """plotly.js from the plotly package; compressed once, at the first request."""
    source = resources.files("plotly") / "package_data" / "plotly.min.js"
    return _file(source.read_bytes(), "plotly.min.js", 6)


def respond(file: File, request: Request, cache: str, headers: dict[str, str] | None = None) -> Response:
    """A file, compressed if the browser likes, or word that it has not changed."""
    headers = {"etag": file.tag, "cache-control": cache, "vary": "accept-encoding", **(headers or {})}
    if file.tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    content = file.content
    if file.compressed is not None and "gzip" in request.headers.get("accept-encoding", ""):
        content, headers["content-encoding"] = file.compressed, "gzip"
    return Response(content, media_type=file.media_type, headers=headers)


def _below(folder: Path, name: str) -> File:
    """A file below a folder. Raises Refused (404) for anything else, links that lead out included."""
    try:
        path = (folder / name).resolve()
        if path.is_relative_to(folder.resolve()) and path.is_file():
            status = path.stat()
            return _read(path, status.st_mtime_ns, status.st_size)
    except (OSError, ValueError):  # a name that no file can have
        pass
    raise Refused(404, f"there is no file {name[:80]!r}")


def _resource(name: str) -> File:
    source = resources.files("server") / "resources" / name
    return _file(source.read_bytes(), name, 6)


@router.get("/")
def index(request: Request) -> Response:
    """The page."""
    return respond(_below(request.app.state.settings.frontend, "index.html"), request, REVALIDATE)


@router.get("/favicon.ico")
def favicon(request: Request) -> Response:
    """The icon, for browsers that look for it here."""
    return respond(_below(request.app.state.settings.frontend, "icon.svg"), request, REVALIDATE)


@router.get("/static/{name:path}")
def static(name: str, request: Request) -> Response:
    """Modules and styles of the page; asked for again each time, sent again only if changed."""
    return respond(_below(request.app.state.settings.frontend, name), request, REVALIDATE)


@router.get("/vendor/plotly.min.js")
def vendored_plotly(request: Request) -> Response:
    """plotly.js. Kept by the browser for good if the address carries its version."""
    return respond(plotly(), request, FOREVER if request.url.query else REVALIDATE)


@router.get("/docs")
def docs(request: Request) -> Response:
    """The API's page: what can be asked, drawn from openapi.json."""
    return respond(_resource("docs.html"), request, REVALIDATE)


@router.get("/docs/{name}")
def docs_file(name: str, request: Request) -> Response:
    """Script and style of the API's page."""
    if name not in ("docs.js", "docs.css"):
        raise Refused(404, f"there is no file {name!r}")
    return respond(_resource(name), request, REVALIDATE)


@router.get("/login")
def login_form(request: Request) -> Response:
    """Asks for the token."""
    if not request.app.state.doorkeeper.guarded:
        return RedirectResponse("/", status_code=303)
    return _login_page("")


@router.post("/login")
async def login(request: Request) -> Response:
    """Gives a session cookie for the token."""
    doorkeeper: Doorkeeper = request.app.state.doorkeeper
    form = (await request.body()).decode("utf-8", "replace")
    try:
        given = parse_qs(form, max_num_fields=8).get("token", [""])[0]
    except ValueError:
        given = ""
    try:
        session = doorkeeper.tried(given, client_of(request.scope))
    except TooSoon as wait:
        return _login_page(f"{str(wait).capitalize()}.", 429, {"retry-after": wait.seconds})
    if session is None:
        return _login_page("That is not the token of this server.", 401)
    response = RedirectResponse("/", status_code=303)
    secure = request.url.scheme == "https"
    response.set_cookie(COOKIE, session, httponly=True, samesite="strict", secure=secure, path="/")
    return response


def _login_page(message: str, status: int = 200, headers: dict[str, str] | None = None) -> Response:
    page = (resources.files("server") / "resources" / "login.html").read_text("utf-8")
    return Response(
        page.replace("{{message}}", html.escape(message)), status_code=status, media_type="text/html",
        headers={"cache-control": "no-store", **(headers or {})},
    )  # fmt: skip
