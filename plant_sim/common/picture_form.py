"""Form of the pictures of a result: their file formats and the resolution of the raster format."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Final

from controller.common.document.parts import PICTURE_FORMATS
from controller.common.errors import InputError

FORMATS: Final = ("pdf", "png", "svg")
"""File formats of a picture."""
DPI: Final = 150
"""Default resolution of PNG files, dots per inch."""
LEAST_DPI: Final = 50
MOST_DPI: Final = 1200
"""Largest resolution that can be set, dots per inch; `LEAST_DPI` is the smallest. Journals ask for 300 to 1200."""

PICTURE_OPTIONS: Final = ("format", "dpi")
"""Options that state the form of the pictures."""


@dataclass(frozen=True, slots=True)
class PictureForm:
    """Form of the pictures of a result.

    Attributes:
        formats: File formats, among `FORMATS`.
        dpi: Resolution of PNG files, dots per inch.
    """

    formats: tuple[str, ...] = PICTURE_FORMATS
    dpi: int = DPI


def formats_of(text: str) -> str:
    """Return a list of file formats, ``pdf,svg``, as an option states it, in the order of `FORMATS`.

    Raises:
        ArgumentTypeError: A name is not a file format of a picture.
    """
    names = [each.strip().lower() for each in text.split(",")]
    unknown = [each for each in names if each not in FORMATS]
    if unknown:
        raise argparse.ArgumentTypeError(f"{unknown[0]!r} is not a format; write {', '.join(FORMATS)}, or several")
    return ",".join(each for each in FORMATS if each in names)


def picture_form(options: argparse.Namespace) -> PictureForm:
    """Return the form that the options ``--format`` and ``--dpi`` state, with the defaults for missing options."""
    return PictureForm(
        PICTURE_FORMATS if options.format is None else tuple(options.format.split(",")),
        DPI if options.dpi is None else options.dpi,
    )


def check_picture_options(options: argparse.Namespace) -> None:
    """Check that the options of the pictures have an effect.

    Raises:
        InputError: No file is written, or a resolution is given for files that are not PNG.
    """
    for name in PICTURE_OPTIONS:
        if getattr(options, name) is not None and options.out is None:
            raise InputError(f"--{name}: has no effect without --out; add --out or omit it")
    if options.dpi is not None and options.format is not None and "png" not in options.format:
        raise InputError(f"--dpi: has no effect with --format {options.format}; add png or omit it")
