"""Completion of arguments by a shell, with shtab."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

COMPLETION: Final = "--print-completion"
"""Option that prints the script of a shell."""
SHELLS: Final = ("bash", "zsh")


class PrintCompletion(argparse.Action):
    """Action that prints the script of a shell for a parser, with its subcommands, and exits.

    Its constant is the name of the console command.
    """

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,  # noqa: ARG002 - the signature of the base class
        values: str | Sequence[Any] | None,
        option_string: str | None = None,  # noqa: ARG002
    ) -> None:
        """Print the script; the optional shtab is imported here only."""
        shtab = importlib.import_module("shtab")
        for action in _actions(parser):
            if action.type is Path:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
        parser.prog = self.const
        sys.stdout.write(shtab.complete(parser, shell=values) + "\n")
        parser.exit()


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the actions of a parser and of all its subcommands."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no public list of them
        yield action
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for command in action.choices.values():
                yield from _actions(command)
