"""Table of all figures, equations and tables of the two papers, with the state of their reproduction.

[P] is the pepper paper, [K] the cabbage paper.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, get_args

import yaml
from pydantic import Field, TypeAdapter, ValidationError

from controller.common.errors import InputError
from controller.common.yaml_model import StrictModel

PAPER_DATA: Final = Path(__file__).with_name("paper_data")

PaperName = Literal["pepper", "cabbage"]
ItemState = Literal["reproduced", "fitted", "illustrated", "compared", "described", "not reproducible"]
ITEM_STATES: Final[Sequence[ItemState]] = get_args(ItemState)


class PaperItem(StrictModel):
    """A figure, an equation, a table or a number in the text of a paper.

    Attributes:
        item: Kind and number, or section and subject.
        subject: Paraphrase of the content.
        state: State of the reproduction.
        commands: Commands that reproduce the item, each with excerpts of its output that support the result. A single
            space in an excerpt matches any white space. The first word is a package, or ``scripts/test`` for a test.
        pages: Pages that discuss the item, relative to ``docs``, with an optional anchor.
        result: Result of the comparison, or the reason why the item cannot be reproduced.
        erratum: Error in the paper; empty if there is none.
    """

    item: str = Field(pattern=r"^(Figure \d+[a-d]?|Equation \d+|Table \d+|Section [\d.]+, .+)$")
    subject: str = Field(min_length=1)
    state: ItemState
    commands: dict[str, list[str]] = Field(default_factory=dict)
    pages: list[str] = Field(default_factory=list)
    result: str = Field(min_length=1)
    erratum: str = ""


_ITEMS: Final = TypeAdapter(list[PaperItem])


@cache
def paper_items(paper: PaperName) -> tuple[PaperItem, ...]:
    """Return the items of a paper in the order of the data file.

    Raises:
        InputError: The data file is invalid.
    """
    return read_paper_items(PAPER_DATA / f"{paper}-items.yaml")


def read_paper_items(path: Path) -> tuple[PaperItem, ...]:
    """Read a data file.

    Raises:
        InputError: The file cannot be read, or an entry is invalid.
    """
    try:
        entries: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
        return tuple(_ITEMS.validate_python(entries))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: cannot be read ({error}); reinstall the package") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: entry {where}: {first['msg']}; correct the entry") from None
