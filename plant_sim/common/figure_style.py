"""Style of all figures: colour-blind-safe colours, text, and files without timestamps."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from controller.common.document.parts import Drawing
from controller.common.errors import InputError
from plant_sim.common.picture_form import DPI, PictureForm
from plant_sim.common.proportion import Proportion
from plant_sim.common.provenance.provenance import KEY, Provenance
from plant_sim.common.whole_file import write_whole

COLOURS: Final[Mapping[str, str]] = {
    "left": "#0072B2",
    "right": "#D55E00",
    "machine": "#444444",
    "supply": "#009E73",
    "alarms": "#AA0044",
    "faults": "#7A5195",
}
"""Colours by use, mainly from the palette of Okabe and Ito for colour-blind readers."""

SERIES: Final = ("#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#444444", "#0072B2", "#D55E00", "#999933")
"""Colours of traces that do not belong to an arm, in order of use."""

QUIET: Final = "#666666"

STYLE: Final[dict[Any, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "svg.hashsalt": "seedling transplanter",
    "svg.fonttype": "none",  # text remains text, which can be searched and edited
    "pdf.fonttype": 42,  # TrueType fonts, embedded; journals refuse Type 3
}
"""Matplotlib settings for drawing and saving."""


_METADATA: Final[Mapping[str, Mapping[str, None]]] = {
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    ".png": {"Software": None},
    ".svg": {"Date": None},
}
"""Metadata to omit, by file format."""
_FIELDS: Final[Mapping[str, str]] = {".pdf": "Subject", ".png": KEY, ".svg": "Description"}
"""Field of the metadata that carries the provenance, by file format; SVG and PDF have none of their own for it."""
_HYPHEN_MINUS: Final = re.compile(r"(?<![\w.,)-])-(?=\.?\d)|(?<=\de)-(?=\d)")
"""Hyphen that stands for the minus sign of a number."""


class FigureError(InputError):
    """A figure cannot be written; the one-line message states the file, the problem and the remedy."""


def draw_proportions(
    axes: Axes, positions: Sequence[float], proportions: Sequence[Proportion], *, fmt: str, color: str, **style: Any
) -> None:
    """Draw proportions in percent over positions, with bars that show their exact 95 % intervals.

    Args:
        axes: Axes of a figure.
        positions: Positions on the axis of abscissae.
        proportions: Proportion at each position.
        fmt: Marker and line, as in `Axes.errorbar`.
        color: Colour.
        **style: Further properties of `Axes.errorbar`.
    """
    percent = [each.percent for each in proportions]
    bars = np.array([each.interval_percent for each in proportions]).T - percent
    axes.errorbar(
        positions, percent, np.maximum(0.0, bars * [[-1], [1]]), fmt=fmt, color=color, elinewidth=0.6, **style
    )


@contextmanager
def drawing() -> Iterator[None]:
    """Apply the style to figures drawn in a `with` block, regardless of the user's matplotlib settings."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def save(
    figure: Drawing, stem: Path, provenance: Provenance | None = None, form: PictureForm | None = None
) -> list[Path]:
    """Write a figure in every file format of a form; equal figures give identical bytes.

    Args:
        figure: Figure to write.
        stem: Path without suffix.
        provenance: Provenance that the files carry.
        form: File formats and resolution; None = PNG and SVG.

    Returns:
        The files.

    Raises:
        FigureError: A file cannot be written.
    """
    form = form or PictureForm()
    paths = [stem.with_name(f"{stem.name}.{ending}") for ending in form.formats]
    for path in paths:
        save_as(figure, path, provenance, dpi=form.dpi)
    return paths


def save_as(figure: Drawing, path: Path, provenance: Provenance | None = None, *, dpi: int = DPI) -> None:
    """Write a figure as PNG, SVG or PDF, depending on the suffix; equal figures give identical bytes.

    Negative numbers in its texts are given minus signs.

    Raises:
        FigureError: The file cannot be written.
    """
    metadata: dict[str, str | None] = {**_METADATA[path.suffix]}
    if provenance is not None:
        metadata[_FIELDS[path.suffix]] = provenance.text
    if isinstance(figure, Figure):
        _set_minus_signs(figure)
    write_whole(path, lambda part: figure.savefig(part, dpi=dpi, metadata=metadata), FigureError)


def with_minus_signs(text: str) -> str:
    """Return a text with minus signs in place of the hyphens of negative numbers.

    >>> with_minus_signs("from -0.5 to 20-30, 2026-11-29, 1e-05")
    'from \u22120.5 to 20-30, 2026-11-29, 1e\u221205'
    """
    return _HYPHEN_MINUS.sub("\N{MINUS SIGN}", text)


def _set_minus_signs(figure: Figure) -> None:
    for text in figure.findobj(Text):
        if isinstance(text, Text):
            text.set_text(with_minus_signs(text.get_text()))
