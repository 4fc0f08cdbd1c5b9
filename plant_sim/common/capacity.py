"""Largest numbers of a trial, which options and files have in common."""

from typing import Final

MOST_TRAYS: Final = 1_000
"""Capacity of the magazine."""
MOST_SEEDLINGS: Final = 72 * MOST_TRAYS
"""Seedlings of a full magazine."""
