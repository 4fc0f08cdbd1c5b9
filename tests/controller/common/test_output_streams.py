"""Output streams of real processes on consoles that cannot express every character."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from controller.common.output_streams import REPLACEMENT
from tests.real_time import WAIT_S

CONSOLES = {
    "C": ({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, "ascii"),
    "GBK": ({"PYTHONIOENCODING": "gbk:strict"}, "gbk"),
    "cp1252": ({"PYTHONIOENCODING": "cp1252:strict"}, "cp1252"),
    "UTF-8": ({"PYTHONIOENCODING": "utf-8:strict"}, "utf-8"),
}
"""Environment and encoding of each console."""
TEXT = "阀岛 2² · λ 😀 \udcff"
"""A name in Chinese, signs of the studies, a character beyond U+FFFF, and a byte of a file name that is no text."""
PROGRAM = """
import json, sys
from controller.common.stop_request import run_process

def main(stop):
    print(json.dumps({text!a}, ensure_ascii=False))
    print({text!a}, file=sys.stderr)
    return 0

run_process(main)
"""


@pytest.mark.parametrize("console", CONSOLES)
def test_every_character_reaches_every_console(console: str) -> None:
    """Standard output carries JSON that has the same value on each console; standard error carries a line of text."""
    extra, encoding = CONSOLES[console]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(text=TEXT)],
        check=False,
        capture_output=True,
        env={**os.environ, **extra},
        timeout=WAIT_S,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.decode(encoding)) == TEXT
    assert done.stderr == f"{TEXT}\n".encode(encoding, REPLACEMENT)


def test_the_replacement_of_each_kind_of_character() -> None:
    assert "2² 阀 😀 \udcff".encode("ascii", REPLACEMENT) == rb"2\u00b2 \u9600 \ud83d\ude00 \udcff"
    assert "2² 阀".encode("gbk", REPLACEMENT) == rb"2\u00b2 " + "阀".encode("gbk")
    with pytest.raises(UnicodeDecodeError):
        b"\xff".decode("ascii", REPLACEMENT)


LOST_READER = """
import sys
from controller.common.stop_request import run_process

def main(stop):
    for number in range(3):
        print("message", number, file=sys.stderr, flush=True)
    print("done")
    return 0

run_process(main)
"""


@pytest.mark.parametrize("option", [(), ("-u",)])
def test_standard_error_without_a_reader_does_not_end_the_process(option: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, *option, "-c", LOST_READER],
            check=False,
            stdout=subprocess.PIPE,
            stderr=writer,
            timeout=WAIT_S,
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stdout) == (0, b"done\n")


def test_a_full_disk_under_standard_error_does_not_end_the_process() -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-c", LOST_READER], check=False, stdout=subprocess.PIPE, stderr=full, timeout=WAIT_S
        )
    assert (done.returncode, done.stdout) == (0, b"done\n")


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_a_stream_closed_by_the_parent_process_is_the_null_device(closed: str) -> None:
    program = LOST_READER.replace('print("done")', 'sys.stdout.write("done")')
    done = subprocess.run(
        ["sh", "-c", f'exec "$0" -c "$1" {closed}', sys.executable, program],
        check=False,
        capture_output=True,
        timeout=WAIT_S,
    )
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
