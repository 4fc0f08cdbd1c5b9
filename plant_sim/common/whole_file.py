"""Files that are written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from controller.common.errors import InputError


def write_whole(path: Path, write: Callable[[Path], object], error_type: type[InputError] = InputError) -> None:
    """Write a file completely or not at all.

    Args:
        path: File to write; an existing file is replaced.
        write: Function that writes a temporary file with the same suffix.
        error_type: Type of the exception raised if the file cannot be written.

    Raises:
        InputError: The file cannot be written.
    """
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    try:
        write(part)
        os.replace(part, path)
    except OSError as error:
        raise error_type(f"{path}: cannot be written ({error.strerror}); specify another path") from None
    finally:
        with suppress(OSError):
            part.unlink()
