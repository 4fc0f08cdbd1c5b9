"""Step charts of a ladder: boxes for the steps, bars with conditions for the transfers, arrows for jumps."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.fx.drawing.svg import CHARACTER_WIDTH, SvgPicture
from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder
from controller.fx.language.instruction_set import JOINS, RELATIONS
from controller.fx.language.rung_shapes import Contact, Leg, Rung, Series, Shape, rungs_of

BOX_WIDTH: Final = 230
BOX_HEIGHT: Final = 40
LINE: Final = 13
LANE: Final = 12
MARGIN: Final = 24
TEXT_WIDTH: Final = 100
"""Maximum number of characters in a line of a condition."""
_GAP: Final = 16


@dataclass(frozen=True, slots=True)
class ChartTransfer:
    """Transfer from a step: SET or OUT of a state within the step.

    Attributes:
        at: Index of the instruction.
        source: Number of the source state.
        target: Number of the target state.
        condition: Transfer condition as text.
    """

    at: int
    source: int
    target: int
    condition: str


@dataclass(slots=True)
class Chart:
    """Group of steps connected by transfers.

    Attributes:
        titles: Title of each state, in program order.
        transfers: Transfers, in program order.
    """

    titles: dict[int, str]
    transfers: list[ChartTransfer] = field(default_factory=list)


def draw_charts(ladder: Ladder) -> dict[str, str]:
    """Return a picture of each chart by file name, for example steps_S20.svg for the chart whose first state is S20."""
    result = charts(ladder)
    return {f"steps_S{next(iter(chart.titles))}.svg": _ChartPage(chart).svg() for chart in result}


def charts(ladder: Ladder) -> list[Chart]:
    """Return the step charts of a program in program order."""
    titles: dict[int, str] = {}
    transfers: list[ChartTransfer] = []
    sources: list[int] = []
    joining = False
    for rung in rungs_of(ladder):
        instruction = ladder.instructions[rung.first]
        match instruction:
            case Instruction("STL", (DeviceOperand("S", number),)):
                sources = [*sources, number] if joining else [number]
                titles.setdefault(number, ladder.comments.get(f"S{number}") or ladder.titles.get(rung.first, ""))
            case Instruction("RET" | "END" | "FEND", _):
                sources = []
        joining = instruction.name == "STL"
        transfers += _transfers(ladder, rung, sources)
    return _connected(titles, transfers)


def _transfers(ladder: Ladder, rung: Rung, sources: list[int]) -> Iterator[ChartTransfer]:
    if rung.leg is None or not sources:
        return
    for at, conditions in _paths(rung.leg, ()):
        match ladder.instructions[at]:
            case Instruction("SET" | "OUT", (DeviceOperand("S", target), *_)) if target not in ANNUNCIATORS:
                text = " and ".join(worded(ladder, condition, grouped=len(conditions) > 1) for condition in conditions)
                for source in sources:
                    yield ChartTransfer(at, source, target, text or "always")


def _paths(leg: Leg, before: tuple[Shape, ...]) -> Iterator[tuple[int, tuple[Shape, ...]]]:
    """Yield every output with the contacts on the path to it."""
    way = before if leg.head is None else (*before, leg.head)
    for item in leg.items:
        if isinstance(item, Leg):
            yield from _paths(item, way)
        else:
            yield item, way


def worded(ladder: Ladder, shape: Shape, *, grouped: bool = False) -> str:
    """Return a description of contacts: device comments joined with "and", "or" and "not"."""
    if isinstance(shape, Contact):
        return _contact(ladder, ladder.instructions[shape.at])
    joint = " and " if isinstance(shape, Series) else " or "
    text = joint.join(worded(ladder, part, grouped=True) for part in shape.parts)
    return f"({text})" if grouped and joint == " or " else text


def _contact(ladder: Ladder, instruction: Instruction) -> str:
    if not instruction.operands:
        return "inverted"
    names = map(str, instruction.operands)
    first, *further = (f"[{ladder.comments[name]}]" if name in ladder.comments else name for name in names)
    if further:
        relation = next(r for r in sorted(RELATIONS, key=len, reverse=True) if instruction.name.endswith(r))
        return f"{first} {relation} {further[0]}"
    if instruction.name in ("LDI", "ANI", "ORI"):
        return f"not {first}"
    edges = {f"{join}{end}": word for join in JOINS for end, word in (("P", "rising "), ("F", "falling "))}
    return edges.get(instruction.name, "") + first


def _connected(titles: dict[int, str], transfers: list[ChartTransfer]) -> list[Chart]:
    group = {state: state for state in titles}
    for transfer in transfers:
        old, new = group.get(transfer.source), group.setdefault(transfer.target, transfer.target)
        group = {state: new if key == old else key for state, key in group.items()}
    result: dict[int, Chart] = {}
    for state, key in group.items():
        result.setdefault(key, Chart({})).titles[state] = titles.get(state, "")
    for transfer in transfers:
        result[group[transfer.source]].transfers.append(transfer)
    return list(result.values())


class _ChartPage:
    """Page with one chart: steps from top to bottom, jumps in lanes on the left."""

    def __init__(self, chart: Chart) -> None:
        self._picture = SvgPicture()
        self._states = list(chart.titles)
        self._titles = chart.titles
        self._next = dict(zip(self._states, self._states[1:], strict=False))
        # the transfer to the next step comes last: it is the straight line down
        self._out = {
            state: sorted((t for t in chart.transfers if t.source == state), key=self._straight)
            for state in self._states
        }
        self._top = self._tops()
        self._row = dict(self._rows())
        jumps = [t for ways in self._out.values() for t in ways if not self._straight(t)]
        self._lane = self._lanes(jumps)
        self._left = MARGIN + LANE * (max(self._lane.values(), default=0) + 2)
        self._entries: dict[int, int] = {}

    def svg(self) -> str:
        """Return the page as SVG text."""
        for state in self._states:
            self._step(state)
        lines = [line for ways in self._out.values() for t in ways for line in self._text(t)]
        lines.append(self._heading())
        widest = max(BOX_WIDTH, BOX_WIDTH // 2 + 20 + round(max(map(len, lines)) * CHARACTER_WIDTH))
        height = self._top[self._states[-1]] + self._space(self._states[-1]) + MARGIN
        self._picture.text(MARGIN, MARGIN, self._heading(), "title")
        return self._picture.svg(self._left + widest + MARGIN, height, self._heading())

    def _heading(self) -> str:
        return f"Steps S{min(self._states)} to S{max(self._states)}"

    def _straight(self, transfer: ChartTransfer) -> bool:
        return self._next.get(transfer.source) == transfer.target

    def _text(self, transfer: ChartTransfer) -> list[str]:
        lines = textwrap.wrap(transfer.condition, TEXT_WIDTH) or [""]
        if not self._straight(transfer):
            lines[-1] += f"  -> S{transfer.target}"
        return lines

    def _space(self, state: int) -> int:
        return BOX_HEIGHT + _GAP * 2 + sum(LINE * len(self._text(t)) + _GAP for t in self._out[state])

    def _tops(self) -> dict[int, int]:
        tops, y = {}, MARGIN + 20
        for state in self._states:
            tops[state] = y
            y += self._space(state)
        return tops

    def _rows(self) -> Iterator[tuple[ChartTransfer, int]]:
        for state, ways in self._out.items():
            y = self._top[state] + BOX_HEIGHT + _GAP
            for transfer in ways:
                yield transfer, y
                y += LINE * len(self._text(transfer)) + _GAP

    def _lanes(self, jumps: list[ChartTransfer]) -> dict[ChartTransfer, int]:
        """Assign each jump to a lane that is free along its path; short jumps use the inner lanes."""
        lanes: dict[ChartTransfer, int] = {}
        occupied: list[list[tuple[int, int]]] = []
        for jump in sorted(jumps, key=lambda t: abs(self._row[t] - self._top[t.target])):
            low, high = sorted((self._row[jump], self._top[jump.target]))
            span = (low - BOX_HEIGHT, high + BOX_HEIGHT)
            free = (n for n, used in enumerate(occupied) if all(span[1] < a or b < span[0] for a, b in used))
            lane = next(free, len(occupied))
            if lane == len(occupied):
                occupied.append([])
            occupied[lane].append(span)
            lanes[jump] = lane
        return lanes

    def _step(self, state: int) -> None:
        picture, y = self._picture, self._top[state]
        middle = self._left + BOX_WIDTH // 2
        with picture.group("step", **{"data-state": str(state)}):
            picture.box(self._left, y, BOX_WIDTH, BOX_HEIGHT)
            picture.text(self._left + 8, y + 16, f"S{state}", "title")
            title = textwrap.shorten(self._titles[state], int(BOX_WIDTH / CHARACTER_WIDTH) - 3, placeholder=" ...")
            picture.text(self._left + 8, y + 31, title)
        ways = self._out[state]
        if ways:
            picture.line(middle, y + BOX_HEIGHT, middle, self._row[ways[-1]])
        for transfer in ways:
            with picture.group("transfer", **{"data-source": str(state), "data-target": str(transfer.target)}):
                self._transfer(transfer, middle)

    def _transfer(self, transfer: ChartTransfer, middle: int) -> None:
        picture, y = self._picture, self._row[transfer]
        picture.line(middle - 8, y, middle + 8, y)
        for n, line in enumerate(self._text(transfer)):
            picture.text(middle + 16, y + 4 + LINE * n, line)
        if self._straight(transfer):
            picture.path([(middle, y), (middle, self._top[transfer.target])], arrow=True)
            return
        entry = self._entries[transfer.target] = self._entries.get(transfer.target, 0) + 1
        into = self._top[transfer.target] + 4 + entry * 5 % (BOX_HEIGHT - 8)
        x = self._left - LANE * (self._lane[transfer] + 2) + LANE // 2
        picture.path([(middle - 8, y), (x, y), (x, into), (self._left, into)], arrow=True)
