"""Command line with one module per command: parser, version, one-line error messages, exit codes."""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib
import importlib.metadata
import os
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol, cast

from controller.common.arguments.completion import COMPLETION, SHELLS, PrintCompletion
from controller.common.arguments.number_type import NumberType
from controller.common.declarations import DeclarationError, declared_at
from controller.common.errors import InputError
from controller.common.extras import DISTRIBUTION, install_hint
from controller.common.stop_request import INTERRUPTED, StopRequest
from controller.common.suggestion import suggestion

USAGE_ERROR = 2
"""Exit code for invalid input and for a missing optional dependency."""
BROKEN_PIPE = 141
"""Exit code if the reader of the output has disconnected: 128 + SIGPIPE, by shell convention."""
UNWRITTEN = 74
"""Exit code of a successful command whose output could not be written: EX_IOERR of sysexits.h."""
SEE_HELP = "see --help"
"""Remedy for an unknown word that resembles none."""


class OptionsModule(Protocol):
    """Interface of the module with the options of a command."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of the command."""


class CommandModule(Protocol):
    """Interface of the module of a command."""

    def run(self, options: argparse.Namespace) -> int:
        """Run the command and return its exit code.

        Raises:
            InputError: An option or a file is invalid.
        """


class Parser(argparse.ArgumentParser):
    """Parser, also of subcommands, that reports an invalid argument in one line with exit code 2.

    Options cannot be abbreviated: an option of a later version must not change the meaning of a command.
    """

    def __init__(self, **settings: Any) -> None:
        """Create a parser; the settings are those of `argparse.ArgumentParser`."""
        super().__init__(**{"formatter_class": HelpFormatter, "allow_abbrev": False, **settings})

    @property
    def arguments(self) -> tuple[argparse.Action, ...]:
        """Options and positional arguments, in the order in which they were added."""
        return tuple(self._actions)

    @property
    def subcommands(self) -> Mapping[str, Parser]:
        """Parsers of the subcommands by name; empty without any."""
        choices = (action.choices for action in self._actions if action.nargs == argparse.PARSER)
        return cast("Mapping[str, Parser]", next(choices, {}))

    @property
    def fixed(self) -> frozenset[str]:
        """Names of the settings that the parser makes without an argument for them."""
        return frozenset(self._defaults).difference(action.dest for action in self._actions)

    def error(self, message: str) -> NoReturn:
        """Print the message and exit."""
        self.exit(USAGE_ERROR, f"{self.prog}: {message}; see --help\n")

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse the arguments, with a remedy for an unknown option; see `argparse.ArgumentParser.parse_known_args`."""
        options, rest = super().parse_known_args(args, namespace)
        for word in rest:
            if word.startswith("-"):
                known = [name for name in self._option_string_actions if name.startswith("--")]
                option = word.partition("=")[0]
                self.exit(USAGE_ERROR, f"{self.prog}: unknown option {option}; {suggestion(option, known, SEE_HELP)}\n")
        return options, rest

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the value of an argument.

        Raises:
            InputError: The argument is not a number within its range.
        """
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            if not isinstance(action.type, NumberType):
                raise
            name = action.option_strings[-1] if action.option_strings else action.metavar or action.dest
            raise InputError(f"{name} {arg_string}: {error.message}") from None


