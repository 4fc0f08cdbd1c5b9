"""Structured Text runner: translates the syntax tree of the blark parser to Python.

It supports only the subset of the language that the export uses. It shares no code with the export and identifies
devices by their addresses.
"""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from types import CodeType
from typing import Any, Final

from blark.parse import parse_source_code  # type: ignore[import-untyped]
from joblib import Memory
from lark import Token, Tree

from tests.paths import ROOT

BLARK_VERSION: Final = version("blark")
TRANSLATOR: Final = f"{BLARK_VERSION} {sha256(Path(__file__).read_bytes()).hexdigest()}"
"""Versions of the parser and of this module."""
KEPT: Final = Memory(ROOT / ".pytest_cache", verbose=0)
"""Results that are kept between runs."""
OPERATORS: Final = {"=": "==", "<>": "!=", "AND": "and", "OR": "or", "NOT": "not", "MOD": "%", "/": "//"}
RANGES: Final = {"INT": 2**15, "DINT": 2**31, "LINT": 2**63}
FUNCTIONS: Final = {"MIN": min}
RUNTIME_CALLS: Final = ("TON_TRUE", "TON_FALSE", "LEAVE")
"""Functions that stand for the calls of a TON with its input on or off, and for RETURN."""
UNITS_MS: Final = {"ms": 1, "s": 1_000, "m": 60_000}
SHORT: Final = "abcfghijklmnopquvwxyz"
KEYWORDS: Final = frozenset("IF THEN ELSIF ELSE END_IF AND OR NOT MOD TRUE FALSE".split())  # noqa: SIM905 - more readable as text


def parsed(text: str) -> Tree[Any]:
    """Return the syntax tree of the text, or raise the parser's error."""
    return _parsed(text, "iec_source")


@lru_cache(maxsize=4096)
def _parsed(text: str, rule: str) -> Tree[Any]:
    return _parse(text, rule, BLARK_VERSION)  # type: ignore[no-any-return]


@KEPT.cache  # type: ignore[untyped-decorator]
def _parse(text: str, rule: str, _version: str) -> Tree[Any]:
    """Return the syntax tree of the text; kept between runs, because parsing a package takes about 10 s."""
    return tree_of(text, rule)


def tree_of(text: str, rule: str) -> Tree[Any]:
    """Return the syntax tree of the text, which may be nested too deeply to be kept between runs."""
    result = parse_source_code(text, starting_rule=rule)
    if result.exception is not None:
        raise result.exception
    tree: Tree[Any] = result.tree
    return tree


@dataclass(frozen=True)
class Declaration:
    """Declared variable."""

    name: str
    type: str
    address: str
    first: int
    retain: bool


class StProgram:
    """Parsed program that can be run any number of times.

    Attributes:
        variables: Variables by lower-case name.
    """

    def __init__(self, text: str) -> None:
        program = re.sub(r"\(\*.*?\*\)", "", text).partition("END_PROGRAM\n")[0] + "END_PROGRAM\n"
        head, _, body = _without_ton(program).rpartition("END_VAR\n")
        self.variables = {v.name: v for v in _declared(f"{head}END_VAR\nEND_PROGRAM\n")}
        self._body = body.replace("END_PROGRAM\n", "")

    @cached_property
    def source(self) -> str:
        """Statements translated to Python, created on first use because parsing is slow."""
        return _translated(self._body, {v.name: v.type for v in self.variables.values()}, TRANSLATOR)  # type: ignore[no-any-return]

    def plc(self, mutate: Callable[[str], str] = str, device_byte: int = 0) -> StPlc:
        """Return a PLC that runs the program, optionally with mutated Python code.

        Args:
            mutate: Function that damages the code.
            device_byte: First byte of the inputs and outputs.
        """
        return StPlc(self.variables, compile(mutate(self.source), "<structured text>", "exec"), device_byte)


