"""Variables of a program in Structured Text: names, types, addresses and declarations.

Addresses of a target without limits: X and Y use the octal label as byte and bit (X12 is %IX1.2), M starts at %MX0.0,
S at %MX1100.0, D at %MW1000. These ranges do not overlap on platforms where %MX counts bytes and %MW counts words of
the same area (general knowledge); platforms where both count bytes need other addresses. Special relays and registers,
timers and counters have no address. A runtime with a smaller memory has an address function of its own.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.devices import INITIAL_PULSE, RUN_MONITOR, device_name, is_32_bit_counter, is_retentive
from controller.core.expr import Bit, Word
from controller.core.program import Program

S_BYTE: Final = 1100
"""Byte of S0, after M0 to M3071."""
D_WORD: Final = 1000
"""Word of D0, after S999."""
SPECIAL: Final = 8000
"""Number of the first special relay and register."""

CLOCK: Final = "now_ms"
"""Variable with the time of the scan."""
INDENT: Final = "    "
_ORDER: Final = "XYMSTCD"

_WORDS: Final = """
ABS ACOS ACTION ADD AND ANY ARRAY ASIN AT ATAN BEGIN BOOL BY BYTE CASE CLASS CONCAT CONFIGURATION CONSTANT CONTINUE
COS CTD CTU CTUD DATE DELETE DINT DIV DO DT DWORD ELSE ELSIF EN END ENO EQ EXIT EXP EXPT EXTENDS FALSE FIND FINAL FOR
FROM FUNCTION FUNCTION_BLOCK F_EDGE F_TRIG GE GT IF IMPLEMENTS INITIAL_STEP INSERT INT INTERFACE INTERNAL INTERVAL JMP
LD LDATE LE LEFT LEN LIMIT LINT LN LOG LREAL LT LTIME LWORD MAX METHOD MID MIN MOD MOVE MUL MUX NAMESPACE NE
NON_RETAIN NOT NULL OF ON OR OVERLAP OVERRIDE PRIORITY PRIVATE PROGRAM PROTECTED PUBLIC R READ_ONLY READ_WRITE REAL
REF REPEAT REPLACE RESOURCE RET RETAIN RETURN RIGHT ROL ROR RS R_EDGE R_TRIG S SEL SHL SHR SIN SINGLE SINT SQRT SR ST
STEP STL STRING STRUCT SUB SUPER T TAN TASK THEN THIS TIME TO TOD TOF TON TP TRANSITION TRUE TRUNC TYPE UDINT UINT
ULINT UNION UNTIL USING USINT VAR WCHAR WHILE WITH WORD WSTRING XOR
"""
RESERVED: Final = frozenset(_WORDS.split())
"""Words that are not valid variable names: keywords, types and standard functions."""


def identifier(text: str) -> str:
    """Convert a text to an IEC 61131-3 identifier: letters, digits and single underscores.

    Examples:
        >>> identifier("left arm: approach row"), identifier("2nd"), identifier("step")
        ('left_arm_approach_row', 'v_2nd', 'v_step')
    """
    plain = re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_")
    return plain if plain and not plain[0].isdigit() and plain.upper() not in RESERVED else f"v_{plain}".rstrip("_")


def address(kind: str, number: int) -> str:
    """Return the address of a device, or an empty text if it has none.

    Examples:
        >>> address("X", 0o12), address("M", 500), address("S", 900), address("D", 8), address("T", 0)
        ('%IX1.2', '%MX62.4', '%MX1212.4', '%MW1008', '')
    """
    byte, bit = divmod(number, 8)
    if number >= SPECIAL or kind in "TC":
        return ""
    if kind == "D":
        return f"%MW{D_WORD + number}"
    area, first = {"X": ("I", 0), "Y": ("Q", 0), "M": ("M", 0), "S": ("M", S_BYTE)}[kind]
    return f"%{area}X{first + byte}.{bit}"


@dataclass(frozen=True, slots=True)
class Variable:
    """Variable declaration.

    Attributes:
        name: Variable name.
        type: IEC type.
        address: IEC address; empty = assigned by the platform.
        first: Initial value; empty = default of the type.
        retain: Whether the value is retained through a loss of power.
        comment: FX device and meaning.
    """

    name: str
    type: str
    address: str = ""
    first: str = ""
    retain: bool = False
    comment: str = ""

    def __str__(self) -> str:
        location = f" AT {self.address}" if self.address else ""
        first = f" := {self.first}" if self.first else ""
        comment = f" (* {plain(self.comment)} *)" if self.comment else ""
        return f"{self.name}{location} : {self.type}{first};{comment}"


def plain(text: str) -> str:
    """Convert a text to a form that is valid in a comment."""
    return text.replace("(*", "( *").replace("*)", "* )").encode("ascii", "replace").decode()


class Variables:
    """Variables of the program; names are unique regardless of case."""

    def __init__(
        self,
        program: Program,
        locate: Callable[[str, int], str] = address,
        outputs: Mapping[int, bool] | None = None,
        *,
        retain: bool = True,
    ) -> None:
        """Name the devices of a program.

        Args:
            program: The program.
            locate: Function that returns the address of a device, or an empty text if it has none.
            outputs: Raw levels of the outputs before the first scan, by number; None = all off.
            retain: False if the target does not retain variables.
        """
        self._retain = retain
        self._locate = locate
        self._outputs = outputs or {}
        self._used_names = {"NOW_MS"}
        self._devices: dict[tuple[str, int, bool], Variable] = {}
        self._helpers: dict[str, Variable] = {}
        self._first = {(word.kind, word.number): value for word, value in program.set_points}
        self._constants = {(word.kind, word.number) for word in program.constants}
        self._named: dict[tuple[str, int], Bit | Word] = {}
        devices = [*program.devices(), *program.retentive]
        for device in devices:
            known = self._named.setdefault((device.kind, device.number), device)
            if device.name and not known.name:
                self._named[device.kind, device.number] = device
        for device in sorted(devices, key=lambda d: (_ORDER.index(d.kind), d.number)):
            self.device(device)

    def device(self, device: Bit | Word) -> str:
        """Return the variable name of a device, for its contact or its value."""
        value = isinstance(device, Word)
        key = (device.kind, device.number, value)
        if key not in self._devices:
            self._devices[key] = self._declaration(*key)
        return self._devices[key].name

    def has_value(self, kind: str, number: int) -> bool:
        """Return whether the current value of a timer or counter is used or retained."""
        return (kind, number, True) in self._devices

    def helper(self, name: str, type_: str = "BOOL", first: str = "") -> str:
        """Return the name of a helper variable that has no device, and declare it on first use."""
        if name not in self._helpers:
            self._helpers[name] = Variable(self._unique(name), type_, first=first)
        return self._helpers[name].name

    def add(self, variable: Variable) -> str:
        """Declare a variable of a runtime part and return its name.

        Raises:
            ValueError: The name is already used.
        """
        if variable.name.upper() in self._used_names:
            raise ValueError(f"{variable.name}: already the name of a variable")
        self._used_names.add(variable.name.upper())
        self._helpers[variable.name] = variable
        return variable.name

    def own_clock(self, first_ms: int) -> None:
        """Declare the time of the scan as a variable that the program advances, instead of an input."""
        self._helpers[CLOCK] = Variable(CLOCK, "LINT", first=str(first_ms), comment="time of the scan, ms")

    def memory(self, name: str) -> str:
        """Declare a new BOOL variable that has no device, and return its name."""
        unique = self._unique(name)
        self._helpers[unique] = Variable(unique, "BOOL")
        return unique

    def all(self) -> tuple[Variable, ...]:
        """Return all declared variables."""
        return (*self._devices.values(), *self._helpers.values())

    def sections(self) -> Iterator[str]:
        """Yield the declarations, section by section."""
        if CLOCK not in self._helpers:
            yield f"VAR_INPUT\n    {CLOCK} : LINT; (* scan time in ms; must never decrease *)\nEND_VAR"
        for retain in (False, True):
            for located in (True, False):
                lines = [
                    f"{INDENT}{variable}"
                    for variable in self.all()
                    if variable.retain == retain and bool(variable.address) == located
                ]
                if lines:
                    yield "\n".join([f"VAR{' RETAIN' * retain}", *lines, "END_VAR"])

    def _declaration(self, kind: str, number: int, value: bool) -> Variable:
        named = self._named.get((kind, number))
        fx_name = device_name(kind, number)
        tag, meaning = (named.name, named.comment) if named is not None else ("", "")
        label = identifier(tag or fx_name.lower())
        variable = f"{label}_value" if value and kind in "TC" else label
        first = "TRUE" if kind == "M" and number in (RUN_MONITOR, INITIAL_PULSE) else ""
        if (kind, number) in self._first:
            first = str(self._first[kind, number])
        if kind == "Y" and self._outputs.get(number):
            first = "TRUE"
        return Variable(
            name=self._unique(variable, fx_name.lower()),
            type=type_of(kind, number) if value else "BOOL",
            address=self._locate(kind, number),
            first=first,
            # like the soft PLC, the exported program starts without an active state
            retain=self._retain
            and kind != "S"
            and is_retentive(kind, number)
            and (kind, number) not in self._constants,
            comment=": ".join(part for part in (fx_name, tag, meaning) if part),
        )

    def _unique(self, name: str, device: str = "") -> str:
        candidate = name if name.upper() not in self._used_names or not device else f"{name}_{device}"
        number = 2
        # IEC names are not case sensitive
        while candidate.upper() in self._used_names:
            candidate = f"{name}_{number}"
            number += 1
        self._used_names.add(candidate.upper())
        return candidate


def type_of(kind: str, number: int) -> str:
    """Return the IEC type of a word device.

    Examples:
        >>> type_of("D", 0), type_of("C", 0), type_of("C", 200)
        ('INT', 'INT', 'DINT')
    """
    return "DINT" if kind == "C" and is_32_bit_counter(number) else "INT"
