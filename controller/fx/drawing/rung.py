"""Drawing of one rung: contacts, outputs and wires.

Every symbol is in a group of class "symbol" whose `data-at` is the index of its instruction. Every wire is in a group
of class "wire" whose `data-node` is the electrical node of the rung (`Wiring`), so that a page can colour both.
Instructions without a symbol (ANB, ORB, MPS, MRD, MPP) are listed in the `data-joins` attribute of the rung's group,
and `data-first` is the index of its first instruction.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final

from controller.fx.drawing.svg import CHARACTER_WIDTH, SvgPicture
from controller.fx.drawing.wiring import RAIL, Wiring
from controller.fx.language.instruction import DeviceOperand, Digits, Instruction, Ladder
from controller.fx.language.rung_shapes import Contact, Leg, Parallel, Rung, Series, Shape, series

CELL: Final = 136
"""Width of a contact with its texts, px."""
ROW: Final = 62
"""Height of a contact with its texts, px."""
WIRE: Final = 22
"""Distance of the wire from the top of its row, px."""
MARGIN: Final = 40
BAND: Final = 22
COLUMNS: Final = 9
"""Maximum number of contacts in a row; longer rungs continue in the next row."""
COMMENT_LINES: Final = 2
_CHARACTERS: Final = int((CELL - 10) / CHARACTER_WIDTH)
SPACE: Final = 10


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


def rung_height(ladder: Ladder, rung: Rung) -> int:
    """Return the height of a rung, px."""
    if rung.leg is None:
        return BAND if ladder.instructions[rung.first].name == "STL" else ROW
    before, leg = _folded(rung.leg)
    return ROW * (sum(size(row)[1] for row in before) + _leg_size(leg)[1])


def rung_width(rung: Rung) -> int:
    """Return the number of columns of contacts in a rung."""
    if rung.leg is None:
        return 0
    before, leg = _folded(rung.leg)
    return max(_leg_size(leg)[0], *(size(row)[0] for row in before), 0)


class RungDrawing:
    """Drawing of the rungs of a program between two rails.

    Attributes:
        ladder: Program.
        left: x-coordinate of the left rail, px.
        right: x-coordinate of the right rail, px.
    """

    def __init__(
        self,
        ladder: Ladder,
        picture: SvgPicture,
        right: int,
        step_numbers: Sequence[int],
        texts: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Prepare a drawing.

        Args:
            ladder: The program.
            picture: Picture in which to draw.
            right: x-coordinate of the right rail, px.
            step_numbers: Program step of each instruction.
            texts: Further texts of devices by FX name, shown with the pointer on a symbol.
        """
        self.ladder = ladder
        self.left = MARGIN
        self.right = right
        self._picture = picture
        self._step_numbers = step_numbers
        self._texts = texts or {}
        self._wiring: Wiring

    def draw(self, rung: Rung, y: int) -> None:
        """Draw a rung in a group; `y` is its top, px."""
        attributes = {"data-first": str(rung.first), "data-joins": " ".join(map(str, rung.joins))}
        with self._picture.group("rung", **attributes):
            self._picture.text(2, y + WIRE - 8, str(self._step_numbers[rung.first]), "note")
            if rung.leg is None:
                self._on_bus(rung.first, y)
            else:
                self._wiring = Wiring(rung.leg)
                self._rung(rung.leg, y)

    def _wire(self, node: int, *points: tuple[float, float], arrow: bool = False) -> None:
        """Draw a wire of an electrical node."""
        with self._picture.group("wire", **{"data-node": str(node)}):
            if arrow:
                self._picture.path(points, arrow=True)
            else:
                (x1, y1), (x2, y2) = points
                self._picture.line(x1, y1, x2, y2)

    def _on_bus(self, at: int, y: int) -> None:
        instruction = self.ladder.instructions[at]
        with self._symbol(at):
            if instruction.name == "STL":
                title, comment = self.ladder.titles.get(at, ""), self._comment(instruction)
                titles = (comment,) if title in comment else (title, comment)
                text = " - ".join(filter(None, (str(instruction), *titles)))
                self._picture.box(self.left, y, self.right - self.left, BAND, "band")
                self._picture.text(self.left + 8, y + 15, text, "title")
            else:
                self._box(instruction, y + WIRE, self.left, RAIL)

    def _rung(self, leg: Leg, y: int) -> None:
        before, last = _folded(leg)
        for number, row in enumerate(before, 1):
            columns, rows = size(row)
            end = self.left + CELL * columns
            self._shape(row, self.left, y, end)
            node = self._wiring.end(row)
            self._wire(node, (end, y + WIRE), (end + 16, y + WIRE), arrow=True)
            self._picture.text(end + 20, y + WIRE + 4, f"({number})", "note")
            y += ROW * rows
            self._picture.text(2, y + WIRE + 4, f"({number})", "note")
        self._leg(last, self.left, y, self._wiring.end(before[-1]) if before else RAIL)

    def _leg(self, leg: Leg, x: int, y: int, left: int) -> None:
        """Draw a leg that begins at a node."""
        columns, _ = size(leg.head)
        fork = x + CELL * columns
        node = left if leg.head is None else self._wiring.end(leg.head)
        if leg.head is not None:
            self._shape(leg.head, x, y, fork)
        below = last = y
        for item in leg.items:
            last = below
            if isinstance(item, Leg):
                self._leg(item, fork, below, node)
                below += ROW * _leg_size(item)[1]
            else:
                with self._symbol(item):
                    self._output(self.ladder.instructions[item], fork, below + WIRE, node)
                below += ROW
        if last != y:
            self._picture.dot(fork, y + WIRE)
            self._wire(node, (fork, y + WIRE), (fork, last + WIRE))

    def _shape(self, shape: Shape, x: int, y: int, end: int) -> None:
        """Draw contacts from `x`, and extend their wire to `end`."""
        width_end = x + CELL * size(shape)[0]
        if isinstance(shape, Contact):
            with self._symbol(shape.at):
                self._contact(shape.at, x, y + WIRE)
        elif isinstance(shape, Series):
            for part in shape.parts:
                next_x = x + CELL * size(part)[0]
                self._shape(part, x, y, next_x)
                x = next_x
        else:
            self._parallel(shape, x, y, width_end)
        if end > width_end:
            self._wire(self._wiring.end(shape), (width_end, y + WIRE), (end, y + WIRE))

    def _parallel(self, shape: Parallel, x: int, y: int, end: int) -> None:
        below = last = y
        for part in shape.parts:
            last = below
            self._shape(part, x, below, end)
            below += ROW * size(part)[1]
        for node, side in ((self._wiring.start(shape), x), (self._wiring.end(shape), end)):
            self._wire(node, (side, y + WIRE), (side, last + WIRE))

    def _contact(self, at: int, x: int, y: int) -> None:
        instruction = self.ladder.instructions[at]
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
        self._wire(self._wiring.before[at], (x, y), (middle - half, y))
        self._wire(self._wiring.after[at], (middle + half, y), (x + CELL, y))
        self._notes(self._comment(instruction), middle, y)

    def _output(self, instruction: Instruction, x: int, y: int, node: int) -> None:
        if instruction.name != "OUT":
            self._box(instruction, y, x, node)
            return
        picture, middle = self._picture, self.right - CELL // 2
        target, *preset = map(str, instruction.operands)
        inside = " ".join(preset)
        half = max(8, round(len(inside) * CHARACTER_WIDTH / 2) + 6)
        self._wire(node, (x, y), (middle - half - 2, y))
        picture.line(middle + half + 2, y, self.right, y)
        picture.arc(middle - half + 2, y, -8, 18)
        picture.arc(middle + half - 2, y, 8, 18)
        if inside:
            picture.text(middle, y + 4, inside, middle=True)
        picture.text(middle, y - 13, target, middle=True)
        self._notes(self._comment(instruction), middle, y)

    def _box(self, instruction: Instruction, y: int, x: int, node: int) -> None:
        """Draw an instruction as a box at the right rail, with a wire of a node from `x`."""
        width = output_width(instruction) - 16
        left = self.right - 8 - width
        self._wire(node, (x, y), (left, y))
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

    @contextmanager
    def _symbol(self, at: int) -> Iterator[None]:
        """Put the symbol of an instruction into a group, with the texts of its devices as its title."""
        names = map(_device, self.ladder.instructions[at].operands)
        texts = ("; ".join((name, *self._texts[name])) for name in names if self._texts.get(name))
        with self._picture.group("symbol", **{"data-at": str(at)}):
            if title := "\n".join(texts):
                self._picture.title(title)
            yield


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


def output_width(instruction: Instruction) -> int:
    """Return the width of an output with its wires, px."""
    width = round(len(str(instruction)) * CHARACTER_WIDTH) + 28
    return CELL if instruction.name == "OUT" else max(CELL, width)
