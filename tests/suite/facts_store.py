"""Facts of source files, kept between runs, because reading a thousand syntax trees takes seconds."""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Final

from tests.paths import ROOT
from tests.suite import facts
from tests.suite.facts import Facts, facts_of

STORE: Final = ROOT / ".pytest_cache" / "facts.pickle"
_VERSION: Final = Path(facts.__file__).read_bytes()


def facts_of_all(sources: Mapping[str, str], store: Path | None) -> dict[str, Facts]:
    """Return the facts of source files, given as texts by path; those of an unchanged file are taken from the store.

    The store holds the facts of the latest call. A store that cannot be read or written is ignored.

    Raises:
        SyntaxError: A text is not valid Python.
    """
    kept = {} if store is None else _read(store)
    keys = {path: _key(path, text) for path, text in sources.items()}
    found = {path: kept.get(keys[path]) or facts_of(PurePosixPath(path), text) for path, text in sources.items()}
    if store is not None and kept.keys() != {*keys.values()}:
        _write(store, {keys[path]: own for path, own in found.items()})
    return found


def _key(path: str, text: str) -> bytes:
    """Return what the facts of a file follow from: path, text, and the module that takes them from the text."""
    return hashlib.sha256(b"\0".join((_VERSION, path.encode(), text.encode()))).digest()


def _read(store: Path) -> dict[bytes, Facts]:
    with suppress(OSError, pickle.UnpicklingError, EOFError, AttributeError):
        kept: dict[bytes, Facts] = pickle.loads(store.read_bytes())  # noqa: S301  written by this module only
        return kept
    return {}


def _write(store: Path, kept: Mapping[bytes, Facts]) -> None:
    """Replace the store in one step, because several processes may read and write it."""
    new = store.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        store.parent.mkdir(exist_ok=True)
        new.write_bytes(pickle.dumps(dict(kept)))
        new.replace(store)
