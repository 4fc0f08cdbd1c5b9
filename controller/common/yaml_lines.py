"""YAML reader that provides the line of every value, for error messages with line numbers.

`yaml_model` validates the values with pydantic models; `yaml_section` reads them one by one.
"""

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from controller.common.errors import InputError
from controller.common.files.text_encoding import REMEDY, EncodingError, file_text

KeyPath = tuple[str | int, ...]
"""Keys and list indices that lead to a value, such as ``("inputs", 0, "at_ms")``; empty for the mapping itself."""


class InvalidValue(NamedTuple):
    """Invalid value in a file.

    Attributes:
        line: Line, from 1.
        path: Path of the value.
        text: Problem and remedy.
    """

    line: int
    path: KeyPath
    text: str

    def __str__(self) -> str:
        return f"{self.line}: {dotted(self.path) or 'file'}: {self.text}"


@dataclass
class LocatedMapping:
    """Mapping in a file, with the lines of its keys.

    Attributes:
        values: Values of the mapping, as input of a model.
        lines: Line of each key and each list entry, from 1.
        faults: Invalid values found; ``values`` does not contain duplicate or invalid keys.
    """

    values: dict[str, object]
    lines: dict[KeyPath, int]
    faults: list[InvalidValue] = field(default_factory=list)

    def line_of(self, path: KeyPath) -> int:
        """Return the line of a key; for a missing key, the line of the mapping that should contain it."""
        while path not in self.lines:
            path = path[:-1]
        return self.lines[path]

    def add_fault(self, path: KeyPath, text: str) -> None:
        """Record a fault at the line of its path."""
        self.faults.append(InvalidValue(self.line_of(path), path, text))


_COMPILED: Final[Mapping[type[yaml.BaseLoader | yaml.SafeLoader], Any]] = (
    {yaml.BaseLoader: yaml.CBaseLoader, yaml.SafeLoader: yaml.CSafeLoader} if yaml.__with_libyaml__ else {}
)
"""Compiled counterpart of each loader, ten times faster."""
_NESTING = "[{-:?"
_MAX_NESTING: Final = 5_000
"""Number of `_NESTING` characters in a text at or above which the Python loader is used; the compiled loaders overflow
the stack at a depth of about 10,000."""


