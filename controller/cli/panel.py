"""Command ``panel``: serve the operator's web page for a running controller."""

from __future__ import annotations

import argparse
import logging
import socket
import ssl
import sys

from controller.cli.machine import machine_of
from controller.common.client_slots import is_loopback
from controller.common.errors import InputError
from controller.common.files.trust import secret_exposure
from controller.common.supervision.tasks import run_supervised
from controller.core.clock import MonotonicClock
from controller.history.query import HistoryReader
from controller.hmi.panel.modbus.naming import INTRODUCTION
from controller.hmi.panel.modbus.telemetry import Telemetry, load_tags
from controller.hmi.panel.orders.login import Users
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trends import MOST_PERIODS
from controller.hmi.panel.web.app import PanelApplication, Sources, application
from controller.hmi.panel.web.listener import PanelListener
from controller.hmi.web.server import WebServer, connections, listening, server_config


def run(options: argparse.Namespace) -> int:
    """Serve until the request to stop and return the exit code.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check_reach(options)
    _check_tls(options)
    machine = machine_of(options)
    users = Users(options.users)
    tags = None if options.telemetry_tags is None else load_tags(options.telemetry_tags)
    if (options.telemetry is None) != (tags is None):
        raise InputError("--telemetry and --telemetry-tags must be used together")
    clock = MonotonicClock()
    connect = connections("--controller", options.controller, INTRODUCTION)
    telemetry = None
    if tags is not None:
        telemetry = Telemetry(connections("--telemetry", options.telemetry)(), tags, clock)
    history = HistoryReader(options.history)
    trends = TrendFile(options.trends, MOST_PERIODS)
    trends.check()
    sources = Sources(machine, connect, telemetry, history, clock, options.language, trends)
    with listening(options.host, options.port) as listener:
        run_supervised(_serve(sources, users, listener, options))
    return 0


async def _serve(sources: Sources, users: Users, listener: socket.socket, options: argparse.Namespace) -> None:
    secure = options.certificate is not None
    listener = PanelListener(listener, sources.clock)
    panel = PanelApplication(sources, users, listener, secure=secure)
    config = server_config(application(panel, [options.host, *options.names]), options.certificate, options.key)
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    host, port = listener.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    server = WebServer(config, "panel", f"{'https' if secure else 'http'}://{shown}:{port}")
    # For a signal before the server installs its own handlers.
    with options.stop.calling(lambda: setattr(server, "should_exit", True)):
        await server.serve(sockets=[listener])


def _check_reach(options: argparse.Namespace) -> None:
    if is_loopback("127.0.0.1" if options.host == "localhost" else options.host):
        return
    if not options.allow_remote:
        raise InputError(
            f"--host {options.host}: other computers could reach the panel; use --allow-remote to permit this"
        )
    if options.certificate is None:
        sys.stderr.write("warning: no TLS: passwords are sent unencrypted; use --certificate and --key\n")


def _check_tls(options: argparse.Namespace) -> None:
    if (options.certificate is None) != (options.key is None):
        raise InputError("--certificate and --key must be used together")
    if options.certificate is None:
        return
    if problem := secret_exposure(options.key):
        raise InputError(f"--key {problem}")
    try:
        # Without password="", an encrypted key would cause a password prompt on the terminal.
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(options.certificate, options.key, password="")
    except OSError as error:
        raise InputError(
            f"--certificate {options.certificate}, --key {options.key}: {error}; specify a matching pair of PEM files"
        ) from error
