"""Rendering of a document as plain text, Markdown and HTML, of a table as CSV, and their files."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path

from controller.common.document.parts import Heading, InlineDrawing, Part, Picture, ShellCommand, Table, listing

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
img, figure svg { max-width: 100%; height: auto; }
pre { background: #f4f4f4; padding: .6rem .8rem; overflow-x: auto; }
"""

_FORMULA_STARTS = tuple("=+-@\t\r\n＝＋－＠")
"""First characters of a cell that a spreadsheet program executes as a formula, in some languages wide signs too."""
_SIGNED_NUMBER = re.compile(r"[+-]([0-9]+(\.[0-9]*)?(e[+-]?[0-9]+)?)?", re.IGNORECASE)
"""Signed number, or a sign alone, which is no formula."""


def plain_text(title: str, parts: Iterable[Part]) -> str:
    """Return a document as plain text, with the names and captions of the pictures."""
    blocks = [f"{title}\n{'=' * len(title)}"]
    for part in parts:
        match part:
            case Heading(text):
                blocks.append(f"{text}\n{'-' * len(text)}")
            case Table():
                blocks.append(_plain_table(part))
            case Picture():
                blocks.append(f"[picture {part.name}: {part.caption}]")
            case InlineDrawing(caption):
                blocks.append(f"[picture: {caption}]")
            case ShellCommand(text) | str(text):
                blocks.append(text)
    return "\n\n".join(blocks)


def markdown(title: str, parts: Iterable[Part], *, is_literal: bool = True) -> str:
    """Return a document as Markdown with links to pictures and CSV files in the same folder.

    Args:
        title: Title.
        parts: Parts after the title.
        is_literal: Whether Markdown in texts is escaped; otherwise only vertical bars in tables are.
    """
    literal = _escaped if is_literal else str
    blocks = []
    for part in (Heading(title, 1), *parts):
        match part:
            case Heading(text, level):
                blocks.append(f"{'#' * level} {literal(text)}")
            case ShellCommand(text):
                blocks.append(f"```sh\n{text}\n```")
            case Table():
                blocks.append(_markdown_table(part, _escaped if is_literal else _without_bars))
            case Picture():
                blocks.append(_markdown_picture(part, literal(part.caption)))
            case InlineDrawing(caption):
                blocks.append(literal(caption))
            case str():
                blocks.append(_escaped_paragraph(part) if is_literal else part)
    return "\n\n".join(blocks) + "\n"


def reference_table(heading: Iterable[str], *rows: Iterable[object]) -> str:
    """Return a table of texts in Markdown, without spaces in its rule; only vertical bars are escaped."""
    return _markdown_table(listing(heading, rows), _without_bars, is_tight=True) + "\n"


def html(title: str, parts: Iterable[Part], *, meta: Mapping[str, str] | None = None) -> str:
    """Return a document as one HTML page that depends only on the pictures in the same folder.

    Args:
        title: Title.
        parts: Parts after the title.
        meta: Contents of further meta elements by name.
    """
    blocks = []
    for part in (Heading(title, 1), *parts):
        match part:
            case Heading(text, level):
                name = f' id="{part.anchor}"' if level > 1 else ""
                blocks.append(f"<h{level}{name}>{escape(text)}</h{level}>")
            case ShellCommand(text):
                blocks.append(f"<pre>{escape(text)}</pre>")
            case Table():
                blocks.append(_html_table(part))
            case Picture():
                blocks.append(_html_picture(part))
            case InlineDrawing(caption, svg):
                blocks.append(f"<figure>\n{svg}<figcaption>{escape(caption)}</figcaption>\n</figure>")
            case str():
                blocks.append(f"<p>{escape(part)}</p>")
    named = "".join(f'<meta name="{escape(name)}" content="{escape(text)}">\n' for name, text in (meta or {}).items())
    head = (
        '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{named}<title>{escape(title)}</title>\n<style>\n{_STYLE}</style>"
    )
    body = "\n".join(blocks)
    return f'<!doctype html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n</body>\n</html>\n'


def csv_text(heading: Iterable[str], rows: Iterable[Iterable[object]], *, end: str = "\n") -> str:
    """Return a table as CSV with all digits and no formula; None and a number that is not finite are empty cells."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator=end)
    writer.writerow(map(csv_cell, heading))
    writer.writerows(
        [None if isinstance(cell, float) and not math.isfinite(cell) else csv_cell(cell) for cell in row]
        for row in rows
    )
    return text.getvalue()


def csv_cell(value: object) -> object:
    """Return a value for a cell of a CSV file that a spreadsheet program may open; a text never becomes a formula.

    A text that would be one begins with an apostrophe, which these programs take for the mark of a text. Numbers stay
    numbers, also as texts. Files that only a programming tool of a PLC reads are written without this protection.

    >>> [csv_cell(value) for value in ("=1+1", "-valve", "-5.0e3", -5, "valve")]
    ["'=1+1", "'-valve", '-5.0e3', -5, 'valve']
    """
    is_formula = isinstance(value, str) and value.startswith(_FORMULA_STARTS) and not _SIGNED_NUMBER.fullmatch(value)
    return f"'{value}" if is_formula else value


def aligned(rows: Sequence[Sequence[str]], right: Collection[int] = ()) -> list[str]:
    """Return rows as lines with aligned columns.

    Args:
        rows: Cells, row by row.
        right: Numbers of the right-aligned columns, from 0.

    >>> aligned([("a", "1", "one"), ("bc", "10", "ten")], right=[1])
    ['a    1  one', 'bc  10  ten']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    forms = [f"{'>' if number in right else '<'}{width}" for number, width in enumerate(widths)]
    return ["  ".join(map(format, cells, forms)).rstrip() for cells in rows]


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write texts to a folder, which is created, by file name; return the files.

    Raises:
        OSError: The folder is not writable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return [folder / name for name in texts]


