"""YAML reader: line numbers, validation by models, and sections read value by value."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import Field

from controller.common.errors import InputError
from controller.common.yaml_lines import LocatedMapping, read_yaml, unfold
from controller.common.yaml_model import StrictModel, validated
from controller.common.yaml_section import one_of, read_section, whole


class Item(StrictModel):
    size: int | float = Field(description="write the size in mm")
    colour: str = "red"


class Config(StrictModel):
    items: list[Item]
    count: int = Field(1, ge=1, description="write 1 or more")
    switch: bool = False


def located(tmp_path: Path, text: str, depth: int = 4) -> LocatedMapping:
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8")
    return unfold(read_yaml(path, InputError), depth)


def test_valid_values(tmp_path: Path) -> None:
    config = validated(Config, located(tmp_path, "items:\n- {size: 3}\n- colour: blue\n  size: 4\ncount: 2\n"))
    assert config == Config(items=[Item(size=3), Item(size=4, colour="blue")], count=2)


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("items: []\ncount: 0", ["2: count: cannot be 0; write 1 or more"]),
        ("items: []\nswitch: on", ["2: switch: cannot be 'on'; write true or false"]),
        ("items: 5", ["1: items: cannot be 5; write a list"]),
        ("items:\n- 5", ["2: items[1]: cannot be 5; write a mapping: a key, a colon and a value per line"]),
        ("items:\n- size: x", ["2: items[1].size: cannot be 'x'; write the size in mm"]),  # one fault for both types
        ("items:\n- colour: x", ["2: items[1].size: is missing; write the size in mm"]),
        ("items:\n- colour: x\n  sice: 1", ["3: items[1].sice: unknown key; did you mean size?"]),
        (
            "items:\n- colour: x\n  weight: 1",
            [
                "3: items[1].weight: unknown key; use one of size, colour",
                "2: items[1].size: is missing; write the size in mm",
            ],
        ),
        ("items:\n- size: 1\n  size: 2", ["3: items[1]: key 'size' is already defined on line 2; delete one"]),
        ("items: &a\n- *a", ["1: items[1]: cannot be a list; write a mapping: a key, a colon and a value per line"]),
        ('items: []\n"a\\nb": 1', ["2: 'a\\nb': unknown key; use one of items, count, switch"]),
    ],
)
def test_invalid_values_have_line_path_and_remedy(tmp_path: Path, text: str, faults: list[str]) -> None:
    mapping = located(tmp_path, text)
    validated(Config, mapping)
    assert [str(fault) for fault in mapping.faults] == faults


def test_sections_raise_the_type_of_error_of_their_file(tmp_path: Path) -> None:
    class FileError(InputError):
        pass

    path = tmp_path / "a.yaml"
    path.write_text("run:\n  count: 3\n  kind: fast\n", encoding="utf-8")
    section = read_section(path, ("run",), FileError).section("run", ("count", "kind"))
    assert section is not None
    assert section.read("count", whole(1, 3)) == 3
    assert section.read("kind", one_of("kind", ("fast", "slow"))) == "fast"
    with pytest.raises(FileError) as error:
        section.read("count", whole(1, 2))
    assert str(error.value) == f"{path}:2: run.count: must be an integer, 1 to 2, not '3'"
    for unreadable in (tmp_path, tmp_path / "none.yaml"):
        with pytest.raises(FileError, match="cannot be read"):
            read_section(unreadable, (), FileError)
