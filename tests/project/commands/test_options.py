"""Options of every command of both packages, tested as their parsers and help texts state them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.common.arguments.number_type import NumberType
from controller.common.command_line import CommandLine, run_command
from controller.common.stop_request import StopRequest
from plant_sim.cli.main import COMMAND_LINE as PLANT
from plant_sim.cli.options.study import STUDIES
from plant_sim.cli.settings import machine_of
from plant_sim.cli.study.command import _STUDIES

LINES = {line.package: line for line in (CONTROLLER, PLANT)}


def refused(line: CommandLine, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Return the one line with which a command line refuses arguments."""
    try:
        code: object = line.run(arguments)
    except SystemExit as ended:
        code = ended.code
    printed = capsys.readouterr()
    assert (code, printed.out) == (2, "")
    assert printed.err.endswith("\n")
    assert printed.err.count("\n") == 1
    return printed.err.rstrip("\n")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("plant_sim trail", "python -m plant_sim: unknown command trail; did you mean trial?"),
        ("plant_sim xyzzy --port 0", "python -m plant_sim: unknown command xyzzy; see --help"),
        ("controller rnu", "python -m controller: unknown command rnu; did you mean run?"),
        ("plant_sim trial --tray 0", "python -m plant_sim trial: unknown option --tray; did you mean --trays?"),
        ("plant_sim trial --see=2", "python -m plant_sim trial: unknown option --see; did you mean --seed?"),
        (
            "plant_sim --gap-limit 5",
            "python -m plant_sim serve: unknown option --gap-limit; did you mean --gap-limit-ms?",
        ),
        ("controller run -x", "python -m controller run: unknown option -x; see --help"),
        (
            "controller ladder check x.il --cp=fx3u",
            "python -m controller ladder check: unknown option --cp; did you mean",
        ),
    ],
)
def test_an_unknown_word_names_the_one_that_was_meant(
    command: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """No option can be abbreviated, and no unknown command is taken for an option of the default command."""
    package, *arguments = command.split()
    assert refused(LINES[package], arguments, capsys).startswith(message)


@pytest.mark.parametrize("command", ["run", "trial", "serve", "connect fx3u", "hil program --out x"])
def test_the_planting_frequency_replaces_that_of_the_machine(command: str) -> None:
    arguments = [*command.split(), "--planting-frequency", "60"]
    options = PLANT.parser({arguments[0]}).parse_args(arguments)
    assert machine_of(options).cups.planting_frequency_per_min == 60


# every option of every command


@dataclass(frozen=True)
class Leaf:
    """Command or subcommand that runs.

    Attributes:
        name: Words of the command.
        parser: Its parser.
        whole: Parser of the package.
        least: Shortest valid arguments, without the words of the command.
    """

    name: tuple[str, ...]
    parser: argparse.ArgumentParser
    whole: argparse.ArgumentParser
    least: tuple[str, ...]

    def parse(self, *arguments: str) -> argparse.Namespace:
        """Return the options of the shortest valid arguments and of further ones."""
        return self.whole.parse_args([*self.name, *self.least, *arguments])

    def refusal(self, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
        """Return the line with which arguments are refused."""

        def parse(_: StopRequest) -> int:
            self.parse(*arguments)
            return 0

        with StopRequest() as stop:
            try:
                code: object = run_command(self.name[0], parse, stop)
            except SystemExit as ended:
                code = ended.code
        printed = capsys.readouterr()
        assert code == 2, f"{' '.join(self.name)}: {arguments} accepted"
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        return printed.err

    def actions(self) -> list[argparse.Action]:
        return [action for action in self.parser._actions if not isinstance(action, argparse._HelpAction)]


def leaves(parser: argparse.ArgumentParser, whole: argparse.ArgumentParser, name: tuple[str, ...]) -> Iterator[Leaf]:
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not groups:
        yield Leaf(name, parser, whole, tuple(shortest(parser)))
    for group in groups:
        for word, command in group.choices.items():
            yield from leaves(command, whole, (*name, word))


def shortest(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the shortest valid arguments of a command."""
    for action in parser._actions:
        word = str(next(iter(action.choices))) if action.choices else "fx3u"
        if action.option_strings and action.required:
            yield from (action.option_strings[-1], word)
        elif not action.option_strings and action.nargs != "?":
            yield word


LEAVES = [leaf for line in LINES.values() for parser in [line.parser()] for leaf in leaves(parser, parser, ())]


@pytest.fixture(params=LEAVES, ids=lambda leaf: f"{leaf.parser.prog.split()[2]} {' '.join(leaf.name)}")
def leaf(request: pytest.FixtureRequest) -> Leaf:
    found: Leaf = request.param
    return found


def option(action: argparse.Action) -> str:
    return action.option_strings[-1]


def words(leaf: Leaf) -> str:
    """Return the help text with single spaces."""
    return " ".join(leaf.parser.format_help().split())


def test_all_commands_are_examined() -> None:
    assert {leaf.name[0] for leaf in LEAVES} == {name for line in LINES.values() for name in line.commands}
    assert len(LEAVES) >= 31
    assert sum(isinstance(action.type, NumberType) for leaf in LEAVES for action in leaf.actions()) >= 120


def test_the_help_shows_the_range_and_the_default_that_the_parser_has(leaf: Leaf) -> None:
    text, options = words(leaf), leaf.parse()
    for action in leaf.actions():
        stated = [action.type.range] if isinstance(action.type, NumberType) else []
        default = None if action.required else getattr(options, action.dest, None)
        if default is not None and not isinstance(default, bool | list) and default != "":
            stated.append(f"default: {default}")
        if stated:
            assert f"({'; '.join(stated)})" in text, f"{' '.join(leaf.name)} {action.option_strings}"
        assert action.help, f"{' '.join(leaf.name)} {action.option_strings}: without help"
        assert not re.search(r"\(default[^)]*\).*\(default", action.help)


def range_in_words(text: str) -> tuple[float, float | None, float | None]:
    """Return the ends of a range as the help text states it, and the further value.

    >>> range_in_words("0 to 5000, or 65535"), range_in_words("1 or more")
    ((0.0, 5000.0, 65535.0), (1.0, None, None))
    """
    found = re.fullmatch(r"([\d.]+) (?:or more|to ([\d.]+)(?:, or (\d+))?)", text)
    assert found, text
    least, most, also = found.groups()
    return float(least), None if most is None else float(most), None if also is None else float(also)


def test_a_number_accepts_the_ends_of_its_range_and_refuses_others(
    leaf: Leaf, capsys: pytest.CaptureFixture[str]
) -> None:
    for action in leaf.actions():
        assert action.choices or action.type not in (int, float), f"{option(action)}: state the range of the number"
        type_ = action.type
        if not isinstance(type_, NumberType):
            continue
        step = 1 if type_.kind is int else 0.001
        least, most, also = range_in_words(type_.range)
        for end in (least, most, also):
            if end is not None:
                value = getattr(leaf.parse(f"{option(action)}={end:.12g}"), action.dest)
                assert (value[-1] if isinstance(value, list) else value) == end
        beyond = [least - step, *([] if most is None else [most + step])]
        others = [f"{type_.kind(each):.12g}" for each in beyond] + ["some", "1 2", "", "nan", "1e999"]
        for text in others:
            line = leaf.refusal(capsys, f"{option(action)}={text}")
            assert line.startswith(f"{option(action)} {text}: must be ")
            assert line.endswith(f"{type_.range}\n")
        if action.default is not None and not isinstance(action.default, list):
            assert type_(str(action.default)) == action.default, f"{option(action)}: default out of range"


def test_a_choice_refuses_other_words(leaf: Leaf, capsys: pytest.CaptureFixture[str]) -> None:
    for action in leaf.actions():
        if action.choices is None or not action.option_strings:
            continue
        for choice in action.choices:
            assert getattr(leaf.parse(f"{option(action)}={choice}"), action.dest) in (choice, [choice])
        assert f"argument {option(action)}: invalid " in leaf.refusal(capsys, f"{option(action)}=another")


def test_an_option_without_its_value_is_refused(leaf: Leaf, capsys: pytest.CaptureFixture[str]) -> None:
    for action in leaf.actions():
        if action.option_strings and action.nargs in (None, "+"):
            assert "expected " in leaf.refusal(capsys, option(action))


def test_every_study_has_a_description_and_options() -> None:
    assert list(_STUDIES) == list(STUDIES)
