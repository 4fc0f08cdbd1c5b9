"""Server of the ladder page."""

from __future__ import annotations

import argparse
import logging
import socket
from typing import Final

from starlette.types import ASGIApp

from controller.cli.fx_options import cpu_of
from controller.cli.ladder.find import machine_reference, machine_texts
from controller.cli.machine import machine_of
from controller.common.client_slots import is_loopback
from controller.common.errors import InputError
from controller.common.stop_request import StopRequest
from controller.common.supervision.tasks import run_supervised
from controller.core.clock import MonotonicClock
from controller.debug.commands import Debugger
from controller.debug.why.machine_program import MachineProgram
from controller.export.instruction_list import SCRATCH
from controller.fx.engine.parts import parts_of
from controller.fx.language.instruction import Ladder
from controller.fx.language.reading import load_ladder
from controller.fx.observation.cross_reference import CrossReference
from controller.hmi.ladder_page.application import LadderPage, application
from controller.hmi.ladder_page.live_source import LiveSource
from controller.hmi.ladder_page.program import PageProgram
from controller.hmi.ladder_page.recorded_source import RecordedSource
from controller.hmi.ladder_page.source import RunPicture
from controller.hmi.web.server import WebServer, connections, listening, server_config
from controller.program.machine import Transplanter

_LIMIT: Final = 64
"""Largest number of connections of browsers."""


def serve_live_page(options: argparse.Namespace) -> int:
    """Serve the page of a running program until the request to stop and return the exit code.

    Raises:
        InputError: The program or an option is invalid.
    """
    if options.machine == (options.file is not None):
        raise InputError("ladder page: give either the file of a program or --machine")
    check_loopback(options.host)
    connection = connections("--connect", options.connect)()
    if options.machine:
        program, work = program_of_machine(machine_of(options))
    else:
        program, work = program_of_file(options.file.name, load_ladder(options.file, cpu_of(options))), []
    parts_of(program.ladder)  # raises if the program cannot be run
    source = LiveSource(program, connection, MonotonicClock(), work)
    return serve(LadderPage(source), options.host, options.port, options.stop)


def serve_recorded_page(
    debugger: Debugger, program: PageProgram, port: int, stop: StopRequest, picture: RunPicture | None = None
) -> int:
    """Serve the page of a recorded run until the request to stop and return the exit code.

    Args:
        debugger: Debugger of the run.
        program: The program that was recorded.
        port: Port of the web server; 0 = any free port.
        stop: Request to stop.
        picture: Picture of the machine of the run; None = it has none.

    Raises:
        InputError: The port cannot be listened on.
    """
    return serve(LadderPage(RecordedSource(program, debugger, picture)), "127.0.0.1", port, stop)


def program_of_file(name: str, ladder: Ladder) -> PageProgram:
    """Return a program that was read from a file."""
    return PageProgram(name, CrossReference(ladder))


def program_of_machine(machine: Transplanter) -> tuple[PageProgram, list[tuple[str, int]]]:
    """Return the program of a machine, and the devices of its ladder that the controller does not have."""
    alarms = [((alarm.bit.kind, alarm.bit.number), alarm.text.message) for alarm in machine.alarms]
    texts, reference = machine_texts(machine), machine_reference(machine)
    program = PageProgram(machine.program.name, reference, texts, alarms, lambda: MachineProgram(machine))
    return program, [("D", number) for number in SCRATCH]


def check_loopback(host: str) -> None:
    """Refuse an address that other computers can reach: the page has no login.

    Raises:
        InputError: The address is not one of this computer.
    """
    if not is_loopback("127.0.0.1" if host == "localhost" else host):
        raise InputError(f"--host {host}: the page has no login; use 127.0.0.1, and a tunnel from other computers")


def serve(page: LadderPage, host: str, port: int, stop: StopRequest) -> int:
    """Serve a page until the request to stop and return the exit code.

    Raises:
        InputError: The address cannot be listened on.
    """
    with listening(host, port) as listener:
        stop.collect()
        run_supervised(_serve(application(page, [host]), listener, stop))
    return 0


async def _serve(app: ASGIApp, listener: socket.socket, stop: StopRequest) -> None:
    config = server_config(app)
    config.limit_concurrency = _LIMIT
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    host, port = listener.getsockname()[:2]
    server = WebServer(config, "ladder page", f"http://{f'[{host}]' if ':' in host else host}:{port}")
    with stop.calling(lambda: setattr(server, "should_exit", True)):
        await server.serve(sockets=[listener])
