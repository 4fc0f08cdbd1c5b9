"""Account of the seedlings in the record of a trial."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def account_of(record: Mapping[str, Any]) -> tuple[int, int, int, int, int]:
    """Return seedlings, those in cups, in claws, in trays untouched and ploughed, after a check of their sum."""
    kept = tuple(record[name] for name in ("in_cups", "in_claws", "in_trays_untouched", "in_trays_ploughed"))
    assert sum(kept) + record["P"] + record["D"] + record["T"] == record["seedlings"]
    return (record["seedlings"], *kept)
