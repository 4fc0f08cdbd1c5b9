"""Statements of what was fitted to what, for the first page of a report of the twin."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from pathlib import Path

from plant_sim.machine.parameters import Machine, load_machine

_MOST_LISTED = 5


def origin_parts(machine: Machine, file: Path | None = None) -> list[str]:
    """Return the paragraphs that name what the seedlings of a machine were fitted to, and how the machine was changed.

    Args:
        machine: Base machine of the study.
        file: File of the machine; None for the delivered one.
    """
    return [
        *changed_parts(machine, file),
        "What was fitted to what: the constants of the twin's seedlings were fitted to equation 5 and to the "
        "statements of the pepper paper on single factors, in the motion of the delivered machine (study calibration); "
        "equation 5 was fitted to Table 4. Agreement of the twin with any of these is in-sample: it shows that "
        "complete trials keep the calibration, and does not confirm the paper. Hold-out tests are in "
        "docs/statistics.md.",
    ]


def changed_parts(machine: Machine, file: Path | None = None) -> list[str]:
    """Return the paragraph that names how a machine was changed; empty for the delivered machine.

    Args:
        machine: Base machine of the result.
        file: File of the machine; None for the delivered one.
    """
    changed = changed_keys(machine)
    if not changed:
        return []
    listed = ", ".join(changed[:_MOST_LISTED])
    more = f" and {len(changed) - _MOST_LISTED} others" if len(changed) > _MOST_LISTED else ""
    named = "" if file is None else f" ({file})"
    differs = "differs" if len(changed) == 1 else "differ"
    return [
        f"Changed machine{named}: {listed}{more} {differs} from the delivered machine, for which the seedlings were "
        "fitted. Equation 5, Table 4 and the statements of the paper belong to the machine of the paper: differences "
        "from them are effects of the change and of the fit together."
    ]


def changed_keys(machine: Machine) -> list[str]:
    """Return the parameters of a machine that differ from the delivered one, dotted."""
    delivered = _delivered()
    sections = [each.name for each in fields(machine)]
    return [
        f"{section}.{each.name}"
        for section in sections
        for each in fields(getattr(machine, section))
        if getattr(getattr(machine, section), each.name) != getattr(getattr(delivered, section), each.name)
    ]


@cache
def _delivered() -> Machine:
    return load_machine()
