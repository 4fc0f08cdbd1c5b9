"""Unexpected exceptions of a web application."""

from __future__ import annotations

from contextlib import suppress

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send

from controller.common.supervision.tasks import REQUEST, supervised_item


def counting(app: ASGIApp) -> ASGIApp:
    """Return an application that answers unexpected exceptions with status 500, counts them and raises none."""

    async def call(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await app(scope, receive, send)
            return
        with supervised_item(REQUEST), suppress(ClientDisconnect):
            await app(scope, receive, send)

    return call
