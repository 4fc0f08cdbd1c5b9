"""Ladder pictures: completeness, positions, no overlaps."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from xml.etree import ElementTree as ET

import pytest

from controller.fx.drawing.ladder import LONGEST_PAGE, draw
from controller.fx.drawing.rung import CELL, MARGIN, ROW
from controller.fx.drawing.step_chart import charts
from controller.fx.language.il import read_il
from controller.fx.language.instruction import DeviceOperand, Instruction, Ladder
from tests.controller.export.fx_equality import EXPORTED
from tests.controller.fx.language.fx_samples import APPLIED, BRANCHES, SELF_HOLDING

NAMESPACE = "{http://www.w3.org/2000/svg}"
STEPS = """\
LD M8002
SET S0
STL S0
LD X0
AND X1
SET S20
LD X2
OUT S21
STL S20
OUT Y0
LD X3
OR X4
MPS
AND X5
SET S21
MPP
ANI X5
SET S0
STL S21
LD T0
OUT S0
RET
LD M8000
SET S30
STL S30
LDP X6
OUT S30
RET
END
"""


@dataclass(frozen=True)
class Box:
    """Bounds of a symbol, px."""

    left: float
    top: float
    right: float
    bottom: float

    def overlaps(self, other: Box) -> bool:
        # wires may touch, but symbols must not overlap
        return (
            min(self.right, other.right) - max(self.left, other.left) > 0.5
            and min(self.bottom, other.bottom) - max(self.top, other.top) > 0.5
        )


def numbers(element: ET.Element, *names: str) -> list[float]:
    return [float(element.attrib[name]) for name in names]


def bounds(element: ET.Element) -> Iterator[Box]:
    """Yield the bounds of all shapes in an element."""
    kind = element.tag.removeprefix(NAMESPACE)
    if kind == "line":
        x1, y1, x2, y2 = numbers(element, "x1", "y1", "x2", "y2")
        yield Box(min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))
    elif kind == "rect":
        x, y, width, height = numbers(element, "x", "y", "width", "height")
        yield Box(x, y, x + width, y + height)
    elif kind == "polyline":
        points = [tuple(map(float, point.split(","))) for point in element.attrib["points"].split()]
        xs, ys = [p[0] for p in points], [p[1] for p in points]
        yield Box(min(xs), min(ys), max(xs), max(ys))
    elif kind == "path" and "q" in element.attrib["d"]:
        x, y, bulge, _, height = map(float, re.findall(r"-?[\d.]+", element.attrib["d"].replace(" 0 ", " ")))
        yield Box(min(x, x + bulge), y, max(x, x + bulge), y + height)
    elif kind == "text":
        x, y = numbers(element, "x", "y")
        width = 6.02 * len(element.text or "")
        left = x - width / 2 if element.get("text-anchor") == "middle" else x
        yield Box(left, y - 8, left + width, y + 2)
    for child in element:
        if kind != "defs":
            yield from bounds(child)


def around(boxes: list[Box]) -> Box:
    return Box(
        min(b.left for b in boxes), min(b.top for b in boxes), max(b.right for b in boxes), max(b.bottom for b in boxes)
    )


def symbols(svg: str) -> dict[int, Box]:
    """Return the bounds of each symbol by the index of its instruction."""
    groups = (g for g in ET.fromstring(svg).iter(f"{NAMESPACE}g") if g.get("class") == "symbol")  # noqa: S314 - generated text
    return {int(group.attrib["data-at"]): around(list(bounds(group))) for group in groups}


def ladder(text: str) -> Ladder:
    return read_il(text)


def drawn(text: str) -> dict[str, Box]:
    """Return the bounds of each symbol of a short program by its instruction."""
    program = ladder(text)
    (name,) = [name for name in draw(program) if not name.startswith("steps")]
    return {str(program.instructions[at]): box for at, box in symbols(draw(program)[name]).items()}


def rungs(files: dict[str, str]) -> dict[str, str]:
    return {name: svg for name, svg in files.items() if not name.startswith("steps_")}


PROGRAMS = {
    "self-holding": ladder(SELF_HOLDING),
    "branches": ladder(BRANCHES),
    "applied": ladder(APPLIED),
    "steps": ladder(STEPS),
    "machine": EXPORTED,
}


@cache
def pictures(name: str) -> dict[str, str]:
    """Return the files of one of the programs."""
    return draw(PROGRAMS[name])


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_instruction_is_drawn_exactly_once(name: str) -> None:
    found: list[int] = []
    for svg in rungs(pictures(name)).values():
        for group in ET.fromstring(svg).iter(f"{NAMESPACE}g"):  # noqa: S314 - generated text
            if group.get("class") == "symbol":
                found.append(int(group.attrib["data-at"]))
            found += map(int, group.get("data-joins", "").split())
    assert sorted(found) == list(range(len(PROGRAMS[name].instructions)))


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_symbol_shows_its_instruction(name: str) -> None:
    for svg in rungs(pictures(name)).values():
        for group in ET.fromstring(svg).iter(f"{NAMESPACE}g"):  # noqa: S314 - generated text
            if group.get("class") == "symbol":
                text = " ".join(filter(None, (t.text for t in group.iter(f"{NAMESPACE}text"))))
                for operand in PROGRAMS[name].instructions[int(group.attrib["data-at"])].operands:
                    assert str(operand) in text


@pytest.mark.parametrize("name", PROGRAMS)
def test_no_overlaps_and_nothing_outside_the_page(name: str) -> None:
    instructions = PROGRAMS[name].instructions
    for file, svg in pictures(name).items():
        root = ET.fromstring(svg)  # noqa: S314 - generated text
        width, height = numbers(root, "width", "height")
        assert root.attrib["viewBox"] == f"0 0 {width:g} {height:g}"
        page = around(list(bounds(root)))
        assert (page.left, page.top) == (0, 0), file
        assert (page.right, page.bottom) == (width, height), file
        ends = [numbers(line, "x1", "y1", "x2", "y2") for line in root.iter(f"{NAMESPACE}line")]
        assert all(end[:2] != end[2:] for end in ends), f"{file}: a line without length"
        own = sorted(symbols(svg).items(), key=lambda item: item[1].top)
        for (one, box), (other, its) in combinations(own, 2):
            assert not box.overlaps(its), f"{file}: {instructions[one]} and {instructions[other]}"


def test_steps_and_conditions_of_a_chart_do_not_overlap() -> None:
    for name, svg in pictures("machine").items():
        if name.startswith("steps_"):
            root = ET.fromstring(svg)  # noqa: S314 - generated text
            texts = [box for t in root.iter(f"{NAMESPACE}text") for box in bounds(t)]
            assert not [pair for pair in combinations(texts, 2) if pair[0].overlaps(pair[1])], name
            boxes = [b for r in root.iter(f"{NAMESPACE}rect") if r.get("class") != "paper" for b in bounds(r)]
            assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])], name


def test_series_contacts_are_side_by_side() -> None:
    at = drawn("LD X0\nANI X1\nAND= D0 K5\nOUT Y0\nEND\n")
    contacts = [at["LD X0"], at["ANI X1"], at["AND= D0 K5"]]
    assert [box.left for box in contacts] == [MARGIN, MARGIN + CELL, MARGIN + 2 * CELL]
    assert all(box.top < at["OUT Y0"].bottom and box.bottom > at["OUT Y0"].top for box in contacts)
    assert at["OUT Y0"].right > max(box.right for box in contacts)


def test_parallel_contacts_are_below_each_other() -> None:
    at = drawn("LD X0\nOR X1\nORI X2\nOUT Y0\nEND\n")
    assert at["LD X0"].left == at["OR X1"].left == at["ORI X2"].left
    assert at["OR X1"].top - at["LD X0"].top == at["ORI X2"].top - at["OR X1"].top == ROW


def test_structure_of_blocks() -> None:
    """In (X0 X1 + X2) (X3 + X4), X3 is to the right of X1, X2 is below X0, and X4 is below X3."""
    at = drawn("LD X0\nAND X1\nLD X2\nORB\nLD X3\nOR X4\nANB\nOUT Y0\nEND\n")
    columns = {name: round((box.left - MARGIN) / CELL) for name, box in at.items()}
    tops = {name: round((box.top - at["LD X0"].top) / ROW) for name, box in at.items()}
    assert {n: (columns[n], tops[n]) for n in ("LD X0", "AND X1", "LD X2", "LD X3", "OR X4")} == {
        "LD X0": (0, 0),
        "AND X1": (1, 0),
        "LD X2": (0, 1),
        "LD X3": (2, 0),
        "OR X4": (2, 1),
    }


def test_branches_are_below_each_other_after_their_contact() -> None:
    at = drawn("LD X0\nMPS\nAND X1\nOUT Y0\nMRD\nLD X2\nOR X3\nANB\nOUT Y1\nMPP\nOUT Y2\nEND\n")
    assert at["AND X1"].left == at["LD X2"].left == MARGIN + CELL
    assert at["OR X3"].top == at["LD X2"].top + ROW
    rows = [(at[f"OUT Y{n}"].top - at["OUT Y0"].top) / ROW for n in range(3)]
    assert rows == pytest.approx([0, 1, 3])


def test_outputs_of_one_circuit_share_its_contacts() -> None:
    at = drawn("LD X0\nOUT Y0\nSET M0\nAND X1\nOUT Y1\nLD X2\nOUT Y2\nEND\n")
    assert at["SET M0"].top > at["OUT Y0"].top
    assert at["AND X1"].left == MARGIN + CELL
    assert at["LD X2"].left == MARGIN


@pytest.mark.parametrize("names", ["LD LDI LDP LDF", "AND ANI ANDP ANDF", "OR ORI ORP ORF"])
def test_symbols_of_break_contacts_and_edges_differ_from_a_make_contact(names: str) -> None:
    looks = set()
    for name in names.split():
        first, at = ("", "0") if name.startswith("LD") else ("LD X1\n", "1")
        (svg,) = draw(ladder(f"{first}{name} X0\nOUT Y0\nEND\n")).values()
        groups = (g for g in ET.fromstring(svg).iter(f"{NAMESPACE}g") if g.get("data-at") == at)  # noqa: S314
        looks.add(ET.tostring(next(groups)))
    assert len(looks) == 4


def test_a_rung_ends_with_its_last_branch() -> None:
    at = drawn("LD X0\nMPS\nAND X1\nOUT Y0\nMPP\nOUT Y1\nLD X2\nOUT Y2\nEND\n")
    assert at["LD X2"].left == MARGIN
    assert at["LD X2"].top > at["OUT Y1"].bottom


def test_long_rung_continues_in_the_next_row() -> None:
    lines = ["LD X0", *(f"AND M{n}" for n in range(25)), "OUT Y0", "END"]
    at = drawn("\n".join(lines) + "\n")
    assert at["AND M8"].left == MARGIN
    assert at["AND M8"].top > at["LD X0"].top
    assert at["OUT Y0"].top > at["AND M16"].bottom


def test_branches_continue_in_the_next_row_after_a_full_one() -> None:
    lines = ["LD X0", *(f"AND M{n}" for n in range(8)), "MPS", "AND X1", "OUT Y0", "MPP", "OUT Y1", "END"]
    at = drawn("\n".join(lines) + "\n")
    assert at["AND X1"].left == MARGIN
    assert at["LD X0"].bottom < at["AND X1"].top < at["OUT Y1"].top


def test_long_block_continues_in_another_file() -> None:
    text = "; long\n" + "".join(f"LD M{n}\nOUT M{n + 200}\n" for n in range(100)) + "END\n"
    files = draw(ladder(text))
    assert len(files) > 1
    for svg in files.values():
        assert numbers(ET.fromstring(svg), "height")[0] <= LONGEST_PAGE + 5 * MARGIN  # noqa: S314 - generated text


def test_each_block_has_a_file_and_steps_have_none() -> None:
    titles = {re.sub(r"(_\d+)?\.svg$", "", name)[3:] for name in rungs(pictures("machine"))}
    assert {"power_up", "modes", "left_arm", "tray_feeder", "interlocks_and_outputs"} <= titles
    assert "settle_at_row" not in titles


def test_texts_are_escaped() -> None:
    program = Ladder(
        (Instruction("LD", (DeviceOperand("X", 0),)), Instruction("OUT", (DeviceOperand("Y", 0),)), Instruction("END")),
        {0: 'a < b & "c"'},
        {"X0": "<tag> & more"},
    )
    (svg,) = draw(program).values()
    texts = [t.text for t in ET.fromstring(svg).iter(f"{NAMESPACE}text")]  # noqa: S314 - generated text
    assert 'a < b & "c"' in texts
    assert "<tag> & more" in texts


def test_a_chart_has_the_transfers_of_its_steps() -> None:
    first, second = charts(ladder(STEPS))
    assert list(first.titles) == [0, 20, 21]
    assert [(t.source, t.target, t.condition) for t in first.transfers] == [
        (0, 20, "X0 and X1"),
        (0, 21, "X2"),
        (20, 21, "(X3 or X4) and X5"),
        (20, 0, "(X3 or X4) and not X5"),
        (21, 0, "T0"),
    ]
    assert [(t.source, t.target, t.condition) for t in second.transfers] == [(30, 30, "rising X6")]


def test_jump_ends_at_its_target_step() -> None:
    """Direct transfers enter the next step from above; jumps enter their target step from the left."""
    svg = draw(ladder(STEPS))["steps_S0.svg"]
    root = ET.fromstring(svg)  # noqa: S314 - generated text
    groups = list(root.iter(f"{NAMESPACE}g"))
    steps = {g.attrib["data-state"]: next(bounds(g)) for g in groups if g.get("class") == "step"}
    ends = 0
    for group in groups:
        if group.get("class") == "transfer":
            (arrow,) = group.iter(f"{NAMESPACE}polyline")
            x, y = map(float, arrow.attrib["points"].split()[-1].split(","))
            box = steps[group.attrib["data-target"]]
            straight = (group.attrib["data-source"], group.attrib["data-target"]) in {("0", "20"), ("20", "21")}
            assert (y == box.top) if straight else (x == box.left and box.top < y < box.bottom)
            ends += 1
    assert ends == 5


def test_a_join_leaves_all_its_steps() -> None:
    (chart,) = charts(ladder("STL S20\nSTL S21\nLD X0\nSET S22\nSTL S22\nOUT Y0\nRET\nEND\n"))
    assert [(t.source, t.target) for t in chart.transfers] == [(20, 22), (21, 22)]


def test_the_charts_of_the_machine_are_its_sequences() -> None:
    assert [name for name in pictures("machine") if name.startswith("steps_")] == [
        "steps_S20.svg",
        "steps_S100.svg",
        "steps_S60.svg",
        "steps_S140.svg",
        "steps_S180.svg",
    ]


def test_drawing_time_of_the_machine() -> None:
    before = time.process_time()
    draw(EXPORTED)
    assert time.process_time() - before < 10
