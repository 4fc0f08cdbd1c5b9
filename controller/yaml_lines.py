"""YAML in which every value knows its line, for readers that tell the user where a file is wrong."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import yaml

Trail = tuple[str, ...]
"""The keys that lead to a value of an entry, as ``("modbus", "offset")``; empty for the entry itself."""


class YamlFileError(ValueError):
    """The file holds no YAML mapping; the text is one line: file, line, what is wrong, remedy."""


@dataclass
class Lined:
    """One mapping of a file, unfolded.

    Attributes:
        values: What it holds, as a model wants it.
        lines: The line of each key, from 1.
        faults: Line and text of each key that cannot be used; ``values`` is without them.
    """

    values: dict[str, object]
    lines: dict[Trail, int]
    faults: list[tuple[int, str]] = field(default_factory=list)

    def line_of(self, trail: Trail) -> int:
        """Return the line of a key; of a key that is not there, the line of what it is missing from."""
        while trail not in self.lines:
            trail = trail[:-1]
        return self.lines[trail]


def read_yaml(path: Path) -> yaml.MappingNode:
    """Return the node tree of a YAML file whose top level is a mapping.

    Every scalar stays the text it is: YAML 1.1 would read ``off`` as false, ``010`` as 8 and ``1:30``
    as 90.

    Raises:
        YamlFileError: It cannot be read, is no YAML in UTF-8, is empty or holds something else.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise YamlFileError(f"{path}: cannot be read ({reason}); name a YAML file") from None
    try:
        root = yaml.compose(data.decode(), Loader=yaml.BaseLoader)
    except (UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        line, wrong = _in_words(error, data)
        raise YamlFileError(f"{path}:{line}: file: {wrong}") from None
    if root is None:
        raise YamlFileError(f"{path}:1: file: is empty; write its sections")
    if not isinstance(root, yaml.MappingNode):
        line = line_of(root)
        raise YamlFileError(f"{path}:{line}: file: does not begin with a section; write its name and a colon")
    return root


def _in_words(error: UnicodeDecodeError | yaml.YAMLError | RecursionError, data: bytes) -> tuple[int, str]:
    """Return the line, and what is wrong with the remedy."""
    match error:
        case UnicodeDecodeError():
            return data.count(b"\n", 0, error.start) + 1, "is not UTF-8 text; save it as UTF-8"
        case yaml.reader.ReaderError():
            text, at = data.decode(), error.position
            wrong = f"is not YAML (character U+{ord(text[at]):04X}); delete the character"
            return text.count("\n", 0, at) + 1, wrong
        case yaml.MarkedYAMLError():
            mark, begun = error.problem_mark or error.context_mark, error.context_mark
            wrong = f"is not YAML ({error.problem or error.context}"
            wrong += f", {error.context} from line {begun.line + 1})" if error.context and begun else ")"
            return mark.line + 1 if mark else 1, f"{wrong}; mend this line or one before it"
        case _:
            return 1, "is not YAML (brackets are nested too deep); write fewer"


def line_of(node: yaml.Node) -> int:
    """Return the line of a node, from 1."""
    return int(node.start_mark.line) + 1


def unfold(node: yaml.MappingNode, depth: int = 2) -> Lined:
    """Return the values of a mapping with their lines, and of the mappings in it down to ``depth``.

    What lies deeper stays a node: of no type a model asks for, so the model will refuse it.
    """
    lined = Lined({}, {(): line_of(node)})
    for key_node, value_node in node.value:
        key, line = str(key_node.value), line_of(key_node)
        if not isinstance(key_node, yaml.ScalarNode):
            lined.faults.append((line, f"{shown(key_node)} is no key; write a word"))
        elif key in lined.values:
            first = lined.lines[key,]
            lined.faults.append((line, f"key {shown(key)} is already on line {first}; delete one"))
        elif isinstance(value_node, yaml.MappingNode) and depth > 1:
            inner = unfold(value_node, depth - 1)
            lined.values[key] = inner.values
            lined.lines |= {(key, *trail): at for trail, at in inner.lines.items()} | {(key,): line}
            lined.faults += inner.faults
        else:
            lined.values[key] = value_of(value_node)
            lined.lines[key,] = line
    return lined


def value_of(node: yaml.Node) -> object:
    """Return a bool for a plain true or false, an int for a plain decimal, else the text.

    A list or a mapping stays a node.
    """
    if not isinstance(node, yaml.ScalarNode):
        return node
    text: str = node.value
    plain = node.style is None
    if plain and text in ("true", "false"):
        return text == "true"
    if plain and re.fullmatch("-?(0|[1-9][0-9]{0,17})", text):
        return int(text)
    return text


def shown(value: object) -> str:
    r"""Return a value of the file as it may stand in a message: on one line, not too long.

    >>> print(shown("two\nlines"), shown(True))
    'two\nlines' true
    """
    if isinstance(value, yaml.SequenceNode):
        return "a list"
    if isinstance(value, dict | yaml.MappingNode):
        return "a mapping"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
