"""A mapping of a scenario file whose values are read one by one, each complaint with its file and line."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import yaml

from controller.yaml_lines import line_of, shown, unfold
from plant_sim.faults.kind import suggestion

_Value = TypeVar("_Value")


class ScenarioError(ValueError):
    """A scenario cannot be used; the text is one line: file, line, key, what is wrong, remedy."""


class Section:
    """A mapping of the file.

    Attributes:
        path: The file.
        name: Its dotted name; empty for the file as a whole.
        line: Its line.
    """

    def __init__(self, path: Path, name: str, node: object, known: Iterable[str] | None = None) -> None:
        """Unfold a mapping.

        Args:
            path: The file.
            name: Its dotted name.
            node: It.
            known: The keys it may have; None: any.

        Raises:
            ScenarioError: it is no mapping, or has a key twice or one that is not known.
        """
        self.path = path
        self.name = name
        self.line = line_of(node) if isinstance(node, yaml.Node) else 1
        self._lines: dict[str, int] = {}
        if not isinstance(node, yaml.MappingNode):
            raise self.error(None, "must be a mapping; write a key, a colon and a value a line")
        lined = unfold(node, depth=1)
        for line, text in lined.faults:
            raise ScenarioError(f"{path}:{line}: {name or 'file'}: {text}")
        self._values = lined.values
        self._lines = {trail[0]: line for trail, line in lined.lines.items() if trail}
        for key in self._values:
            if known is not None and key not in known:
                raise self.error(key, f"is no key here; {suggestion(key, known)}")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def where(self, key: str | None = None) -> str:
        """Return file and line of a key, or of the section."""
        return f"{self.path}:{self.line if key is None else self._lines.get(key, self.line)}"

    def error(self, key: str | None, complaint: str) -> ScenarioError:
        """Return an error that names file, line and key."""
        return ScenarioError(f"{self.where(key)}: {self._dotted(key) or 'file'}: {complaint}")

    def read(self, key: str, reader: Callable[[str], _Value]) -> _Value:
        """Return a value.

        Args:
            key: Its key.
            reader: Makes it from the text; a ValueError is told with file and line.

        Raises:
            ScenarioError: the key is missing, or its value is no text or not as the reader wants it.
        """
        if key not in self._values:
            raise self.error(key, "is missing; add it")
        value = self._values[key]
        if isinstance(value, yaml.Node):
            raise self.error(key, f"must be a word or a number, not {shown(value)}")
        return self.checked(key, reader, str(value).lower() if isinstance(value, bool) else str(value))

    def checked(self, key: str, reader: Callable[[str], _Value], text: str) -> _Value:
        """Return what a reader makes of a text that stands under a key.

        Raises:
            ScenarioError: it is not as the reader wants it.
        """
        try:
            return reader(text)
        except ValueError as error:
            raise self.error(key, str(error)) from None

    def read_or(self, key: str, reader: Callable[[str], _Value], default: _Value) -> _Value:
        """Return a value, or the default where the key is missing; see `read`."""
        return self.read(key, reader) if key in self._values else default

    def section(self, key: str, known: Iterable[str] | None = None) -> Section | None:
        """Return the mapping under a key, None where the key is missing."""
        if key not in self._values:
            return None
        return Section(self.path, self._dotted(key), self._node(key), known)

    def sections(self, key: str, known: Iterable[str]) -> list[Section]:
        """Return the mappings of the list under a key, none where the key is missing."""
        return [
            Section(self.path, self._dotted(f"{key}[{number}]"), node, known)
            for number, node in enumerate(self._list(key), 1)
        ]

    def entries(self, key: str, known: Collection[str]) -> list[Section | str]:
        """Return the entries of the list under a key, words or mappings.

        Args:
            key: The key.
            known: The keys that a mapping may have; without any, an entry must be a word or a number.

        Raises:
            ScenarioError: it is no list, or an entry is neither.
        """
        found: list[Section | str] = []
        for number, node in enumerate(self._list(key), 1):
            name = f"{key}[{number}]"
            if isinstance(node, yaml.ScalarNode):
                found.append(str(node.value))
            elif known and isinstance(node, yaml.MappingNode):
                found.append(Section(self.path, self._dotted(name), node, known))
            else:
                wanted = "a word or a mapping" if known else "a word or a number"
                complaint = f"{self._dotted(name)}: must be {wanted}, not {shown(node)}"
                raise ScenarioError(f"{self.path}:{line_of(node)}: {complaint}")
        return found

    def words(self, key: str) -> list[str]:
        """Return the words or numbers of the list under a key.

        Args:
            key: The key.

        Raises:
            ScenarioError: it is no list, or an entry is something else.
        """
        return [entry for entry in self.entries(key, ()) if isinstance(entry, str)]

    def _dotted(self, key: str | None) -> str:
        """The name of a key; empty for the file as a whole."""
        return ".".join(part for part in (self.name, key) if part)

    def _list(self, key: str) -> list[yaml.Node]:
        node = self._values.get(key)
        if node is None:
            return []
        if not isinstance(node, yaml.SequenceNode):
            raise self.error(key, "must be a list; begin each entry with a dash, or write [] for none")
        return list(node.value)

    def _node(self, key: str) -> object:
        node = self._values[key]
        if not isinstance(node, yaml.Node):
            raise self.error(key, f"must be a mapping, not {shown(node)}; write keys below it, indented")
        return node


def one_of(what: str, known: Iterable[str]) -> Callable[[str], str]:
    """Return a reader of one of some names."""
    names = list(known)

    def read(text: str) -> str:
        if text not in names:
            raise ValueError(f"{text!r} is no {what}; {suggestion(text, names)}")
        return text

    return read


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a reader of whole numbers."""

    def read(text: str) -> int:
        if re.fullmatch("-?[0-9]{1,18}", text) is None or not low <= int(text) <= high:
            raise ValueError(f"must be a whole number, {low} to {high}, not {text!r}")
        return int(text)

    return read
