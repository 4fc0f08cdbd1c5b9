"""Command line with one module per command: parser, version, one-line error messages, exit codes."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import importlib.metadata
import os
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Protocol, cast

from controller.common.declarations import DeclarationError, declared_at
from controller.common.errors import InputError
from controller.common.extras import DISTRIBUTION, install_hint
from controller.common.stop_request import INTERRUPTED, StopRequest

USAGE_ERROR = 2
"""Exit code for invalid input and for a missing optional dependency."""
BROKEN_PIPE = 141
"""Exit code if the reader of the output has disconnected: 128 + SIGPIPE, by shell convention."""
UNWRITTEN = 74
"""Exit code of a successful command whose output could not be written: EX_IOERR of sysexits.h."""


class CommandModule(Protocol):
    """Interface of the module of a command."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of the command."""

    def run(self, options: argparse.Namespace) -> int:
        """Run the command and return its exit code.

        Raises:
            InputError: An option or a file is invalid.
        """


class Parser(argparse.ArgumentParser):
    """Parser, also of subcommands, that reports an invalid argument in one line and exits with code 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit."""
        self.exit(USAGE_ERROR, f"{self.prog}: {message}; see --help\n")


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Help formatter that shows the default of every option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default is None or action.default is False or action.default == []:
            return action.help
        return super()._get_help_string(action)


@dataclass(frozen=True, slots=True)
class CommandLine:
    """Command line of a package.

    Attributes:
        package: Name of the package, as in ``python -m <package>``.
        script: Name of its console command.
        description: First line of the help text.
        commands: Module and one-line help of each command, by its name.
        default: Command to run if the first argument is not the name of a command.
        services: Commands that run until they are stopped. Ctrl-C is their regular end, with exit code 0; they find the
            request in ``options.stop``. Any other command is interrupted.
    """

    package: str
    script: str
    description: str
    commands: Mapping[str, tuple[str, str]]
    default: str
    services: frozenset[str]

    @property
    def prog(self) -> str:
        """Name under which the program was started."""
        return self.script if Path(sys.argv[0]).stem == self.script else f"python -m {self.package}"

    def parser(self, loaded: Collection[str] | None = None) -> Parser:
        """Return the parser.

        Args:
            loaded: Commands whose modules are imported and whose options are added; None = all.
        """
        parser = Parser(
            prog=self.prog, description=self.description, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        parser.add_argument(
            "--version", action="version", version=f"{DISTRIBUTION} {version()}", help="show the version and exit"
        )
        commands = parser.add_subparsers(required=True, metavar="COMMAND")
        for name, (module_name, help_line) in self.commands.items():
            command = commands.add_parser(name, help=help_line, formatter_class=HelpFormatter)
            if loaded is None or name in loaded:
                module = cast("CommandModule", importlib.import_module(module_name))
                module.add_arguments(command)
                command.set_defaults(command=module.run)
                if name == self.default:
                    parser.epilog = f"Without a command:\n\n{command.format_help()}"
        return parser

    def run(self, arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
        """Run a command and return its exit code.

        Only the module of that command is imported, so that a command does not need the dependencies of the others.

        Args:
            arguments: Command-line arguments; None = those of the process.
            stop: Request to stop the process; None leaves the signal handlers unchanged.
        """
        given = list(sys.argv[1:] if arguments is None else arguments)
        if not given or given[0] not in (*self.commands, "-h", "--help", "--version"):
            given.insert(0, self.default)
        name = self.default if given[0] in {"-h", "--help"} else given[0]
        return run_command(
            name, lambda request: self._run(name, given, request), stop, is_service=name in self.services
        )

    def _run(self, name: str, given: Sequence[str], stop: StopRequest) -> int:
        options = self.parser({name}).parse_args(given)
        options.stop = stop
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)


def run_command(
    name: str, command: Callable[[StopRequest], int], stop: StopRequest | None = None, *, is_service: bool = False
) -> int:
    """Run a command and return its exit code; invalid input and a missing dependency are one line on standard error.

    Args:
        name: Name of the command, which begins the line about a missing optional dependency.
        command: Function that parses the arguments, prints the output and returns the exit code.
        stop: Request to stop the process; None leaves the signal handlers unchanged.
        is_service: True if the command looks for the request to stop; any other command is interrupted.
    """
    with StopRequest() if stop is None else contextlib.nullcontext(stop) as request:
        return until_reader_disconnects(lambda: _reported(name, command, request, is_service))


def _reported(name: str, command: Callable[[StopRequest], int], stop: StopRequest, is_service: bool) -> int:
    try:
        if not is_service:
            stop.interrupt()
        return command(stop)
    except InputError as error:
        place = declared_at(error) if isinstance(error, DeclarationError) else ""
        sys.stderr.write(f"{place}: {error}\n" if place else f"{error}\n")
        return USAGE_ERROR
    except ModuleNotFoundError as error:
        hint = install_hint(error)
        if hint is None:
            raise
        sys.stderr.write(f"{name}: {hint}\n")
        return USAGE_ERROR
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        stop.collect()  # the command has ended, and its exit code is known


def version() -> str:
    """Return the version of the installed package."""
    return importlib.metadata.version(DISTRIBUTION)


def until_reader_disconnects(command: Callable[[], int]) -> int:
    """Run a command; a closed pipe on standard output, as after ``| head``, is not an error.

    Output that cannot be written for another reason, such as a full disk, is reported in one line.

    Args:
        command: Function that prints the output and returns the exit code.

    Returns:
        The exit code of the command, or `BROKEN_PIPE` or `UNWRITTEN`.
    """
    try:
        code = command()
    except BrokenPipeError:
        _discard_output()
        return BROKEN_PIPE
    finally:
        failure = _flush_output()
    return code or failure


def _flush_output() -> int:
    """Write the buffered output; return the exit code of a failure, which is one line unless the reader is gone."""
    if sys.stdout is None:  # closed by the parent process
        return 0
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _discard_output()
        return BROKEN_PIPE
    except OSError as error:
        _discard_output()
        sys.stderr.write(f"standard output: {error.strerror}; the end of the output is missing\n")
        return UNWRITTEN
    return 0


def _discard_output() -> None:
    """Redirect standard output to the null device; otherwise Python reports the unwritten data at exit."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
