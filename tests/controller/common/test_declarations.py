"""Tables of declarations: a missing entry is reported with the table, and a faulty declaration with its line."""

from __future__ import annotations

import copy
import pickle
import re

import pytest

from controller.common.declarations import DeclarationError, Declared, declared_at
from controller.core.expr import Bit
from controller.program.states import Mode
from tests.paths import ROOT

TEXTS = Declared("TEXTS", "controller.program.texts.operator", {"start": 1})


def test_a_missing_entry_is_reported_with_the_table_and_its_file() -> None:
    place = re.escape("TEXTS (controller/program/texts/operator.py); add it there")
    with pytest.raises(DeclarationError, match=f"^'stop' is missing in {place}$"):
        TEXTS["stop"]
    assert (TEXTS["start"], TEXTS.get("stop")) == (1, None)


def test_required_keys_are_looked_up() -> None:
    TEXTS.require(["start"])
    with pytest.raises(DeclarationError, match="'halt' is missing in TEXTS"):
        TEXTS.require(["start", "halt"])


@pytest.mark.parametrize(
    ("key", "shown"), [(Bit("M", 403, "command.hold"), "M403 command.hold"), (Mode.STEP, "5 STEP"), (7, "7")]
)
def test_a_device_or_a_number_is_shown_with_its_name(key: object, shown: str) -> None:
    with pytest.raises(DeclarationError, match=f"^{shown} is missing"):
        Declared[object, int]("TABLE", __name__, {})[key]


def test_a_table_can_be_copied() -> None:
    for other in (copy.deepcopy(TEXTS), pickle.loads(pickle.dumps(TEXTS))):  # noqa: S301 - own data
        with pytest.raises(DeclarationError, match=r"operator\.py"):
            other["stop"]


def test_the_place_of_an_error_is_the_line_that_declares() -> None:
    """Functions that check declarations are passed over, in `controller.core` and where a function is marked."""

    def marked() -> Bit:
        __tracebackhide__ = True
        return Bit("M", 99_999)

    with pytest.raises(DeclarationError) as caught:
        marked()
    line = marked.__code__.co_firstlineno + 5
    assert declared_at(caught.value) == f"tests/controller/common/test_declarations.py:{line}"
    assert "marked()" in (ROOT / "tests/controller/common/test_declarations.py").read_text().splitlines()[line - 1]


def test_an_error_that_was_not_raised_has_no_place() -> None:
    assert declared_at(DeclarationError("none")) == ""
