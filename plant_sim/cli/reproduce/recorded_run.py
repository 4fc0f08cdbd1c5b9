"""Run that a ``provenance.json`` describes: checked completely before anything is executed."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from controller.common.command_line import CommandLine, Parser
from controller.common.document.parts import is_stem
from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.cli.reproduce.origin import FILES, OUTPUTS, WITHOUT_EFFECT
from plant_sim.common.provenance.content import code_hash, content_hash, package_version
from plant_sim.common.provenance.result_files import GIVEN, PROVENANCE_FILE

REPRODUCED: Final = ("faults", "hil", "line", "plot", "run", "scenario", "stories", "study", "trial")
"""Commands that are executed; each writes nothing outside the folder of its option ``--out``."""
_MOST_BYTES: Final = 10_000_000
_UNTIMED: Final = {"run": ("fast", True), "hil": ("way", "program")}
"""Setting without which the result of a command depends on the clock or on another program."""


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """Run that gave a result.

    Attributes:
        folder: Folder of the result.
        command: Command.
        arguments: Arguments of the command, without those for the output.
        record: Name of the recording in the folder; empty without one.
        files: Checksums of the files of the result by name.
        environment: Python, processor and libraries.
    """

    folder: Path
    command: str
    arguments: tuple[str, ...]
    record: str
    files: Mapping[str, str]
    environment: Mapping[str, str]

    def arguments_to(self, out: Path) -> list[str]:
        """Return the command and its arguments with which the result is written to another folder."""
        record = [f"--record={out / self.record}"] if self.record else []
        return [self.command, *self.arguments, f"--out={out}", *record]


def read_run(folder: Path, commands: CommandLine) -> RecordedRun:
    """Read the provenance of a result.

    Args:
        folder: Folder of the result.
        commands: Commands of the package, whose parser reads the settings.

    Raises:
        InputError: The file is unreadable or damaged, is of another version, or asks for what is not permitted.
    """
    path = folder / PROVENANCE_FILE
    return _Reader(path, _object(path)).run(commands)


class _Reader:
    """Reader of one provenance."""

    def __init__(self, path: Path, record: Mapping[str, Any]) -> None:
        self._path = path
        self._record = record

    def run(self, commands: CommandLine) -> RecordedRun:
        """Return the run."""
        command = self._text("command")
        if command not in REPRODUCED:
            raise self._refusal("command", f"{command!r} is not reproduced; {suggestion(command, REPRODUCED, '')}")
        self._check_version()
        if self._record.get("interrupted") is not False:
            raise self._refusal("interrupted", "a signal ended the run, at a moment that is not known; run it again")
        settings = self._mapping("settings")
        if command in _UNTIMED:
            name, value = _UNTIMED[command]
            if settings.get(name) != value:
                raise self._refusal("settings", f"{name} is not {value!r}: the result depends on the clock or a device")
        given = dict(self._given())
        files = {self._plain(name, "files"): str(digest) for name, digest in self._mapping("files").items()}
        parser = commands.parser({command}).subcommands[command]
        way = [str(settings["way"])] if parser.subcommands else []
        for word in way:
            parser = parser.subcommands[word]
        arguments = (*way, *self._arguments(parser, settings, given))
        has_record = any(action.dest == "record" for action in parser.arguments)
        record = next((name for name in files if name.endswith(".parquet")), "") if has_record else ""
        environment = {name: str(value) for name, value in self._mapping("environment").items()}
        if not "".join((*environment, *environment.values())).isprintable():
            raise self._refusal("environment", "contains control characters; copy the file from the original result")
        return RecordedRun(self._path.parent, command, arguments, record, files, environment)

    def _check_version(self) -> None:
        """Refuse another version of the package, and other parameters than those that are delivered with it."""
        theirs, code = self._text("version"), self._text("code")
        if theirs != package_version():
            raise self._refusal(
                "version", f"is {theirs!r}, but version {package_version()} is installed; install that version"
            )
        if code != code_hash():
            raise self._refusal(
                "code", f"is {code!r}, but the code installed here is {code_hash()}; install the code of the result"
            )
        parameters, given = self._mapping("parameters"), self._mapping("given")
        for name, default in FILES.items():
            if name in parameters and name not in given and default is not None:
                self._check_content(name, default, parameters)

    def _given(self) -> Iterator[tuple[str, Path]]:
        """Yield the copies of the files that the user gave, by option."""
        parameters = self._mapping("parameters")
        for option, name in self._mapping("given").items():
            if option not in FILES or PurePosixPath(self._plain(name, "given")).parts[:2] != (GIVEN, option):
                raise self._refusal("given", f"{option} {name!r} is not a file of the folder {GIVEN}/{option}")
            path = self._path.parent / name
            self._check_content(option, path, parameters)
            yield option, path

    def _check_content(self, option: str, path: Path, parameters: Mapping[str, Any]) -> None:
        try:
            found = content_hash(path.read_bytes())
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); copy it from the original result") from None
        if found != parameters.get(option):
            remedy = "use the I/O map of the result" if path == DEFAULT_IO_MAP else "copy it from the original result"
            raise InputError(f"{path}: is not the file of the result, whose checksum differs; {remedy}")

    def _arguments(self, parser: Parser, settings: Mapping[str, Any], given: Mapping[str, Path]) -> list[str]:
        """Return the arguments for the settings and the files, each in a form that cannot become another option."""
        for name in FILES.keys() & settings.keys():
            if not is_stem(str(settings[name])):
                raise self._refusal("settings", f"{name} {settings[name]!r} must be the name of a file of the package")
        left = {name: value for name, value in settings.items() if name not in parser.fixed}
        left.update(given)
        words: list[str] = []
        options: list[str] = []
        for action in parser.arguments:
            if action.dest not in left or action.dest in OUTPUTS or action.dest in WITHOUT_EFFECT:
                continue
            value = left.pop(action.dest)
            if action.option_strings:
                options += self._option(action, value)
            else:
                words.append(self._word(action.dest, value))
        if left:
            raise self._refusal("settings", f"{min(left)!r} is not a setting of this command; omit it")
        return [*words, *options]

    def _option(self, action: argparse.Action, value: object) -> Iterator[str]:
        flag = action.option_strings[-1]
        if action.nargs == 0:
            if value is not True:
                raise self._refusal("settings", f"{action.dest} must be true")
            yield flag
        elif action.nargs == "+" and isinstance(value, list):
            yield from (flag, *(self._word(action.dest, each) for each in value))
        elif isinstance(value, list):
            yield from (f"{flag}={self._text_of(action.dest, each)}" for each in value)
        else:
            yield f"{flag}={self._text_of(action.dest, value)}"

    def _word(self, name: str, value: object) -> str:
        text = self._text_of(name, value)
        if text.startswith("-"):
            raise self._refusal("settings", f"{name} {text!r} begins like an option; omit it")
        return text

    def _text_of(self, name: str, value: object) -> str:
        if isinstance(value, bool) or not isinstance(value, str | int | float | Path):
            raise self._refusal("settings", f"{name} {value!r} must be a number or a text")
        return str(value)

    def _plain(self, name: object, key: str) -> str:
        """Return a name of a file below the folder."""
        parts = PurePosixPath(str(name)).parts
        if (
            not isinstance(name, str)
            or not parts
            or name.startswith("/")
            or ".." in parts
            or "\\" in name
            or not name.isprintable()
        ):
            raise self._refusal(key, f"{name!r} is not a name of a file in this folder; omit it")
        return name

    def _text(self, key: str) -> str:
        value = self._record.get(key)
        if not isinstance(value, str):
            raise self._refusal(key, "is missing or not a text; copy the file from the original result")
        return value

    def _mapping(self, key: str) -> Mapping[str, Any]:
        value = self._record.get(key)
        if not isinstance(value, dict):
            raise self._refusal(key, "is missing or not an object; copy the file from the original result")
        return value

    def _refusal(self, key: str, problem: str) -> InputError:
        return InputError(f"{self._path}: {key}: {problem}")


def _object(path: Path) -> Mapping[str, Any]:
    try:
        content = path.read_bytes()
        if len(content) > _MOST_BYTES:
            raise ValueError("it is too long")
        record = json.loads(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); use the folder of a result") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not the provenance of a result ({error}); use the folder of a result") from None
    if not isinstance(record, dict):
        raise InputError(f"{path}: is not the provenance of a result; use the folder of a result")
    return record
