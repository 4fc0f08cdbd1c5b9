"""Pictures of docs/architecture.md, drawn from the imports, the program and the kernel.

Run `python -m tests.project.architecture_pictures --out docs` to regenerate them.
"""

from __future__ import annotations

import argparse
import ast
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final
from xml.sax.saxutils import escape

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from tests.paths import ROOT

COMMAND: Final = ".venv/bin/python -m tests.project.architecture_pictures --out docs"
SIDES: Final = ("controller", "plant_sim")
BOX_W: Final = {"controller": 122, "plant_sim": 216}
BOX_H: Final = 40
ROW_H: Final = 78
GAP: Final = 14
MARGIN: Final = 46
HEAD: Final = 44
STEP_W: Final = 400
STEP_H: Final = 26
CONTRACTS: Final = {"controller": "Packages of the controller", "plant_sim": "Packages of the plant"}

STYLE: Final = """<style>
text { font-family: system-ui, sans-serif; font-size: 13px; fill: #222; }
.small { font-size: 10.5px; fill: #555; }
.head { font-size: 15px; font-weight: 600; }
.box { fill: #f4f6f8; stroke: #56646f; }
.phase { fill: #e3ebf2; stroke: #56646f; }
.line { fill: none; stroke: #8a97a3; stroke-width: 1.2; marker-end: url(#tip); }
</style>
<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">
<path d="M0,0 L8,4 L0,8 z" fill="#8a97a3"/></marker></defs>"""


def package_of(module: str) -> str:
    """Return the package directly below `controller` or `plant_sim` that a module belongs to."""
    return ".".join(module.split(".")[:2])


def imported(tree: ast.Module) -> Iterator[str]:
    """Yield the absolute names that a module imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            if "." in node.module:
                yield node.module
            else:
                yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imports() -> dict[str, set[str]]:
    """Return the packages that each package imports, excluding itself."""
    uses: dict[str, set[str]] = {}
    for side in SIDES:
        for path in sorted((ROOT / side).rglob("*.py")):
            package = package_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
            names = {package_of(name) for name in imported(ast.parse(path.read_text(encoding="utf-8")))}
            inside = {name for name in names if name.startswith(tuple(f"{side}." for side in SIDES))}
            uses.setdefault(package, set()).update(inside - {package})
    return uses


def layers(side: str) -> list[list[str]]:
    """Return the packages of one side by layer, as import-linter checks them, excluding `__main__`."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (contract,) = [entry for entry in contracts if entry["name"] == CONTRACTS[side]]
    rows = [[name.strip() for name in row.split("|")] for row in contract["layers"]]
    return [row for row in rows if row != ["__main__"]]