@KEPT.cache  # type: ignore[untyped-decorator]
def _translated(body: str, types: dict[str, str], _translator: str) -> str:
    """Return the Python text of statements; kept between runs until the translator changes."""
    lines: list[str] = []
    for statement in _statements(body):
        folded, pieces = _fold(statement)
        shape, names = _shape(folded)
        lines += _Python(types, names, pieces).block(_parsed(shape, "statement_list"), 0)
    return "\n".join(lines) + "\n"


def _without_ton(text: str) -> str:
    """Return a text in which a TON, times and RETURN are replaced by numbers in ms and by functions of the runner.

    The statements are folded before they are parsed, and folding supports only functions.
    """
    text = re.sub(r"\bT#(\d+)(ms|s|m)\b", lambda m: str(int(m[1]) * UNITS_MS[m[2]]), text)
    text = re.sub(r"\b(\w+)\(IN := (TRUE|FALSE), PT := (\d+)\);", r"\1 := TON_\2(\3);", text)
    text = re.sub(r"\b(\w+)\.ET\b", r"\1", text)
    text = re.sub(r"^( +)RETURN;", r"\1inputs_valid := LEAVE(0);", text, flags=re.MULTILINE)
    return re.sub(r": (TON|TIME);", ": LINT;", text)


def _statements(body: str) -> list[str]:
    """Return the statements that begin at the left margin, each with its indented lines."""
    return [part for part in re.split(r"\n(?=\S)(?!END_IF|ELSE|ELSIF)", body) if part.strip()]


def _fold(statement: str) -> tuple[str, dict[str, str]]:
    """Return a statement with its parenthesised expressions and conditions replaced by names, and the expressions.

    Parsing time grows faster than the length of the text, and most of these expressions differ only in variable names.
    """
    pieces: dict[str, str] = {}

    def fold(found: re.Match[str]) -> str:
        before, inside = found[1] or "", found[2]
        name = f"bracket_{len(pieces)}"
        if before.upper() in KEYWORDS or not before:
            pieces[name] = inside
            return f"{before}{found[0][len(before) : found[0].index('(')]} {name} "
        pieces[name] = f"{before}({inside})"
        return f" {name} "

    text, count = " ".join(statement.split()), 1
    while count:
        text, count = re.subn(r"(\w+)? ?\(([^()]*)\)", fold, text)

    def fold_condition(found: re.Match[str]) -> str:
        name = f"bracket_{len(pieces)}"
        pieces[name] = found[1]
        return f"IF {name} THEN"

    return re.sub(r"IF (.+?) THEN", fold_condition, text), pieces


def _shape(statement: str) -> tuple[str, dict[str, str]]:
    """Return a statement with short names and small numbers, and the name or number that each of them replaces.

    Parsing the text of the machine takes a minute. Short names reduce the length of the text, and statements that
    differ only in their names and numbers are parsed once.
    """
    numbers: dict[str, str] = {}

    def numbered(found: re.Match[str]) -> str:
        word = found[0]
        if word.isdigit():
            return numbers.setdefault(word, str(len(numbers)))
        short = SHORT[len(numbers)] if len(numbers) < len(SHORT) else f"n{len(numbers)}"
        return word if word in KEYWORDS else numbers.setdefault(word.lower(), short)

    shape = re.sub(r"(?<!#)\b(?:[A-Za-z_]\w*|\d+)\b(?![(#])", numbered, " ".join(statement.split()))
    return shape, {number: name for name, number in numbers.items()}


def _declared(text: str) -> Iterator[Declaration]:
    """Yield the declared variables of a text without statements.

    Of the declarations in a section that differ only in the name and the number of the address, only the first is
    parsed, because parsing all declarations of the machine takes seconds.
    """
    kept: list[str] = []
    models: dict[str, str] = {}
    found: list[tuple[str, str, str]] = []
    section = ""
    for line in text.splitlines():
        if (declaration := re.fullmatch(r" +(\w+)(?: AT %(\w+?)([\d.]+))? (:.*)", line)) is None:
            section = line
            kept.append(line)
            continue
        name, area, number, rest = declaration.groups(default="")
        shape = f"{section} {area} {rest}"
        if shape not in models:
            models[shape] = name.lower()
            kept.append(line)
        found.append((name.lower(), area + number, models[shape]))
    (program,) = parsed("\n".join(kept) + "\n").children
    parsed_ones = {declaration.name: declaration for declaration in _declarations(program)}
    for name, place, model in found:
        yield replace(parsed_ones[model], name=name, address=place)


