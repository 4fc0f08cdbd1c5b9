"""Host and Origin checks and security headers.

Requests from pages of other sites and requests for an unknown host name (DNS rebinding) are refused. The headers of
each response disable all browser features that the page does not need.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from controller.common.client_slots import is_loopback
from controller.program.texts.operator import Text

POLICY: Final = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
DEFAULT_PORTS: Final = {"http": 80, "https": 443}
FORWARDING: Final = frozenset(
    ("forwarded", "via", "x-real-ip", "x-client-ip", "x-cluster-client-ip", "true-client-ip", "cf-connecting-ip")
)
"""Headers with which proxies name their clients (RFC 7239, RFC 9110 7.6.3, and common ones), beside `x-forwarded-*`."""


class Guard:
    """ASGI middleware that checks each request and adds the security headers."""

    def __init__(self, app: ASGIApp, names: Iterable[str], refusal: Text) -> None:
        """Initialise the middleware; requests for the listening address are always accepted.

        Args:
            app: Application that receives the accepted requests.
            names: Host names of the server, without port.
            refusal: Text of the answer to a refused request.
        """
        self._app = app
        self._refusal = refusal
        self._names = {name.lower() for name in names} | {"localhost", socket.gethostname().lower()}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check a request and pass it to the application."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif self._is_allowed(scope):
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            text = self._refusal
            response = JSONResponse({"ok": False, "text": {"en": text.en, "zh": text.zh}}, status_code=403)
            await response(scope, receive, _with_headers(send))

    def _is_allowed(self, scope: Scope) -> bool:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        scheme = "https" if scope["scheme"] in ("https", "wss") else "http"
        if len(hosts) != 1 or not self._is_served(hosts[0], scheme, scope):
            return False
        if scope["type"] == "http" and scope["method"] in ("GET", "HEAD"):
            return True
        return headers.getlist("origin") == [f"{scheme}://{hosts[0]}"]

    def _is_served(self, host: str, scheme: str, scope: Scope) -> bool:
        """Return whether a Host header contains a served name or the address of this listener."""
        address, port = scope.get("server") or ("", None)
        try:
            url = urlsplit(f"//{host}")
            name, url_port = (url.hostname or "").lower(), url.port or DEFAULT_PORTS[scheme]
        except ValueError:
            return False
        if url.netloc.lower() != host.lower() or "@" in host or url_port != port:
            return False
        return name in self._names or name == str(address).lower() or (is_loopback(name) and is_loopback(address))


def peer_of(connection: HTTPConnection) -> str:
    """Return the address of the client of a connection; empty if it is unknown."""
    return connection.client.host if connection.client else ""


def is_local(connection: HTTPConnection) -> bool:
    """Return whether a client is on this computer; a proxy on it names its client in a header."""
    forwarded = any(name in FORWARDING or name.startswith("x-forwarded") for name in connection.headers)
    return is_loopback(peer_of(connection)) and not forwarded


def _with_headers(send: Send) -> Send:
    async def send_with(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return send_with