def reduced(uses: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """Return the imports that are not implied by a chain of other imports."""

    def reach(package: str) -> set[str]:
        return uses.get(package, set()).union(*(reach(name) for name in uses.get(package, set())), set())

    return [
        (package, target)
        for package in sorted(uses)
        for target in sorted(uses[package])
        if not any(target in reach(other) for other in uses[package] - {target})
    ]


def svg(width: int, height: int, title: str, parts: Sequence[str]) -> str:
    """Return the text of an SVG file."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{escape(title)}">'
    )
    ground = f'<rect width="{width}" height="{height}" fill="#fff"/>'
    return "\n".join([head, f"<title>{escape(title)}</title>", STYLE, ground, *parts, "</svg>"]) + "\n"


def text(x: float, y: float, words: str, kind: str = "", anchor: str = "middle") -> str:
    """Return an SVG text element."""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" class="{kind}">{escape(words)}</text>'


def box(x: float, y: float, width: float, height: float, kind: str = "box") -> str:
    """Return an SVG rectangle."""
    return f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="4" class="{kind}"/>'


def panel(side: str, left: int, uses: Mapping[str, set[str]]) -> tuple[list[str], int, int]:
    """Return the drawing of one side with its width and height."""
    rows, width = layers(side), BOX_W[side]
    inner = max(len(row) for row in rows) * (width + GAP) - GAP
    centre = left + MARGIN + inner / 2
    places: dict[str, tuple[float, int]] = {}
    for number, row in enumerate(rows):
        start = centre - (len(row) * (width + GAP) - GAP) / 2
        for place, name in enumerate(row):
            places[f"{side}.{name}"] = (start + place * (width + GAP) + width / 2, number)
    within = {name: {target for target in uses[name] if target in places} for name in places}
    lines, boxes = [], []
    lanes = {True: left + 8, False: left + inner + 2 * MARGIN - 8}
    for package, target in reduced(within):
        (x1, row1), (x2, row2) = places[package], places[target]
        y1, y2 = HEAD + row1 * ROW_H + BOX_H, HEAD + row2 * ROW_H - 1
        if row2 - row1 > 1:
            near = x1 + x2 <= 2 * centre
            lane = lanes[near]
            lanes[near] += 8 if near else -8
            out = f"M{x1:g},{y1} C{x1:g},{y1 + 20} {lane:g},{y1 + 8} {lane:g},{y1 + 36}"
            back = f"L{lane:g},{y2 - 36} C{lane:g},{y2 - 8} {x2:g},{y2 - 20} {x2:g},{y2}"
            lines.append(f'<path class="line" d="{out} {back}"/>')
        else:
            lines.append(f'<path class="line" d="M{x1:g},{y1} L{x2:g},{y2}"/>')
    for package, (x, level) in places.items():
        y = HEAD + level * ROW_H
        name = package.removeprefix(f"{side}.")
        across = sorted(target.split(".")[1] for target in uses[package] if not target.startswith(f"{side}."))
        boxes += [box(x - width / 2, y, width, BOX_H), text(x, y + (16 if across else 25), name)]
        if across:
            boxes.append(text(x, y + 32, " ".join(across), "small"))
    heading = text(centre, 26, side, "head")
    return [heading, *lines, *boxes], inner + 2 * MARGIN, HEAD + len(rows) * ROW_H


def packages() -> str:
    """Return the picture of all packages and their imports."""
    uses = imports()
    parts: list[str] = []
    left, tallest = 0, 0
    for side in SIDES:
        drawing, width, height = panel(side, left, uses)
        parts += drawing
        left, tallest = left + width, max(tallest, height)
    return svg(left, tallest, "Packages and their imports", parts)


def column(title: str, steps: Sequence[tuple[str, str]]) -> str:
    """Return a picture of steps in a column; those of the kind "phase" are shaded."""
    parts: list[str] = []
    x, y = 20, 20
    for number, (kind, words) in enumerate(steps):
        parts += [box(x, y, STEP_W, STEP_H, kind), text(x + STEP_W / 2, y + 17.5, words)]
        if number + 1 < len(steps):
            parts.append(f'<path class="line" d="M{x + STEP_W / 2:g},{y + STEP_H} v11"/>')
        y += STEP_H + 12
    return svg(STEP_W + 2 * x, y + 8, title, parts)


def both_sides(titles: Sequence[str]) -> list[str]:
    """Return the titles with each adjacent pair of a left and a right title merged into one."""
    found: list[str] = []
    for title in titles:
        rest = title.removeprefix("right ")
        if rest != title and found and found[-1] == f"left {rest}":
            found[-1] = f"left and right: {rest}"
        else:
            found.append(title)
    return found


def scan() -> str:
    """Return the picture of one scan: the blocks of the program between the input and output images."""
    program = build(load_io_map(DEFAULT_IO_MAP)).program
    return column(
        "One scan",
        [
            ("phase", "link: read X"),
            ("phase", "commands and set-points since the last scan"),
            ("phase", "input filter, X image"),
            *(("box", title) for title in both_sides([block.title for block in program.blocks])),
            ("phase", "END: reset the source steps of transfers"),
            ("phase", "retentive memory: submit changes"),
            ("phase", "delay outputs that depend on unstored memory"),
            ("phase", "link: write Y"),
            ("phase", "observers: alarm list, events, Modbus snapshot"),
        ],
    )


def called(name: str) -> list[str]:
    """Return the `step_` and `settle_` functions that a kernel function calls, in order, without duplicates."""
    source = (ROOT / "plant_sim/machine/kernel.py").read_text(encoding="utf-8")
    (function,) = [
        node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef) and node.name.strip("_") == name
    ]
    calls = [node for node in ast.walk(function) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    names = [call.func.id for call in sorted(calls, key=lambda call: call.lineno) if isinstance(call.func, ast.Name)]
    found = [found.strip("_") for found in names if re.match(r"_?(step|settle)_", found)]
    return list(dict.fromkeys(found))


def plant_step() -> str:
    """Return the picture of one step of the plant."""
    steps: list[tuple[str, str]] = [("phase", "coils from the Y image; all off without the safety relay")]
    for name in called("advance"):
        if name == "step_arm":
            steps += [("box", f"each arm: {part}") for part in called(name)]
        else:
            steps.append(("box", name))
    steps += [
        ("phase", "repeat until the scan's time has passed"),
        ("phase", "trays, claws and seedlings follow the motion"),
        ("phase", "X image from sensors and buttons"),
    ]
    return column("One step of the plant", steps)


PICTURES: Final = {
    "architecture-packages.svg": packages,
    "architecture-scan.svg": scan,
    "architecture-plant-step.svg": plant_step,
}


def write(folder: Path) -> list[Path]:
    """Write all pictures and return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, draw in PICTURES.items():
        path = folder / name
        path.write_text(draw(), encoding="utf-8")
        paths.append(path)
    return paths


def main() -> None:
    """Regenerate the pictures."""
    options = argparse.ArgumentParser(prog="architecture_pictures", description="Draw the pictures of architecture.md.")
    options.add_argument("--out", type=Path, required=True, help="folder for the pictures")
    for path in write(options.parse_args().out):
        print(path)  # noqa: T201


if __name__ == "__main__":
    main()
