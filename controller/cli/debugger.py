"""Front ends of the debugger: a text console, and the adapter for editors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from typing import Final

from controller.common.arguments.number_type import PORT, integer
from controller.common.errors import InputError
from controller.debug.adapter.server import listening, serve_port, serve_stdio
from controller.debug.commands import Debugger
from controller.debug.timeline import RunTimeline

STDIO: Final = "stdio"


def add_debugger_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options with commands, for the page, and with the connection of an editor."""
    front = parser.add_mutually_exclusive_group()
    front.add_argument(
        "--do",
        action="append",
        default=None,
        metavar="COMMAND",
        help="command of the debugger, repeatable; omitted = read commands from standard input; 'help' lists them",
    )
    front.add_argument(
        "--dap",
        nargs="?",
        const=STDIO,
        type=_place,
        metavar="PORT",
        help="serve an editor with the Debug Adapter Protocol, on standard input and output or on a loopback port",
    )
    parser.add_argument(
        "--page",
        type=PORT,
        default=None,
        metavar="PORT",
        help="serve the run as a ladder page on this computer, after the commands of --do; 0 = any free port",
    )


def _place(text: str) -> int | str:
    return STDIO if text == STDIO else int(integer(0, 65_535)(text))


def present(line: RunTimeline, options: argparse.Namespace, serve_page: Callable[[Debugger, int], int]) -> int:
    """Show a recorded run in the front end that the options of `add_debugger_arguments` name; return the exit code.

    Args:
        line: Recorded run.
        options: Options of the command.
        serve_page: Function that serves the page of a debugger on a port and returns the exit code.

    Raises:
        InputError: A command is invalid, a port is not available, or an editor has sent no message.
    """
    if options.page is not None:
        if options.dap is not None:
            raise InputError("--page and --dap: choose one of them")
        return serve_page(converse(line, options.do or ()), options.page)
    if options.dap is None:
        converse(line, options.do)
    elif options.dap == STDIO:
        serve_stdio(line, sys.stdin.fileno(), sys.stdout.fileno(), options.stop)
    else:
        with listening(options.dap) as listener:
            print(f"debug adapter: 127.0.0.1:{listener.getsockname()[1]}", flush=True)
            serve_port(line, listener, options.stop, lambda text: print(text, file=sys.stderr, flush=True))
    return 0


def converse(line: RunTimeline, commands: Iterable[str] | None) -> Debugger:
    """Execute commands on a recorded run and print the answers; return the debugger.

    At a terminal an invalid command is reported, and the next one is read.

    Args:
        line: Recorded run.
        commands: Commands; None = the lines of standard input.

    Raises:
        InputError: A command is invalid.
    """
    debugger = Debugger(line)
    is_terminal = commands is None and sys.stdin.isatty()
    print(f"recorded: scans {line.first} to {line.last}", flush=True)
    for command in sys.stdin if commands is None else commands:
        try:
            for answer in debugger.execute(command):
                print(answer, flush=True)
        except InputError as error:
            if not is_terminal:
                raise
            print(error, file=sys.stderr, flush=True)
    return debugger
