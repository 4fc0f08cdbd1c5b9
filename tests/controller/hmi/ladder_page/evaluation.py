"""END values of a program evaluated from devices that a foreign client has read: contacts, coils and their power."""

from __future__ import annotations

import re
from collections.abc import Callable

from controller.fx.language.instruction import Ladder

_JOINS = re.compile(r"(LD|AND|AN|OR)(I|P|F)?")
_COILS = ("OUT", "SET", "RST")


def end_states(ladder: Ladder, is_on: Callable[[str], bool]) -> dict[int, str]:
    """Return the expected state of each contact and coil of bits that does not lie in a zone of master control.

    Args:
        ladder: The program.
        is_on: Function that returns whether the device of a name is on at END.
    """
    states: dict[int, str] = {}
    active, joining = True, False
    for at, instruction in enumerate(ladder.instructions):
        name, names = instruction.name, [str(operand) for operand in instruction.operands]
        if name == "STL":
            active = (active and is_on(names[0])) if joining else is_on(names[0])
            states[at] = "on" if active else "off"
        elif name == "RET":
            active = True
        joining = name == "STL"
        if not names or re.fullmatch(r"[XYMSTC]\d+", names[0]) is None:
            continue
        contact = _JOINS.fullmatch(name)
        if contact is not None and len(names) == 1:
            if not active:
                states[at] = "not-executed"
            elif contact[2] in ("P", "F"):
                states[at] = "unknown"
            else:
                states[at] = "on" if is_on(names[0]) != (contact[2] == "I") else "off"
        elif name in _COILS and names[0][0] not in "TC":
            states[at] = "on" if is_on(names[0]) else "off"
    return states
