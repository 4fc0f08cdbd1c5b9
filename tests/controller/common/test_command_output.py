"""Standard output that cannot be written."""

import os
import sys
from pathlib import Path

import pytest

from controller.common.command_line import BROKEN_PIPE, UNWRITTEN, until_reader_disconnects

FULL = Path("/dev/full")
"""Device that refuses every write with ENOSPC."""


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full exists on Linux only")
@pytest.mark.parametrize(("code", "expected"), [(0, UNWRITTEN), (1, 1)])
def test_a_full_disk_is_one_line_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], code: int, expected: int
) -> None:
    def command() -> int:
        sys.stdout.write("an event")
        return code

    with FULL.open("w", encoding="utf-8") as output:
        monkeypatch.setattr(sys, "stdout", output)
        assert until_reader_disconnects(command) == expected
    assert capsys.readouterr().err == (f"standard output: {os.strerror(28)}; the end of the output is missing\n")


def test_a_closed_pipe_is_no_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w", encoding="utf-8") as output:
        monkeypatch.setattr(sys, "stdout", output)
        assert until_reader_disconnects(lambda: 0 * sys.stdout.write("an event")) == BROKEN_PIPE
    assert capsys.readouterr().err == ""