def read_yaml(
    path: Path, error_type: type[InputError], loader: type[yaml.BaseLoader | yaml.SafeLoader] = yaml.BaseLoader
) -> yaml.MappingNode:
    """Return the node tree of a YAML file whose top level is a mapping.

    Args:
        path: Path of the file.
        error_type: Type of the exception raised for an invalid file.
        loader: Loader that resolves the types of scalars. The default resolves none, because YAML 1.1 reads
            ``off`` as false, ``010`` as 8 and ``1:30`` as 90.

    Raises:
        InputError: The file cannot be read, is not YAML in UTF-8, is empty or does not contain a mapping; the message
            is one line with the file, the line, the problem and the remedy.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise error_type(f"{path}: cannot be read ({reason}); specify a YAML file") from None
    try:
        root = _compose(data.decode(), loader)
    except (UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        line, problem = _description(error, data)
        raise error_type(f"{path}:{line}: file: {problem}") from None
    if root is None:
        raise error_type(f"{path}:1: file: is empty; write the required sections")
    if not isinstance(root, yaml.MappingNode):
        line = line_of(root)
        raise error_type(f"{path}:{line}: file: does not begin with a section; write its name and a colon")
    return root


def _compose(text: str, loader: type[yaml.BaseLoader | yaml.SafeLoader]) -> yaml.Node | None:
    """Return the node tree; the Python loader reads text that is nested deeply or rejected by the compiled one."""
    fast = _COMPILED.get(loader)
    if fast is not None and sum(map(text.count, _NESTING)) < _MAX_NESTING:
        with suppress(yaml.YAMLError):
            return yaml.compose(text, Loader=fast)
    return yaml.compose(text, Loader=loader)


def _encoding(data: bytes) -> str:
    """Return the encoding of a text that is not UTF-8."""
    try:
        return file_text(data).encoding
    except EncodingError:
        return "not UTF-8"


def _description(error: UnicodeDecodeError | yaml.YAMLError | RecursionError, data: bytes) -> tuple[int, str]:
    """Return the line of an error, and its description with the remedy."""
    match error:
        case UnicodeDecodeError():
            return data.count(b"\n", 0, error.start) + 1, f"is {_encoding(data)} text; {REMEDY}"
        case yaml.reader.ReaderError():
            text, at = data.decode(), error.position
            problem = f"is not YAML (character U+{ord(text[at]):04X}); delete the character"
            return text.count("\n", 0, at) + 1, problem
        case yaml.MarkedYAMLError():
            mark, start = error.problem_mark or error.context_mark, error.context_mark
            problem = f"is not YAML ({error.problem or error.context}"
            problem += f", {error.context} from line {start.line + 1})" if error.context and start else ")"
            return mark.line + 1 if mark else 1, f"{problem}; correct this line or one before it"
        case _:
            return 1, "is not YAML (brackets are nested too deeply); reduce the nesting"


def line_of(node: yaml.Node) -> int:
    """Return the line of a node, from 1."""
    return int(node.start_mark.line) + 1


def value_of(node: yaml.Node) -> object:
    """Return a bool for an unquoted true or false, an int for an unquoted decimal number, otherwise the text.

    A list or a mapping is returned as a node.
    """
    if not isinstance(node, yaml.ScalarNode):
        return node
    text: str = node.value
    plain = not node.style  # None, or an empty text from a compiled loader
    if plain and text in ("true", "false"):
        return text == "true"
    if plain and re.fullmatch("-?(0|[1-9][0-9]{0,17})", text):
        return int(text)
    return text


def unfold(node: yaml.MappingNode, depth: int = 2, convert: Callable[[yaml.Node], object] = value_of) -> LocatedMapping:
    """Return the values of a mapping with their lines, including lists and nested mappings.

    Args:
        node: The mapping.
        depth: Number of levels to unfold; 1 = only the keys of the mapping itself.
        convert: Function that converts a scalar, or a list or mapping below the last level. The default returns lists
            and mappings as nodes, which no model accepts. A ValueError is recorded as a fault.
    """
    located = LocatedMapping({}, {(): line_of(node)})

    def mapping(node: yaml.MappingNode, path: KeyPath, depth: int) -> dict[str, object]:
        values: dict[str, object] = {}
        for key_node, value_node in node.value:
            key, line, key_path = str(key_node.value), line_of(key_node), (*path, str(key_node.value))
            if not isinstance(key_node, yaml.ScalarNode):
                located.faults.append(InvalidValue(line, path, f"{shown(key_node)} is not a valid key; write a word"))
            elif key in values:
                text = f"key {shown(key)} is already defined on line {located.lines[key_path]}; delete one"
                located.faults.append(InvalidValue(line, path, text))
            else:
                located.lines[key_path] = line
                values[key] = value(value_node, key_path, depth - 1)
        return values

    def value(node: yaml.Node, path: KeyPath, depth: int) -> object:
        if depth and isinstance(node, yaml.MappingNode):
            return mapping(node, path, depth)
        if depth and isinstance(node, yaml.SequenceNode):
            located.lines.update(((*path, index), line_of(entry)) for index, entry in enumerate(node.value))
            return [value(entry, (*path, index), depth - 1) for index, entry in enumerate(node.value)]
        try:
            return convert(node)
        except ValueError as error:
            located.add_fault(path, str(error))
            return None

    located.values = mapping(node, (), depth)
    return located


def shown(value: object) -> str:
    r"""Return a value from the file, formatted for a message: on one line and limited in length.

    >>> print(shown("two\nlines"), shown(True))
    'two\nlines' true
    """
    if value is None:
        return "empty"
    if isinstance(value, list | yaml.SequenceNode):
        return "an empty list" if value == [] else "a list"
    if isinstance(value, dict | yaml.MappingNode):
        return "a mapping"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def dotted(path: KeyPath) -> str:
    """Return a path for use in a message; list entries are counted from 1.

    >>> dotted(("inputs", 0, "at_ms"))
    'inputs[1].at_ms'
    """
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += "." * bool(text) + (part if part.isprintable() and len(part) <= 60 else shown(part))
    return text
