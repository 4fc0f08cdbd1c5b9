"""The parts of a report as plain text for the terminal, as Markdown, as HTML, and a table as CSV."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from html import escape

from plant_sim.bench.study.parts import Cell, Heading, Part, Picture, Table

_STYLE = """\
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2 { line-height: 1.25; }
table { border-collapse: collapse; margin: 1.5rem 0 .25rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { text-align: left; padding: .15rem .8rem .15rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
thead th { border-bottom: 2px solid #666; }
.number { text-align: right; }
.wide { overflow-x: auto; }
.file { font-size: .85rem; margin: 0; }
figure { margin: 1.5rem 0; }
figcaption { font-weight: 600; }
img { max-width: 100%; height: auto; }
pre { background: #f4f4f4; padding: .6rem .8rem; overflow-x: auto; }
"""


def plain_text(title: str, parts: Iterable[Part]) -> str:
    """Return a report for the terminal; a picture is only named."""
    blocks = [f"{title}\n{'=' * len(title)}"]
    for part in parts:
        match part:
            case Heading(text):
                blocks.append(f"{text}\n{'-' * len(text)}")
            case Table():
                blocks.append(_plain_table(part))
            case Picture():
                blocks.append(f"[picture {part.name}: {part.caption}]")
            case _:
                blocks.append(part)
    return "\n\n".join(blocks)


def markdown(title: str, command: str, parts: Iterable[Part]) -> str:
    """Return a report as Markdown; pictures and CSV files lie beside it."""
    blocks = [f"# {_markdown(title)}", f"Made by\n\n```sh\n{command}\n```"]
    for part in parts:
        match part:
            case Heading(text):
                blocks.append(f"## {_markdown(text)}")
            case Table():
                blocks.append(_markdown_table(part))
            case Picture():
                caption = _markdown(part.caption)
                blocks.append(f"![{caption}]({part.name}.png)\n\n{caption} ([SVG]({part.name}.svg))")
            case _:
                blocks.append(_markdown_paragraph(part))
    return "\n\n".join(blocks) + "\n"


def html(title: str, command: str, parts: Iterable[Part]) -> str:
    """Return a report as one HTML page that needs nothing but the pictures beside it."""
    blocks = [f"<h1>{escape(title)}</h1>", f"<p>Made by</p>\n<pre>{escape(command)}</pre>"]
    for part in parts:
        match part:
            case Heading(text):
                blocks.append(f"<h2>{escape(text)}</h2>")
            case Table():
                blocks.append(_html_table(part))
            case Picture():
                caption, name = escape(part.caption), part.name
                image = f'<img src="{name}.svg" alt="{caption}">'
                blocks.append(f"<figure>\n{image}\n<figcaption>{caption}</figcaption>\n</figure>")
            case _:
                blocks.append(f"<p>{escape(part)}</p>")
    head = (
        '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_STYLE}</style>"
    )
    body = "\n".join(blocks)
    return f'<!doctype html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n</body>\n</html>\n'


def csv_text(table: Table) -> str:
    """Return a table as CSV with every digit; nothing stands where there is nothing to tell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.heading)
    writer.writerows([_bare(cell) for cell in row] for row in table.rows)
    return text.getvalue()


def _bare(cell: Cell) -> Cell:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _plain_table(table: Table) -> str:
    rows = [table.heading, *table.shown()]
    widths = [max(len(row[column]) for row in rows) for column in range(len(table.heading))]
    lines = [_plain_row(table, row, widths) for row in rows]
    rule = "  ".join("-" * width for width in widths)
    return "\n".join([table.caption, lines[0], rule, *lines[1:]])


def _plain_row(table: Table, row: Sequence[str], widths: Sequence[int]) -> str:
    cells = (
        cell.rjust(width) if table.is_numeric(column) else cell.ljust(width)
        for column, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return "  ".join(cells).rstrip()


def _markdown_table(table: Table) -> str:
    rules = ["---:" if table.is_numeric(column) else "---" for column in range(len(table.heading))]
    rows = [table.heading, *table.shown()]
    lines = [f"| {' | '.join(_markdown(cell) for cell in row)} |" for row in rows]
    lines.insert(1, f"| {' | '.join(rules)} |")
    return "\n".join([f"**{_markdown(table.caption)}** ([CSV]({table.name}.csv))", "", *lines])


def _html_table(table: Table) -> str:
    def row(cells: Iterable[str], tag: str) -> str:
        return "<tr>" + "".join(cell(tag, column, text) for column, text in enumerate(cells)) + "</tr>"

    def cell(tag: str, column: int, text: str) -> str:
        kind = ' class="number"' if table.is_numeric(column) else ""
        return f"<{tag}{kind}>{escape(text)}</{tag}>"

    body = "\n".join(row(cells, "td") for cells in table.shown())
    return (
        f'<div class="wide">\n<table>\n<caption>{escape(table.caption)}</caption>\n'
        f"<thead>{row(table.heading, 'th')}</thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>\n"
        f'<p class="file"><a href="{table.name}.csv">{table.name}.csv</a></p>'
    )


def _markdown(text: str) -> str:
    """A text on one line, with everything escaped that Markdown would take for its own within a line."""
    return re.sub(r"[\\`*<>\[\]|&~]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\\\g<0>", " ".join(text.split()))


def _markdown_paragraph(text: str) -> str:
    """A text as a paragraph: it also begins no list, heading or rule."""
    escaped = _markdown(text)
    if re.match(r"\d+[.)]( |$)", escaped):
        return re.sub(r"[.)]", r"\\\g<0>", escaped, count=1)
    return f"\\{escaped}" if escaped.startswith(("-", "+", "=", "#")) else escaped
