"""SVG pictures: black lines and monospaced text on white."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final
from xml.sax.saxutils import escape, quoteattr

CHARACTER_WIDTH: Final = 6.1
"""Width of a character at `FONT_SIZE`, px; monospaced fonts are 0.6 em wide (from memory)."""
FONT_SIZE: Final = 10

_STYLE: Final = (
    "line,polyline,rect,path{stroke:#000;stroke-width:1.2;fill:none}"
    "g.grid line{stroke:#bbb;stroke-width:0.6}rect.band{fill:#e8e8e8}rect.paper{fill:#fff;stroke:none}circle{fill:#000}"
    f"text{{font-family:monospace;font-size:{FONT_SIZE}px;fill:#000}}text.note{{fill:#555}}text.title{{font-weight:bold}}"
)


REPLACEMENT: Final = "\N{REPLACEMENT CHARACTER}"
_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _plain(text: str) -> str:
    """Escape text for XML and replace invalid characters."""
    return escape(_NOT_XML.sub(REPLACEMENT, text))


class SvgPicture:
    """Canvas for lines, boxes and text, in pixels, with x to the right and y down."""

    def __init__(self) -> None:
        """Create an empty canvas."""
        self._parts: list[str] = []

    def line(self, x1: float, y1: float, x2: float, y2: float) -> None:
        """Draw a line."""
        self._parts.append(f'<line x1="{x1:g}" y1="{y1:g}" x2="{x2:g}" y2="{y2:g}"/>')

    def path(self, points: Iterable[tuple[float, float]], *, arrow: bool = False) -> None:
        """Draw a polyline, optionally with an arrowhead at its end."""
        text = " ".join(f"{x:g},{y:g}" for x, y in points)
        end = ' marker-end="url(#arrow)"' if arrow else ""
        self._parts.append(f'<polyline points="{text}"{end}/>')

    def box(self, x: float, y: float, width: float, height: float, kind: str = "") -> None:
        """Draw a rectangle; kind is "", "band" or "paper"."""
        css_class = f' class="{kind}"' if kind else ""
        self._parts.append(f'<rect{css_class} x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"/>')

    def arc(self, x: float, y: float, bulge: float, height: float) -> None:
        """Draw one of the two arcs of a coil symbol, centred at `y`; it bulges to the left if `bulge` is negative."""
        half = height / 2
        self._parts.append(f'<path d="M{x:g} {y - half:g} q{bulge:g} {half:g} 0 {height:g}"/>')

    def dot(self, x: float, y: float) -> None:
        """Draw a junction dot."""
        self._parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="2"/>')

    def text(self, x: float, y: float, text: str, kind: str = "", *, middle: bool = False) -> None:
        """Write text on a baseline; kind is "", "note" or "title"."""
        attributes = (f' class="{kind}"' if kind else "") + (' text-anchor="middle"' if middle else "")
        self._parts.append(f'<text{attributes} x="{x:g}" y="{y:g}">{_plain(text)}</text>')

    @contextmanager
    def group(self, kind: str, **attributes: str) -> Iterator[None]:
        """Put everything drawn in a `with` block into one SVG group with the given class."""
        named = "".join(f" {name}={quoteattr(_NOT_XML.sub(REPLACEMENT, value))}" for name, value in attributes.items())
        self._parts.append(f'<g class="{kind}"{named}>')
        yield
        self._parts.append("</g>")

    def title(self, text: str) -> None:
        """Give the group that is open a text that is shown with the pointer on it."""
        self._parts.append(f"<title>{_plain(text)}</title>")

    def fragment(self) -> str:
        """Return the elements of the picture without the file around them."""
        return "\n".join(self._parts)

    def svg(self, width: float, height: float, title: str, style: str = "") -> str:
        """Return the picture as the text of an SVG file; `style` is added to its style sheet."""
        size = f'width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}"'
        arrow = (
            '<defs><marker id="arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7"'
            ' orient="auto"><path d="M0 0 L8 4 L0 8 z" style="fill:#000"/></marker></defs>'
        )
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" {size}>',
            f"<title>{_plain(title)}</title>",
            f"<style>{_STYLE}{style}</style>",
            arrow,
            f'<rect class="paper" x="0" y="0" width="{width:g}" height="{height:g}"/>',
        )
        return "\n".join([*head, *self._parts, "</svg>"]) + "\n"
