"""Mutated programs: each is rejected with well-formed errors, or parsed exactly as written."""

from __future__ import annotations

import csv
import io
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

import pytest

from controller.fx.language.check import check, usage
from controller.fx.language.gx_csv import read_gx_csv, write_gx_csv
from controller.fx.language.il import read_il, write_il
from controller.fx.language.instruction import Ladder, LadderError
from controller.fx.language.reading import load_ladder
from tests.controller.fx.language.fx_samples import SAMPLES

FINDING: Final = re.compile(r"[^\n\r]+?:[1-9][0-9]*:[1-9][0-9]*: [^\n\r]+?: [^\n\r]+; [^\n\r]+")
WORDS: Final = (
    "LD LDI AND OR ANB ORB MPS MRD MPP INV MC MCR STL RET FOR NEXT CJ CALL SRET FEND END NOP P0 P1 P63 I1 N0 N7 N8 "
    "X0 X8 X377 X400 Y17 M0 M3071 M3072 M8255 S20 S999 T0 T255 C199 C200 D0 D7999 D8256 V Z7 Z8 K0 K-1 K32768 "
    "K99999999999 H0 HFFFF H10000 K4M0 K8M3040 K4X370 D0V0 D0Z9 D1.F D1.G E1.5 R0 K LDD= DLD= OR<> DADDP ADDP MOV "
    "DMOV IST PID EI -1 0 7 99999 ; // ' (* *) \" , \t : \0 \ufeff ſ0 X٣ \x85 \u2028"
)
TOKENS: Final = tuple(WORDS.split(" "))
CHARACTERS: Final = "0123456789ABCDXYMSTKHPNVZ;:,.'\"/(*)=<>-+ \t\r\n\x00\x0b\x1a\x85é\u2028\ud7ff"


