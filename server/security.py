"""Who may talk to this server: names it answers to, pages it trusts, the token, and what browsers are told.

FTLab is a server on a person's own machine, so every web page that person visits can try to reach it. Foreign pages are
kept out by the Host header (against DNS rebinding) and the Origin header (against cross-site requests), on HTTP and
WebSocket alike. Other machines are kept out by the bind address, and let in only with the token.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.limits import Patience, client_of, whole_seconds
from server.problems import problem
from server.settings import LOOPBACK, Settings
from server.uploads import UPLOAD_PATH

COOKIE = "ftlab-session"
TOKEN_HEADER = "x-ftlab-token"
OPEN_PATHS = ("/login", "/api/v1/health")
"""Reachable without a token."""

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src 'self'; connect-src 'self'; frame-src 'self'; worker-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'self'"
)
"""For the page: scripts are files of this server. Plotly writes style elements, so styles may be inline."""

SCENE_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""For the 3-D scene's frame: viser's client unpacks itself from inline script."""

REPORT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'; sandbox allow-scripts allow-downloads"
)
"""For a report, which is one file with everything in it: it can reach nothing, not even this server."""

_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "content-security-policy": PAGE_POLICY,
}
_SAFE = ("GET", "HEAD", "OPTIONS")


class TooSoon(Exception):
    """A client that has tried wrong tokens must wait; says how long [s]."""

    def __init__(self, wait: float) -> None:
        self.seconds = whole_seconds(wait)
        super().__init__(f"too many wrong tokens from your address; try again in {self.seconds} s")


class Doorkeeper:
    """Decides who may come in; knows nothing of ASGI."""

    def __init__(self, settings: Settings) -> None:
        self._token = settings.token
        self._names = {name.lower() for name in (*LOOPBACK, settings.host)}
        self._extra = {name.lower() for name in settings.allowed_hosts}
        self._any_address = settings.host not in LOOPBACK
        self.patience = Patience()
        self._session = hmac.new(secrets.token_bytes(32), (settings.token or "").encode(), hashlib.sha256).hexdigest()

    @property
    def guarded(self) -> bool:
        """Whether a token is needed."""
        return self._token is not None

    def session_for(self, token: str) -> str | None:
        """Cookie value for a token; None if it is the wrong one."""
        if self._token is None or not hmac.compare_digest(token.encode(), self._token.encode()):
            return None
        return self._session

    def remembers(self, headers: Headers) -> bool:
        """Whether the request carries the cookie that was given for the token, or none is needed."""
        if self._token is None:
            return True
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return morsel is not None and hmac.compare_digest(morsel.value.encode(), self._session.encode())

    def tried(self, token: str, client: str) -> str | None:
        """Session for a token that a client tries; None if it is the wrong one, and that is remembered.

        Raises:
            TooSoon: the client has tried wrong ones; it is not even looked at until the wait is over.
        """
        wait = self.patience.wait(client)
        if wait > 0.0:
            raise TooSoon(wait)
        session = self.session_for(token)
        if session is None:
            self.patience.failed(client)
        else:
            self.patience.succeeded(client)
        return session

    def answers_to(self, authority: str, port: int | None, scheme: str) -> bool:
        """Whether ``name:port`` is one of this server's.

        Bound to other addresses too, any literal IP address is: no DNS name can be rebound to it.
        """
        authority = authority.lower()
        if authority in self._extra:
            return True
        try:
            parts = urlsplit(f"//{authority}")
            name, given = parts.hostname, parts.port
        except ValueError:
            return False
        if name is None or parts.username is not None or parts.path:
            return False
        if name in self._extra:
            return True
        if port is not None and (given or (443 if scheme in ("https", "wss") else 80)) != port:
            return False
        return name in self._names or (self._any_address and _is_address(name))

    def trusts(self, origin: str, port: int | None) -> bool:
        """Whether a page of this origin may talk to the server."""
        scheme, separator, authority = origin.partition("://")
        return bool(separator) and scheme in ("http", "https") and self.answers_to(authority, port, scheme)


def _token_in(headers: Headers) -> str | None:
    """The token that a request carries, right or wrong; None if it carries none."""
    scheme, _, bearer = headers.get("authorization", "").partition(" ")
    given = bearer.strip() if scheme.lower() == "bearer" else headers.get(TOKEN_HEADER, "")
    return given or None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class Security:
    """ASGI middleware: Host, Origin and token before anything else, and headers on everything that leaves."""

    def __init__(self, app: ASGIApp, doorkeeper: Doorkeeper) -> None:
        self.app = app
        self.doorkeeper = doorkeeper

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let in or refuse."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if scope["type"] == "websocket":
            if refusal is None:
                await self.app(scope, receive, send)
            else:
                await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await (refusal or self.app)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> Response | None:
        headers, scheme = Headers(scope=scope), scope["scheme"]
        port = scope["server"][1] if scope.get("server") else None
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self.doorkeeper.answers_to(hosts[0], port, scheme):
            return problem(403, "this server does not answer to that Host; FTLAB_ALLOWED_HOSTS can add a name")
        origin = headers.get("origin")
        if origin is not None and not self.doorkeeper.trusts(origin, port):
            return problem(403, "requests from pages of another origin are refused")
        if headers.get("sec-fetch-site") == "cross-site" and scope.get("method", "GET") not in _SAFE:
            return problem(403, "requests from pages of another site are refused")
        if scope["path"] in OPEN_PATHS or self.doorkeeper.remembers(headers):
            return self._unreadable(scope, headers)
        token = _token_in(headers)
        if token is not None:
            try:
                if self.doorkeeper.tried(token, client_of(scope)) is not None:
                    return self._unreadable(scope, headers)
            except TooSoon as wait:
                return problem(429, str(wait), headers={"retry-after": wait.seconds})
        if scope.get("method") == "GET" and "text/html" in headers.get("accept", ""):
            return RedirectResponse("/login", status_code=303)
        return problem(401, "a token is needed: Authorization: Bearer <token>", headers={"www-authenticate": "Bearer"})

    @staticmethod
    def _unreadable(scope: Scope, headers: Headers) -> Response | None:
        """A body for the API that is not said to be JSON is refused unread; a form of another page cannot say so.

        Files come as a form, to one path; there another page is told by the Origin that browsers send with every form.
        """
        if scope.get("method", "GET") in _SAFE or not scope["path"].startswith("/api/"):
            return None
        if headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers:
            return None
        kind = headers.get("content-type", "").partition(";")[0].strip().lower()
        if scope["path"] == UPLOAD_PATH:
            if kind == "multipart/form-data":
                return None
            return problem(415, f"send multipart/form-data, not {kind or 'a body without a content type'}")
        if kind == "application/json" or (kind.startswith("application/") and kind.endswith("+json")):
            return None
        return problem(415, f"send application/json, not {kind or 'a body without a content type'}")
