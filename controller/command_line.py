"""What every command does alike: a wrong argument is one line, and a reader who goes is no error."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from typing import NoReturn

NOBODY_READS = 141
"""Exit code when nobody reads the output any more: 128 and SIGPIPE, as a shell gives for any program."""


class Parser(argparse.ArgumentParser):
    """A parser that tells a wrong argument in one line, its subcommands too, and ends with exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Tell what is wrong, and end."""
        self.exit(2, f"{self.prog}: {message}; see --help\n")


def while_read(command: Callable[[], int]) -> int:
    """Run a command until whoever reads its output has had enough, as ``head`` at the other end of a pipe.

    Standard output is then put on the null device, or what it still holds would be an error when Python ends.

    Args:
        command: Prints, and returns its exit code.

    Returns:
        Its exit code, or `NOBODY_READS`.
    """
    try:
        try:
            return command()
        finally:
            if sys.stdout is not None:  # closed by whoever started us
                sys.stdout.flush()
    except BrokenPipeError:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
        return NOBODY_READS