def put(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(CHARACTERS) + text[at:]


def change(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(CHARACTERS) + text[at + 1 :]


def cut(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + text[at + rng.choice((1, 1, 1, 5, 1000)) :]


def token(text: str, rng: random.Random) -> str:
    """Delete or duplicate a word, or replace it with a token or with another word of the text."""
    words = list(re.finditer(r"[^\s\"]+", text))
    if not words:
        return text
    word = rng.choice(words)
    new = rng.choice((rng.choice(TOKENS), rng.choice(words)[0], "", f"{word[0]} {word[0]}"))
    return text[: word.start()] + new + text[word.end() :]


def line(text: str, rng: random.Random) -> str:
    """Delete, repeat, exchange or join lines."""
    lines = text.split("\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, lines[other])
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case _:
            lines[at : at + 2] = [" ".join(lines[at : at + 2])]
    return "\n".join(lines)


def column(text: str, rng: random.Random) -> str:
    """Delete, insert or exchange columns, in one line or in all lines."""
    separator = "\t" if "\t" in text else " "
    lines = text.split("\n")
    chosen = range(len(lines)) if rng.random() < 0.2 else [rng.randrange(len(lines))]
    at, other, what = rng.randrange(7), rng.randrange(7), rng.randrange(3)
    for n in chosen:
        fields = lines[n].split(separator)
        if what == 0:
            del fields[at : at + 1]
        elif what == 1:
            fields.insert(at, rng.choice(('""', "0", "X0")))
        elif max(at, other) < len(fields):
            fields[at], fields[other] = fields[other], fields[at]
        lines[n] = separator.join(fields)
    return "\n".join(lines)


Text = TypeVar("Text", str, bytes, Path)
MUTATIONS: Final[tuple[Callable[[str, random.Random], str], ...]] = (put, change, cut, token, token, line, column)


def mutated(text: str, rng: random.Random) -> str:
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        text = rng.choice(MUTATIONS)(text, rng)
    return text


def all_fields(ladder: Ladder) -> tuple[object, ...]:
    return ladder.instructions, [i.note for i in ladder.instructions], ladder.titles


def read_or_rejected(read: Callable[[Text], Ladder], text: Text, about: str = "") -> Ladder | None:
    """Return the program, or None if it is rejected; check the format of every error."""
    try:
        return read(text)
    except LadderError as error:
        for finding in str(error).split("\n"):
            assert FINDING.fullmatch(finding), f"{finding!r} about {about or text!r}"
            assert len(finding) < 400
        return None


def round_trips(ladder: Ladder) -> bool:
    by_list, by_csv = read_il(write_il(ladder)), read_gx_csv(write_gx_csv(ladder))
    return all_fields(by_list) == all_fields(ladder) == all_fields(by_csv) and by_list.comments == ladder.comments


def normal(word: str) -> str:
    """Return a word in normalised spelling."""
    upper = re.sub(r"(?<=[A-Z-])0+(?=[0-9A-F])", "", word.upper().rstrip(":"))
    upper = re.sub(r"^D(LD|AND|OR)(?=[=<>])", r"\1D", upper)
    return upper + "0" if re.search(r"[VZ]$", upper) else upper


def words_of_list(text: str) -> list[list[str]]:
    """Return the words of each line, excluding comments and step numbers, without using the tested parser."""
    lines = []
    for one in re.split(r"\r\n|\r|\n", text):
        words = re.split(r";|//|'|\(\*", one, maxsplit=1)[0].replace(",", " ").replace("\t", " ").split(" ")
        words = [word for word in words if word]
        if words and words[0].isdecimal():
            del words[0]
        if words:
            lines.append([normal(word) for word in words])
    return lines


def words_of_ladder(ladder: Ladder) -> list[list[str]]:
    return [[normal(word) for word in str(instruction).split(" ")] for instruction in ladder.instructions]


def words_of_csv(data: bytes) -> list[list[str]]:
    """Return the words of each instruction in a CSV file."""
    text = data.decode("utf-16")
    found: list[list[str]] = []
    for row in list(csv.reader(io.StringIO(text, newline=""), delimiter="\t"))[3:]:
        for column, word in enumerate(row):
            if column == 2 and word.strip():
                found.append([])
            if column in (2, 3) and word.strip():
                found[-1].append(normal(word.strip()))
    return found


COUNTS = pytest.mark.parametrize("count", [300, pytest.param(10_000, marks=pytest.mark.nightly)])


@COUNTS
def test_mutated_list_is_rejected_or_parsed_exactly(count: int, tmp_path: Path) -> None:
    rng = random.Random(count)
    lists = [*SAMPLES, *(write_il(read_il(sample)) for sample in SAMPLES)]
    loaded = 0
    for n in range(count):
        text = mutated(rng.choice(lists), rng)
        ladder = read_or_rejected(read_il, text)
        if n % 10 == 0:
            path = tmp_path / "a.il"
            path.write_bytes(text.encode())
            read_or_rejected(load_ladder, path, text)
        if ladder is not None:
            loaded += 1
            assert words_of_ladder(ladder) == words_of_list(text), text
            assert round_trips(ladder), text
            assert check(ladder) is not None
            assert usage(ladder).steps >= len(ladder.instructions)
    assert count / 10 < loaded < count * 0.9


@COUNTS
def test_mutated_csv_is_rejected_or_parsed_exactly(count: int, tmp_path: Path) -> None:
    rng = random.Random(count)
    files = [write_gx_csv(read_il(sample)) for sample in SAMPLES]
    loaded = 0
    for n in range(count):
        data = rng.choice(files)
        if n % 3:
            data = data[:2] + mutated(data[2:].decode("utf-16-le"), rng).encode("utf-16-le")
        else:
            at = rng.randrange(len(data))
            data = data[:at] + rng.randbytes(rng.randrange(3)) + data[at + rng.randrange(3) :]
        ladder = read_or_rejected(read_gx_csv, data, f"file {n}")
        if n % 10 == 0:
            path = tmp_path / "a.csv"
            path.write_bytes(data)
            read_or_rejected(load_ladder, path, f"file {n}")
        if ladder is not None:
            loaded += 1
            assert words_of_ladder(ladder) == words_of_csv(data), data.decode("utf-16")
            assert round_trips(ladder), data.decode("utf-16")
    assert count / 10 < loaded < count * 0.9
