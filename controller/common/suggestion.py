"""Remedies for unknown words."""

import difflib
from collections.abc import Iterable


def suggestion(word: str, known: Iterable[str], default: str = "") -> str:
    """Return a remedy for an unknown word: the closest known word, otherwise `default` or the list of known words.

    >>> suggestion("adress", ["tag", "address"])
    'did you mean address?'
    >>> suggestion("colour", ["tag", "address"])
    'use one of tag, address'
    """
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1)
    if near:
        return f"did you mean {near[0]}?"
    return default or f"use one of {', '.join(known)}"