def _declarations(program: Tree[Any]) -> Iterator[Declaration]:
    for section in program.children[1].children:
        retain = any(str(t.children[0]) == "RETAIN" for t in section.find_data("variable_attributes"))
        for row in section.iter_subtrees_topdown():
            if row.data in ("var1_init_decl", "located_var_decl"):
                name = _name(next(row.find_data("variable_name")))
                kind = str(next(row.find_data("simple_specification")).children[0])
                places = [[str(part) for part in v.children] for v in row.find_data("direct_variable")]
                where = "".join("".join(place[:3]) + "".join(f".{bit}" for bit in place[3:]) for place in places)
                value = next(row.find_data("expression"), None)
                first = literal_eval(_Python({}, {}, {}).value(value)) if value is not None else 0
                yield Declaration(name, kind, where, first, retain)


def _name(variable: Tree[Any]) -> str:
    name, further = variable.children
    assert further is None, f"{name}: not a plain variable"
    return str(name).lower()


class _Python:
    """Translator of statements and expressions to Python text."""

    def __init__(self, types: dict[str, str], names: dict[str, str], pieces: Mapping[str, str]) -> None:
        self._types = types
        self._names = names
        self._pieces = pieces

    def block(self, statements: Tree[Any] | None, depth: int) -> list[str]:
        if statements is None:
            return ["    " * depth + "pass"]
        return [line for statement in statements.children for line in self.statement(statement, depth)]

    def statement(self, statement: Tree[Any], depth: int) -> list[str]:
        indent = "    " * depth
        if statement.data == "assignment_statement":
            variable, _, value = statement.children
            name = self._names[_name(variable)]
            limit = RANGES.get(self._types[name])
            checked = self.value(value) if limit is None else f"within({self.value(value)}, {limit})"
            return [f"{indent}v_{name} = {checked}"]
        if statement.data == "if_statement":
            condition, then, *further = statement.children
            lines = [f"{indent}if {self.value(condition)}:", *self.block(then, depth + 1)]
            for clause in further:
                if clause is not None and clause.data == "else_if_clause":
                    lines += [f"{indent}elif {self.value(clause.children[0])}:"]
                    lines += self.block(clause.children[1], depth + 1)
                elif clause is not None:
                    lines += [f"{indent}else:", *self.block(clause.children[0], depth + 1)]
            return lines
        raise ValueError(f"{statement.data}: not a statement of the exported text")

    def value(self, node: Tree[Any] | Token) -> str:
        if isinstance(node, Token):
            return OPERATORS.get(str(node), str(node))
        if node.data == "variable_name":
            variable = self._names[_name(node)]
            return self.bracket(self._pieces[variable]) if variable in self._pieces else f"v_{variable}"
        if node.data == "constant":
            return self.constant(node.children[0])
        if node.data == "function_call":
            name, *arguments = node.children
            values = ", ".join(self.value(a.children[-1]) for a in arguments)
            return f"{self.function(_name(name).upper())}({values})"
        known = node.data in ("parenthesized_expression", "unary_expression") or str(node.data).endswith("expression")
        assert known or node.data == "expression_term", node.data
        parts = [self.value(child) for child in node.children if child is not None]
        if len(parts) == 2:
            return f"(not {parts[1]})" if parts[0] == "not" else f"{parts[0]}{parts[1]}"
        return parts[0] if len(parts) == 1 else f"({' '.join(parts)})"

    def bracket(self, expression: str) -> str:
        shape, names = _shape(f"x := {expression};")  # the parser accepts only statements
        (assignment,) = _parsed(shape, "statement_list").children
        return f"({_Python(self._types, names, self._pieces).value(assignment.children[-1])})"

    @staticmethod
    def function(name: str) -> str:
        known = name in FUNCTIONS or name in RUNTIME_CALLS
        assert known or re.fullmatch(r"(D?INT|LINT)_TO_(D?INT|LINT)", name), name
        return name if known else "int"

    def constant(self, literal: Tree[Any]) -> str:
        if literal.data in ("true", "false"):
            return str(literal.data).title()
        assert literal.data in ("integer_literal", "bit_string_literal"), literal.data
        number = literal.children[-1]
        value = str(int(str(number if isinstance(number, Token) else number.children[-1])))
        return str(int(self._names.get(value, value)))