class HelpFormatter(argparse.HelpFormatter):
    """Help formatter that shows the range of every number and the default of every option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        notes = [action.type.range] if isinstance(action.type, NumberType) else []
        if not any(action.default is each for each in (None, False, argparse.SUPPRESS)) and action.default not in (
            [],
            "",
        ):
            notes.append("default: %(default)s")
        return f"{action.help} ({'; '.join(notes)})" if notes else action.help


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """Command of a package.

    Attributes:
        help: One-line help.
        module: Module with the function that runs the command.
        options: Module with the options, which imports none of the optional dependencies; empty = the same module.
        extra: Installation extra that the command needs; empty = that of the missing module.
    """

    help: str
    module: str
    options: str = ""
    extra: str = ""


@dataclass(frozen=True, slots=True)
class CommandLine:
    """Command line of a package.

    Attributes:
        package: Name of the package, as in ``python -m <package>``.
        script: Name of its console command.
        description: First line of the help text.
        commands: Commands by name.
        default: Command to run if the first argument is an option, or there is none.
        services: Commands that find the request to stop in ``options.stop``, from their first instruction: those that
            run until they are stopped, and those that report what they have done. Any other command is interrupted.
            ``options.command`` is the name.
    """

    package: str
    script: str
    description: str
    commands: Mapping[str, CommandEntry]
    default: str
    services: frozenset[str]

    @property
    def prog(self) -> str:
        """Name under which the program was started."""
        return self.script if Path(sys.argv[0]).stem == self.script else f"python -m {self.package}"

    def parser(self, loaded: Collection[str] | None = None) -> Parser:
        """Return the parser.

        Args:
            loaded: Commands whose options are added; None = all.
        """
        parser = Parser(
            prog=self.prog, description=self.description, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        parser.add_argument(
            "--version", action="version", version=f"{DISTRIBUTION} {version()}", help="show the version and exit"
        )
        parser.add_argument(
            COMPLETION,
            action=PrintCompletion,
            choices=SHELLS,
            const=self.script,
            default=argparse.SUPPRESS,
            help=f"print a script with which a shell completes the arguments of {self.script}, and exit",
        )
        commands = parser.add_subparsers(required=True, metavar="COMMAND")
        for name, command in self.commands.items():
            of_command = commands.add_parser(name, help=command.help)
            if loaded is None or name in loaded:
                module = cast("OptionsModule", importlib.import_module(command.options or command.module))
                module.add_arguments(of_command)
                if name == self.default:
                    parser.epilog = f"Without a command:\n\n{of_command.format_help()}"
        return parser

    def run(self, arguments: Sequence[str] | None = None, stop: StopRequest | None = None) -> int:
        """Run a command and return its exit code.

        Only the modules of that command are imported, so that it does not need the dependencies of the others; that of
        its options first, so that help and refused options need none.

        Args:
            arguments: Command-line arguments; None = those of the process.
            stop: Request to stop the process; None leaves the signal handlers unchanged.
        """
        given = list(sys.argv[1:] if arguments is None else arguments)
        name = given[0].partition("=")[0] if given else self.default
        if name.startswith("-") and name not in {"-h", "--help", "--version", COMPLETION}:
            name = self.default
        if name == self.default and given[:1] != [name]:
            given.insert(0, name)
        return run_command(
            name,
            lambda request: self._run(name, given, request),
            stop,
            is_service=name in self.services,
            extra=self.commands[name].extra if name in self.commands else "",
        )

    def _run(self, name: str, given: Sequence[str], stop: StopRequest) -> int:
        if not name.startswith("-") and name not in self.commands:
            raise InputError(f"{self.prog}: unknown command {name}; {suggestion(name, self.commands, SEE_HELP)}")
        loaded = {"-h": {self.default}, "--help": {self.default}, COMPLETION: None}.get(name, {name})
        options = self.parser(loaded).parse_args(given)
        options.command, options.stop = name, stop
        return cast("CommandModule", importlib.import_module(self.commands[name].module)).run(options)


def run_command(
    name: str,
    command: Callable[[StopRequest], int],
    stop: StopRequest | None = None,
    *,
    is_service: bool = False,
    extra: str = "",
) -> int:
    """Run a command and return its exit code; invalid input and a missing dependency are one line on standard error.

    Args:
        name: Name of the command, which begins the line about a missing optional dependency.
        command: Function that parses the arguments, prints the output and returns the exit code.
        stop: Request to stop the process; None leaves the signal handlers unchanged.
        is_service: True if the command looks for the request to stop; any other command is interrupted.
        extra: Installation extra of the command; empty = that of the missing module.
    """
    with StopRequest() if stop is None else contextlib.nullcontext(stop) as request:
        return until_reader_disconnects(lambda: _reported(name, command, request, is_service, extra))


def _reported(name: str, command: Callable[[StopRequest], int], stop: StopRequest, is_service: bool, extra: str) -> int:
    try:
        if not is_service:
            stop.interrupt()
        return command(stop)
    except InputError as error:
        place = declared_at(error) if isinstance(error, DeclarationError) else ""
        sys.stderr.write(f"{place}: {error}\n" if place else f"{error}\n")
        return USAGE_ERROR
    except ModuleNotFoundError as error:
        hint = install_hint(error, extra)
        if hint is None:
            raise
        sys.stderr.write(f"{name}: {hint}\n")
        return USAGE_ERROR
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:  # which also the first look at a file can raise
            raise
        sys.stderr.write(f"{error.filename}: {error.strerror}; specify a shorter one\n")
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
