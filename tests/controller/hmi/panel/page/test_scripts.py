"""Scripts and texts of the page: every text exists in both languages, and nothing comes from elsewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from controller.hmi.panel.view import texts
from controller.hmi.panel.web import app
from controller.hmi.web import files

STATIC = app.STATIC
SHARED = Path(files.__file__).parent / "static"
SCRIPTS = {
    path.relative_to(STATIC).as_posix(): path.read_text(encoding="utf-8")
    for path in STATIC.rglob("*.js")
    if STATIC / "foreign" not in path.parents
}


def test_every_text_key_of_the_scripts_exists() -> None:
    used = {
        key
        for script in SCRIPTS.values()
        for key in re.findall(r"\b(?:t|label|section|group|button|note|labelled)\(\"([a-z_.0-9]+)\"", script)
    }
    assert len(used) > 100
    assert sorted(used - texts.TEXTS.keys()) == []


def test_every_part_of_the_program_has_a_name(part_keys: list[str]) -> None:
    assert sorted(set(part_keys) - texts.TEXTS.keys()) == []


@pytest.fixture
def part_keys() -> list[str]:
    from controller.program.machine import build
    from controller.program.tags import SIDES
    from tests.controller.common.modbus_rig import IO_MAP

    machine = build(IO_MAP)
    tags = machine.tags
    bare = [
        point.tag.partition(".")[2] if point.tag.partition(".")[0] in SIDES else point.tag
        for point in (*IO_MAP.inputs, *IO_MAP.outputs, *IO_MAP.unwired)
    ]
    steps = [step for sequence in machine.program.sequences() for _, step in sequence]
    return [
        *(f"command.{command.name}" for command in tags.commands if command.group != "jog"),
        *(f"set.{name}" for name in tags.sp.names()),
        *(f"point.{name}" for name in bare),
        *(f"sequence.{sequence.name}" for sequence in machine.program.sequences()),
        *(f"step.{step.title}" for step in steps),
        *(f"waits.{step.waits_for}" for step in steps if step.waits_for),
        *(f"jog.{output.rpartition('.')[2]}" for output in tags.commands.jog),
    ]


def test_every_text_has_both_languages_and_the_same_placeholders() -> None:
    def placeholders(text: str) -> list[str]:
        return sorted(re.findall(r"\{\w+\}", text))

    assert [key for key, text in texts.TEXTS.items() if not text.en or not text.zh] == []
    assert [key for key, text in texts.TEXTS.items() if placeholders(text.en) != placeholders(text.zh)] == []


def test_page_loads_nothing_from_other_hosts() -> None:
    for path in (path for folder in (STATIC, SHARED) for path in folder.iterdir() if path.is_file()):
        text = path.read_text(encoding="utf-8")
        external = [url for url in re.findall(r"(?:https?:)?//[\w.]+\.\w+[^\s\"']*", text) if "www.w3.org" not in url]
        assert external == [], path.name
        assert not re.search(r"\bstyle=|\bon\w+=\"|<script>|innerHTML|\beval\(", text), path.name