def within(value: int, limit: int) -> int:
    """Return a value after checking that it fits its type."""
    assert -limit <= value < limit, f"{value}: outside the range of its type"
    return value


class _LeaveError(Exception):
    """RETURN of the program."""


class StPlc:
    """PLC that runs a program in Structured Text.

    Attributes:
        values: Values of the variables, by name in the code.
        runtime_ms: Time of the runtime, which its TON measures, ms.
    """

    def __init__(self, variables: Mapping[str, Declaration], code: CodeType, device_byte: int) -> None:
        self._device_byte = device_byte
        self.runtime_ms = 0
        self._ton_since_ms: int | None = None
        self._variables = variables
        self._code = code
        self._by_address = {v.address: v for v in variables.values() if v.address}
        first = {f"v_{v.name}": bool(v.first) if v.type == "BOOL" else v.first for v in variables.values()}
        self._cold = first
        self.values: dict[str, Any] = dict(first)
        calls = {"TON_TRUE": self._ton, "TON_FALSE": self._ton_off, "LEAVE": self._leave}
        self._functions = {"within": within, **FUNCTIONS, **calls}
        self._inputs = self._area("I")
        self._outputs = self._area("Q")

    def _area(self, area: str) -> list[tuple[int, str]]:
        found = (re.fullmatch(rf"{area}X(\d+)\.(\d)", v.address) for v in self._by_address.values())
        numbers = ((int(m[1]) * 8 + int(m[2]) - self._device_byte * 8, self._by_address[m[0]]) for m in found if m)
        return [(number, f"v_{variable.name}") for number, variable in numbers if number < 256]

    def _ton(self, preset_ms: int) -> int:
        if self._ton_since_ms is None:
            self._ton_since_ms = self.runtime_ms
        return min(self.runtime_ms - self._ton_since_ms, preset_ms)

    def _ton_off(self, preset_ms: int) -> int:
        del preset_ms
        self._ton_since_ms = None
        return 0

    def _leave(self, value: int) -> int:
        raise _LeaveError(value)

    def read(self, address: str) -> int:
        """Return the value of the variable at an address."""
        return int(self.values[f"v_{self._by_address[address].name}"])

    def write(self, address: str, value: int) -> None:
        """Write the variable at an address; do nothing if no variable has this address."""
        if address in self._by_address:
            variable = self._by_address[address]
            self.values[f"v_{variable.name}"] = bool(value) if variable.type == "BOOL" else value

    def words(self, area: str) -> dict[str, int]:
        """Return the values of the variables with an address in an area, for example MW, by address."""
        return {place: self.read(place) for place in self._by_address if place.startswith(area)}

    def power_cycle(self, *, memory_lost: bool = False) -> None:
        """Cycle the power: variables that are not retained, or all of them, return to their initial values."""
        self._ton_since_ms = None
        for variable in self._variables.values():
            if memory_lost or not variable.retain:
                self.values[f"v_{variable.name}"] = self._cold[f"v_{variable.name}"]

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        """Run one scan and return the outputs by number; outputs without a variable are off.

        Args:
            now_ms: Time of the scan for a program with the input `now_ms`; time of the runtime for one with a clock.
            levels: Levels of the inputs, by number.
        """
        for number, name in self._inputs:
            self.values[name] = levels[number] if number < len(levels) else False
        self.runtime_ms = now_ms
        if "scans" not in self._variables:
            self.values["v_now_ms"] = now_ms
        with suppress(_LeaveError):
            exec(self._code, self._functions, self.values)  # noqa: S102 - text generated by the tests
        image = [False] * 256
        for number, name in self._outputs:
            image[number] = self.values[name]
        return image
