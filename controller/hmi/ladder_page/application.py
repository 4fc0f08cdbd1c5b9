"""Web application of the ladder page: its files, the program, and the scans. All requests only read."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp

from controller.common.errors import InputError
from controller.common.supervision.tasks import supervised_task
from controller.debug.why.answer import WhySentence
from controller.fx.observation.cross_reference import device_key
from controller.fx.observation.observation import ObservedAt
from controller.hmi.ladder_page.live_scan import LiveScan
from controller.hmi.ladder_page.program import COLUMNS, MOST_RUNGS, Json
from controller.hmi.ladder_page.source import (
    NotConnectedError,
    NotReadyError,
    PageSource,
    ScanNotKeptError,
    UnknownScanError,
)
from controller.hmi.ladder_page.texts import NOT_SERVED, TEXTS
from controller.hmi.web.failures import counting
from controller.hmi.web.files import static_routes
from controller.hmi.web.guard import Guard
from controller.program.texts.operator import Text

STATIC: Final = Path(__file__).parent / "static"
LONGEST_COMMAND: Final = 500
"""Longest command, bytes."""
LONGEST_TEXT: Final = 100
"""Longest text of a search, characters."""
MOST_NAMED: Final = 20
"""Largest number of devices or instructions that are named as the reason why a scan is not shown as executed."""
VIEWS: Final = {"end": ObservedAt.END_VALUES, "executed": ObservedAt.AS_EXECUTED}


class LadderPage:
    """Answers to the requests of a ladder page.

    Attributes:
        source: Scans to show.
        picture: Picture of the machine of a recorded run; None = there is none.
    """

    def __init__(self, source: PageSource) -> None:
        """Initialise the page.

        Args:
            source: Scans to show.
        """
        self.source = source
        self._program = source.program
        run = source.recorded()
        self.picture = None if run is None else run.picture

    async def describe(self, request: Request) -> Response:
        """Return the texts and the program without its rungs."""
        columns = _number(request, "columns", COLUMNS)
        if columns is None:
            return _malformed("columns")
        texts = {key: text._asdict() for key, text in TEXTS.items()}
        return JSONResponse(
            self._program.description(columns)
            | {"texts": texts, "live": self.source.is_live, "picture": self.picture is not None}
        )

    async def machine(self, _: Request) -> Response:
        """Return the description for the picture of the machine."""
        return Response(status_code=404) if self.picture is None else JSONResponse(self.picture.description())

    async def rungs(self, request: Request) -> Response:
        """Return the pictures of some rungs."""
        columns, span = _number(request, "columns", COLUMNS), _span(request)
        if columns is None or span is None:
            return _malformed("first, count, columns")
        return JSONResponse(self._program.rungs(*span, columns))

    async def chart(self, request: Request) -> Response:
        """Return the picture of a step chart."""
        picture = self._program.chart(request.path_params["name"])
        return Response(status_code=404) if picture is None else Response(picture, media_type="image/svg+xml")

    async def device(self, request: Request) -> Response:
        """Return the uses of a device."""
        found = self._program.device(request.query_params.get("name", "")[:LONGEST_TEXT])
        return _malformed("name") if found is None else JSONResponse(found)

    async def find(self, request: Request) -> Response:
        """Return what a search finds."""
        return JSONResponse(self._program.find(request.query_params.get("text", "")[:LONGEST_TEXT]))

    async def look(self, request: Request) -> Response:
        """Return the states of some rungs in a scan, and on request the machine after it."""
        view, span = VIEWS.get(request.query_params.get("view", "")), _span(request)
        scan = _number(request, "scan", range(2**32)) if "scan" in request.query_params else None
        if view is None or span is None or (scan is None and "scan" in request.query_params):
            return _malformed("view, first, count, scan")
        try:
            if request.query_params.get("keep") == "1":
                seen = await self.source.keep()
            else:
                seen = await self.source.look(view, scan)
            run = self.source.recorded() if request.query_params.get("machine") == "1" else None
            machine = None if run is None else await run.machine(seen.held.number)
        except NotReadyError:
            return JSONResponse({"state": "starting"}, status_code=503)
        except NotConnectedError as error:
            return JSONResponse({"state": "lost", "reason": str(error)}, status_code=503)
        except ScanNotKeptError as error:
            return JSONResponse({"state": "gone", "reason": str(error)}, status_code=410)
        return JSONResponse(self._look(seen, view, span) | {"machine": machine})

    async def why(self, request: Request) -> Response:
        """Return why a device is on or off after a scan; without a number, the last one or that of the position."""
        device = device_key(request.query_params.get("device", "")[:LONGEST_TEXT])
        scan = _number(request, "scan", range(2**32)) if "scan" in request.query_params else None
        if device is None:
            return _malformed("device")
        try:
            found = await self.source.explain(device, scan)
        except (NotReadyError, NotConnectedError):
            return JSONResponse({"available": False, "lines": []}, status_code=503)
        except UnknownScanError as error:
            return JSONResponse({"available": False, "lines": []} | _unknown(error.seen))
        except InputError as error:
            found = [WhySentence(Text(str(error), str(error)))]
        lines = [
            {"text": line.text._asdict(), "rung": next(iter(line.rungs), None), "cause": line.is_cause}
            for line in found
        ]
        return JSONResponse({"available": True, "lines": lines})

    async def run(self, _: Request) -> Response:
        """Return the state of the recorded run."""
        run = self.source.recorded()
        return Response(status_code=404) if run is None else JSONResponse(await run.state())

    async def command(self, request: Request) -> Response:
        """Execute a command of the debugger on the recorded run."""
        run, body = self.source.recorded(), b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > LONGEST_COMMAND:
                return _malformed("command")
        if run is None:
            return Response(status_code=404)
        try:
            lines = await run.execute(body.decode(errors="replace"))
        except InputError as error:
            return JSONResponse({"state": "refused", "reason": str(error)}, status_code=400)
        return JSONResponse({"lines": lines, "run": await run.state()})

    def _look(self, seen: LiveScan, view: ObservedAt, span: tuple[int, int]) -> Json:
        executed = view is ObservedAt.AS_EXECUTED
        shown = seen.known if executed else seen.end
        memory = seen.held.memory
        return self._program.states(*span, shown, memory) | {
            "scan": seen.held.number,
            "at_ms": seen.held.at_ms,
            "view": next(name for name, each in VIEWS.items() if each is view),
            **(_unknown(seen) if executed else {"differing": [], "hidden": []}),
            "known": shown is not None,
            "active": self._program.active(memory),
        }


def application(page: LadderPage, names: Iterable[str]) -> ASGIApp:
    """Return a ladder page as an ASGI application.

    Args:
        page: The page.
        names: Host names of the server, without port, in addition to the local host name and the listening address.
    """

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        task = supervised_task("ladder page", page.source.run)
        try:
            yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def index(_: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    routes: list[BaseRoute] = [
        Route("/", index),
        *static_routes(STATIC),
        Route("/api/describe", page.describe),
        Route("/api/rungs", page.rungs),
        Route("/api/charts/{name}", page.chart),
        Route("/api/device", page.device),
        Route("/api/find", page.find),
        Route("/api/look", page.look),
        Route("/api/why", page.why),
    ]
    if page.source.recorded() is not None:  # nothing moves a live controller
        routes += [Route("/api/run", page.run), Route("/api/command", page.command, methods=["POST"])]
    if page.picture is not None:
        routes += [Route("/api/machine", page.machine), *static_routes(page.picture.files, "/panel")]
    return Guard(counting(Starlette(routes=routes, lifespan=lifespan)), names, NOT_SERVED)


def _unknown(seen: LiveScan) -> Json:
    """Return the reasons for which a scan is not known as executed."""
    return {"differing": list(seen.differing[:MOST_NAMED]), "hidden": list(seen.hidden[:MOST_NAMED])}


def _span(request: Request) -> tuple[int, int] | None:
    """Return the first rung and the number of rungs of a request; None if they are malformed."""
    first, count = _number(request, "first", range(10**6)), _number(request, "count", range(MOST_RUNGS + 1))
    return None if first is None or count is None else (first, count)


def _number(request: Request, name: str, allowed: range) -> int | None:
    """Return a number of the query; None if it is malformed."""
    text = request.query_params.get(name, "")
    number = int(text) if text.isascii() and text.isdecimal() and len(text) <= 10 else -1
    return number if number in allowed else None


def _malformed(names: str) -> Response:
    return JSONResponse({"state": "malformed", "reason": f"malformed request: {names}"}, status_code=400)
