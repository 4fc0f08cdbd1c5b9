"""Ladder diagrams: SVG files of the rungs, page by page, and of the step charts; or single rungs for a screen."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from controller.fx.drawing.rung import CELL, COLUMNS, MARGIN, SPACE, RungDrawing, output_width, rung_height, rung_width
from controller.fx.drawing.step_chart import draw_charts
from controller.fx.drawing.svg import SvgPicture
from controller.fx.language.instruction import Ladder
from controller.fx.language.instruction_set import step_numbers
from controller.fx.language.rung_shapes import Rung, rungs_of

LONGEST_PAGE: Final = 2400
"""Page height above which a block continues in another file, px."""
LONGEST_NAME: Final = 60
"""Maximum number of characters of a title in a file name."""


def draw(ladder: Ladder) -> dict[str, str]:
    """Return the pictures of a program.

    Args:
        ladder: Checked program.

    Returns:
        Text of each SVG file by file name: the rungs, block by block, then one chart for
            each group of connected steps.
    """
    files: dict[str, str] = {}
    numbers = step_numbers(ladder.instructions)
    for number, (title, rungs) in enumerate(_blocks(ladder), 1):
        slug = re.sub(r"[^a-z0-9]+", "_", title.lower())[:LONGEST_NAME].strip("_") or "program"
        for part, page in enumerate(_pages(ladder, rungs), 1):
            name = f"{number:02}_{slug}{f'_{part}' if part > 1 else ''}.svg"
            files[name] = _page(ladder, title if part == 1 else f"{title} ({part})", page, numbers)
    return files | draw_charts(ladder)


def _blocks(ladder: Ladder) -> Iterator[tuple[str, list[Rung]]]:
    """Yield the blocks with their titles; titles of steps within a chart do not begin a block."""
    title, rungs, in_steps = ladder.source, list[Rung](), False
    for rung in rungs_of(ladder):
        name = ladder.instructions[rung.first].name
        if rung.first in ladder.titles and not (in_steps and name == "STL"):
            if rungs:
                yield title, rungs
            title, rungs = ladder.titles[rung.first], []
        in_steps = name == "STL" or (in_steps and name != "RET")
        rungs.append(rung)
    if rungs:
        yield title, rungs


def _pages(ladder: Ladder, rungs: list[Rung]) -> Iterator[list[Rung]]:
    page: list[Rung] = []
    height = 0
    for rung in rungs:
        needed = rung_height(ladder, rung) + SPACE
        if page and height + needed > LONGEST_PAGE:
            yield page
            page, height = [], 0
        page.append(rung)
        height += needed
    yield page


def _page(ladder: Ladder, title: str, rungs: list[Rung], numbers: Sequence[int]) -> str:
    """Return a page of a ladder diagram as SVG text."""
    picture = SvgPicture()
    drawing = RungDrawing(ladder, picture, right_rail(ladder, rungs), numbers)
    picture.text(MARGIN, MARGIN, title, "title")
    top = y = MARGIN + 18
    for rung in rungs:
        drawing.draw(rung, y)
        y += rung_height(ladder, rung) + SPACE
    picture.line(drawing.left, top, drawing.left, y)
    picture.line(drawing.right, top, drawing.right, y)
    return picture.svg(drawing.right + MARGIN, y + MARGIN, title)


def right_rail(ladder: Ladder, rungs: list[Rung]) -> int:
    """Return the x-coordinate of the right rail for some rungs, px."""
    columns = max(map(rung_width, rungs))
    outputs = (ladder.instructions[at] for rung in rungs if rung.leg for at in rung.leg.outputs())
    widest = max(map(output_width, outputs), default=CELL)
    return max(MARGIN + CELL * (columns + 1) + widest, MARGIN + CELL * 4)


class RungPictures:
    """Pictures of single rungs for a screen that draws only the visible ones.

    Attributes:
        rungs: Rungs of the program, in order.
    """

    def __init__(
        self, ladder: Ladder, texts: Mapping[str, Sequence[str]] | None = None, *, columns: int = COLUMNS
    ) -> None:
        """Prepare the pictures of a program.

        Args:
            ladder: The program.
            texts: Further texts of devices by FX name, shown with the pointer on a symbol.
            columns: Number of contacts before the right rail; only a rung that is wider has its rail farther right.
        """
        self.rungs = rungs_of(ladder)
        self._ladder = ladder
        self._texts = texts
        self._numbers = step_numbers(ladder.instructions)
        self._right = MARGIN + CELL * (columns + 1)

    def height(self, number: int) -> int:
        """Return the height of a rung, px."""
        return rung_height(self._ladder, self.rungs[number]) + SPACE

    def width(self, number: int) -> int:
        """Return the width of a rung, px."""
        return self._rail(number) + MARGIN

    def fragment(self, number: int) -> str:
        """Return a rung between its rails as SVG elements for a picture of another page, with the top at 0."""
        return self._drawn(number).fragment()

    def svg(self, number: int, style: str = "") -> str:
        """Return a rung as the text of an SVG file; `style` is added to its style sheet."""
        title = f"rung {number}, step {self._numbers[self.rungs[number].first]}"
        return self._drawn(number).svg(self.width(number), self.height(number), title, style)

    def _rail(self, number: int) -> int:
        return max(self._right, right_rail(self._ladder, [self.rungs[number]]))

    def _drawn(self, number: int) -> SvgPicture:
        picture = SvgPicture()
        drawing = RungDrawing(self._ladder, picture, self._rail(number), self._numbers, self._texts)
        drawing.draw(self.rungs[number], 0)
        for rail in (drawing.left, drawing.right):
            picture.line(rail, 0, rail, self.height(number))
        return picture