def _plain_table(table: Table) -> str:
    rows = [table.heading, *table.shown()]
    rule = ["-" * max(map(len, cells)) for cells in zip(*rows, strict=True)]
    right = [column for column in range(len(rule)) if table.is_numeric(column)]
    caption = [table.caption] if table.name else []
    return "\n".join([*caption, *aligned([rows[0], rule, *rows[1:]], right)])


def _markdown_table(table: Table, literal: Callable[[str], str], *, is_tight: bool = False) -> str:
    rules = ["---:" if table.is_numeric(column) else "---" for column in range(len(table.heading))]
    rows = [[literal(cell) for cell in row] for row in (table.heading, *table.shown())]
    lines = [f"| {' | '.join(cells)} |" for cells in (rows[0], rules, *rows[1:])]
    if is_tight:
        lines[1] = lines[1].replace(" ", "")
    caption = [f"**{literal(table.caption)}** ([CSV]({table.name}.csv))", ""] if table.name else []
    return "\n".join([*caption, *lines])


def _markdown_picture(picture: Picture, caption: str) -> str:
    """Return a picture with links to its other formats and its data; PDF alone is only linked."""
    shown = picture.shown_file("png", "svg")
    others = [each for each in picture.formats if f"{picture.name}.{each}" != shown or each == "pdf"]
    links = [*(f"[{each.upper()}]({picture.name}.{each})" for each in others), f"[data]({picture.data_file})"]
    image = "" if shown.endswith(".pdf") else f"![{caption}]({shown})\n\n"
    return f"{image}{caption} ({', '.join(links)})"


def _html_picture(picture: Picture) -> str:
    """Return a picture with links to its other formats and its data; PDF alone is only linked."""
    caption, shown = escape(picture.caption), picture.shown_file("svg", "png")
    files = [f"{picture.name}.{each}" for each in picture.formats]
    if shown.endswith(".pdf"):
        image = ""
    else:
        image = f'<img src="{shown}" alt="{caption}">\n'
        files.remove(shown)
    links = " ".join(f'<a href="{name}">{name}</a>' for name in (*files, picture.data_file))
    return f'<figure>\n{image}<figcaption>{caption}</figcaption>\n</figure>\n<p class="file">{links}</p>'


def _html_table(table: Table) -> str:
    def row(cells: Iterable[str], tag: str, heading: Heading | None = None) -> str:
        return "<tr>" + "".join(cell(tag, column, text, heading) for column, text in enumerate(cells)) + "</tr>"

    def cell(tag: str, column: int, text: str, heading: Heading | None) -> str:
        kind = ' class="number"' if table.is_numeric(column) else ""
        shown = f"<strong>{escape(text)}</strong>" if text in table.strong else escape(text)
        if heading is not None and column == 0:
            shown = f'<a href="#{heading.anchor}">{shown}</a>'
        return f"<{tag}{kind}>{shown}</{tag}>"

    headings = table.headings or (None,) * len(table.rows)
    body = "\n".join(row(cells, "td", heading) for cells, heading in zip(table.shown(), headings, strict=True))
    caption = f"<caption>{escape(table.caption)}</caption>\n" if table.name else ""
    file = f'\n<p class="file"><a href="{table.name}.csv">{table.name}.csv</a></p>' if table.name else ""
    return (
        f'<div class="wide">\n<table>\n{caption}<thead>{row(table.heading, "th")}</thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table>\n</div>{file}"
    )


def _escaped(text: str) -> str:
    """Return text on one line with inline Markdown escaped."""
    return re.sub(r"[\\`*<>\[\]|&~]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\\\g<0>", " ".join(text.split()))


def _escaped_paragraph(text: str) -> str:
    """Return text as a Markdown paragraph, with list, heading and rule markers escaped."""
    escaped = _escaped(text)
    if re.match(r"\d+[.)]( |$)", escaped):
        return re.sub(r"[.)]", r"\\\g<0>", escaped, count=1)
    return f"\\{escaped}" if escaped.startswith(("-", "+", "=", "#")) else escaped


def _without_bars(text: str) -> str:
    return text.replace("|", "\\|")
