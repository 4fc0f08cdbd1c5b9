"""What every request passes first: it must ask for a name that is served, and a page of ours must have sent it.

A page of another site, or a name that was turned to this address afterwards (DNS rebinding), gets no further. Each
answer forbids the browser whatever the page does not need.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from controller.hmi.panel.login import is_loopback
from controller.hmi.panel.replies import reply_text

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


class Guard:
    """The application behind its checks."""

    def __init__(self, app: ASGIApp, names: Iterable[str]) -> None:
        """Let through what asks for one of the names, or for the address it has reached.

        Args:
            app: The application.
            names: Names under which the panel is served, without port.
        """
        self._app = app
        self._names = {name.lower() for name in names} | {"localhost", socket.gethostname().lower()}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check a request and hand it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif self._is_served(scope):
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            text = reply_text("not served")
            answer = JSONResponse({"ok": False, "text": {"en": text.en, "zh": text.zh}}, status_code=403)
            await answer(scope, receive, _with_headers(send))

    def _is_served(self, scope: Scope) -> bool:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        scheme = "https" if scope["scheme"] in ("https", "wss") else "http"
        if len(hosts) != 1 or not self._is_ours(hosts[0], scheme, scope):
            return False
        if scope["type"] == "http" and scope["method"] in ("GET", "HEAD"):
            return True
        return headers.getlist("origin") == [f"{scheme}://{hosts[0]}"]

    def _is_ours(self, host: str, scheme: str, scope: Scope) -> bool:
        """Tell whether a Host header names this panel: a name it is served under, or the address that was reached."""
        address, port = scope.get("server") or ("", None)
        try:
            asked = urlsplit(f"//{host}")
            name, asked_port = (asked.hostname or "").lower(), asked.port or DEFAULT_PORTS[scheme]
        except ValueError:
            return False
        if asked.netloc.lower() != host.lower() or "@" in host or asked_port != port:
            return False
        return name in self._names or name == str(address).lower() or (is_loopback(name) and is_loopback(address))


def _with_headers(send: Send) -> Send:
    async def send_with(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return send_with
