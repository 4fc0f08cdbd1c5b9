"""Ladder diagrams: SVG files of the rungs, page by page, and of the step charts.

Every symbol is in a group of class "symbol" whose `data-at` is the index of its instruction. Instructions without a
symbol (ANB, ORB, MPS, MRD, MPP) are listed in the `data-joins` attribute of the rung's group.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from controller.fx.drawing.step_chart import draw_charts
from controller.fx.drawing.svg import CHARACTER_WIDTH, SvgPicture
from controller.fx.language.instruction import DeviceOperand, Digits, Instruction, Ladder
from controller.fx.language.rung_shapes import Contact, Leg, Parallel, Rung, Series, Shape, rungs_of, series

CELL: Final = 136
"""Width of a contact with its texts, px."""
ROW: Final = 62
"""Height of a contact with its texts, px."""
WIRE: Final = 22
"""Distance of the wire from the top of its row, px."""
MARGIN: Final = 24
BAND: Final = 22
COLUMNS: Final = 9
"""Maximum number of contacts in a row; longer rungs continue in the next row."""
LONGEST_PAGE: Final = 2400
"""Page height above which a block continues in another file, px."""
LONGEST_NAME: Final = 60
"""Maximum number of characters of a title in a file name."""
COMMENT_LINES: Final = 2
_CHARACTERS: Final = int((CELL - 10) / CHARACTER_WIDTH)
_SPACE: Final = 10


def draw(ladder: Ladder) -> dict[str, str]:
    """Return the pictures of a program.

    Args:
        ladder: Checked program.

    Returns:
        Text of each SVG file by file name: the rungs, block by block, then one chart for
            each group of connected steps.
    """
    files: dict[str, str] = {}
    for number, (title, rungs) in enumerate(_blocks(ladder), 1):
        slug = re.sub(r"[^a-z0-9]+", "_", title.lower())[:LONGEST_NAME].strip("_") or "program"
        for part, page in enumerate(_pages(ladder, rungs), 1):
            name = f"{number:02}_{slug}{f'_{part}' if part > 1 else ''}.svg"
            files[name] = _Page(ladder, title if part == 1 else f"{title} ({part})", page).svg()
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
        rung_height = _height(ladder, rung) + _SPACE
        if page and height + rung_height > LONGEST_PAGE:
            yield page
            page, height = [], 0
        page.append(rung)
        height += rung_height
    yield page


def size(shape: Shape | None) -> tuple[int, int]:
    """Return the number of columns and rows that contacts occupy.

    Examples:
        >>> size(Series((Contact(0), Parallel((Contact(1), Contact(2))))))
        (2, 2)
    """
    if shape is None:
        return 0, 1
    if isinstance(shape, Contact):
        return 1, 1
    columns, rows = zip(*map(size, shape.parts), strict=True)
    return (sum(columns), max(rows)) if isinstance(shape, Series) else (max(columns), sum(rows))


def _leg_size(leg: Leg) -> tuple[int, int]:
    columns, rows = size(leg.head)
    items = [_leg_size(item) if isinstance(item, Leg) else (0, 1) for item in leg.items]
    return columns + max((c for c, _ in items), default=0), max(rows, sum(r for _, r in items))


def _folded(leg: Leg) -> tuple[list[Shape], Leg]:
    """Split a leg that is too long for one row, and return the full rows of contacts and the remaining leg."""
    tail, _ = _leg_size(Leg(None, leg.items))
    if not isinstance(leg.head, Series) or size(leg.head)[0] + tail <= COLUMNS:
        return [], leg
    rows: list[list[Shape]] = [[]]
    for part in leg.head.parts:
        if rows[-1] and sum(size(p)[0] for p in rows[-1]) + size(part)[0] > COLUMNS:
            rows.append([])
        rows[-1].append(part)
    if sum(size(p)[0] for p in rows[-1]) + tail > COLUMNS:
        rows.append([])
    *before, last = (series(row) for row in rows)
    return [row for row in before if row is not None], Leg(last, leg.items)


def _height(ladder: Ladder, rung: Rung) -> int:
    if rung.leg is None:
        return BAND if ladder.instructions[rung.first].name == "STL" else ROW
    before, leg = _folded(rung.leg)
    return ROW * (sum(size(row)[1] for row in before) + _leg_size(leg)[1])


def _width(rung: Rung) -> int:
    if rung.leg is None:
        return 0
    before, leg = _folded(rung.leg)
    return max(_leg_size(leg)[0], *(size(row)[0] for row in before), 0)


@dataclass
class _Page:
    """Page of a ladder diagram.

    Attributes:
        left: x-coordinate of the left rail, px.
        right: x-coordinate of the right rail, px.
    """

    ladder: Ladder
    title: str
    rungs: list[Rung]
    left: int = MARGIN
    right: int = field(init=False)

    def __post_init__(self) -> None:
        columns = max(map(_width, self.rungs))
        outputs = (self.ladder.instructions[at] for rung in self.rungs for at in _outputs(rung.leg))
        widest = max(map(_output_width, outputs), default=CELL)
        self.right = max(self.left + CELL * (columns + 1) + widest, self.left + CELL * 4)
        self._picture = SvgPicture()

    def svg(self) -> str:
        """Return the page as SVG text."""
        picture = self._picture
        picture.text(self.left, MARGIN, self.title, "title")
        top = y = MARGIN + 18
        for rung in self.rungs:
            joins = " ".join(map(str, rung.joins))
            with picture.group("rung", **{"data-joins": joins}):
                if rung.leg is None:
                    self._on_bus(rung.first, y)
                else:
                    self._rung(rung.leg, y)
            y += _height(self.ladder, rung) + _SPACE
        picture.line(self.left, top, self.left, y)
        picture.line(self.right, top, self.right, y)
        return picture.svg(self.right + MARGIN, y + MARGIN, self.title)

    def _on_bus(self, at: int, y: int) -> None:
        instruction = self.ladder.instructions[at]
        with self._picture.group("symbol", **{"data-at": str(at)}):
            if instruction.name == "STL":
                title, comment = self.ladder.titles.get(at, ""), self._comment(instruction)
                titles = (comment,) if title in comment else (title, comment)
                text = " - ".join(filter(None, (str(instruction), *titles)))
                self._picture.box(self.left, y, self.right - self.left, BAND, "band")
                self._picture.text(self.left + 8, y + 15, text, "title")
            else:
                self._box(instruction, y + WIRE, self.left)

    def _rung(self, leg: Leg, y: int) -> None:
        before, last = _folded(leg)
        for number, row in enumerate(before, 1):
            columns, rows = size(row)
            end = self.left + CELL * columns
            self._shape(row, self.left, y, end)
            self._picture.path([(end, y + WIRE), (end + 16, y + WIRE)], arrow=True)
            self._picture.text(end + 20, y + WIRE + 4, f"({number})", "note")
            y += ROW * rows
            self._picture.text(2, y + WIRE + 4, f"({number})", "note")
        self._leg(last, self.left, y)

    def _leg(self, leg: Leg, x: int, y: int) -> None:
        columns, _ = size(leg.head)
        fork = x + CELL * columns
        if leg.head is not None:
            self._shape(leg.head, x, y, fork)
        below = last = y
        for item in leg.items:
            last = below
            if isinstance(item, Leg):
                self._leg(item, fork, below)
                below += ROW * _leg_size(item)[1]
            else:
                with self._picture.group("symbol", **{"data-at": str(item)}):
                    self._output(self.ladder.instructions[item], fork, below + WIRE)
                below += ROW
        if last != y:
            self._picture.dot(fork, y + WIRE)
            self._picture.line(fork, y + WIRE, fork, last + WIRE)

    def _shape(self, shape: Shape, x: int, y: int, end: int) -> None:
        """Draw contacts from `x`, and extend their wire to `end`."""
        width_end = x + CELL * size(shape)[0]
        if isinstance(shape, Contact):
            with self._picture.group("symbol", **{"data-at": str(shape.at)}):
                self._contact(self.ladder.instructions[shape.at], x, y + WIRE)
        elif isinstance(shape, Series):
            for part in shape.parts:
                next_x = x + CELL * size(part)[0]
                self._shape(part, x, y, next_x)
                x = next_x
        else:
            self._parallel(shape, x, y, width_end)
        if end > width_end:
            self._picture.line(width_end, y + WIRE, end, y + WIRE)

    def _parallel(self, shape: Parallel, x: int, y: int, end: int) -> None:
        below = last = y
        for part in shape.parts:
            last = below
            self._shape(part, x, below, end)
            below += ROW * size(part)[1]
        for side in (x, end):
            self._picture.line(side, y + WIRE, side, last + WIRE)

    def _contact(self, instruction: Instruction, x: int, y: int) -> None:
        picture, middle = self._picture, x + CELL // 2
        name = instruction.name
        if len(instruction.operands) != 1:
            text = _comparison(instruction)
            half = round(len(text) * CHARACTER_WIDTH / 2) + 5
            picture.box(middle - half, y - 9, 2 * half, 18)
            picture.text(middle, y + 4, text, middle=True)
        else:
            half = 7
            for side in (-half, half):
                picture.line(middle + side, y - 9, middle + side, y + 9)
            if name in ("LDI", "ANI", "ORI"):
                picture.line(middle - half + 2, y + 8, middle + half - 2, y - 8)
            elif name[-1] in "PF":
                tip = -7 if name.endswith("P") else 7
                picture.path([(middle, y - tip), (middle, y + tip)], arrow=True)
            picture.text(middle, y - 13, str(instruction.operands[0]), middle=True)
        picture.line(x, y, middle - half, y)
        picture.line(middle + half, y, x + CELL, y)
        self._notes(self._comment(instruction), middle, y)

    def _output(self, instruction: Instruction, x: int, y: int) -> None:
        if instruction.name != "OUT":
            self._box(instruction, y, x)
            return
        picture, middle = self._picture, self.right - CELL // 2
        target, *preset = map(str, instruction.operands)
        inside = " ".join(preset)
        half = max(8, round(len(inside) * CHARACTER_WIDTH / 2) + 6)
        picture.line(x, y, middle - half - 2, y)
        picture.line(middle + half + 2, y, self.right, y)
        picture.arc(middle - half + 2, y, -8, 18)
        picture.arc(middle + half - 2, y, 8, 18)
        if inside:
            picture.text(middle, y + 4, inside, middle=True)
        picture.text(middle, y - 13, target, middle=True)
        self._notes(self._comment(instruction), middle, y)

    def _box(self, instruction: Instruction, y: int, x: int) -> None:
        """Draw an instruction as a box at the right rail, with a wire from `x`."""
        width = _output_width(instruction) - 16
        left = self.right - 8 - width
        self._picture.line(x, y, left, y)
        self._picture.line(left + width, y, self.right, y)
        self._picture.box(left, y - 10, width, 20)
        self._picture.text(left + 6, y + 4, str(instruction))
        self._notes(self._comment(instruction), left + width // 2, y)

    def _notes(self, comment: str, middle: int, y: int) -> None:
        lines = textwrap.wrap(comment, _CHARACTERS, max_lines=COMMENT_LINES, placeholder=" ...")
        for n, line in enumerate(lines):
            self._picture.text(middle, y + 20 + 11 * n, line, "note", middle=True)

    def _comment(self, instruction: Instruction) -> str:
        """Return the comment of the last operand that has a comment."""
        comments = (self.ladder.comments.get(_device(operand)) for operand in reversed(instruction.operands))
        return next(filter(None, comments), "")


def _device(operand: object) -> str:
    device = operand.device if isinstance(operand, Digits) else operand
    return str(DeviceOperand(device.kind, device.number)) if isinstance(device, DeviceOperand) else ""


def _comparison(instruction: Instruction) -> str:
    """Return the text in the box of a comparison or of INV.

    Examples:
        >>> _comparison(Instruction("ANDD>=", (DeviceOperand("D", 0), DeviceOperand("D", 2))))
        'D0 D>= D2'
    """
    if not instruction.operands:
        return instruction.name
    left, right = instruction.operands
    return f"{left} {re.sub('^(LD|AND|OR)', '', instruction.name)} {right}"


def _output_width(instruction: Instruction) -> int:
    width = round(len(str(instruction)) * CHARACTER_WIDTH) + 28
    return CELL if instruction.name == "OUT" else max(CELL, width)


def _outputs(leg: Leg | None) -> Iterator[int]:
    for item in leg.items if leg is not None else ():
        if isinstance(item, Leg):
            yield from _outputs(item)
        else:
            yield item
