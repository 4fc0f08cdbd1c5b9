"""Mapping of a YAML file whose values are read one by one; error messages state the file and the line."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import yaml

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.common.yaml_lines import dotted, line_of, read_yaml, shown, unfold, value_of

_Value = TypeVar("_Value")
_Name = TypeVar("_Name", bound=str)


class Section:
    """Mapping in a YAML file.

    Attributes:
        path: Path of the file.
        name: Dotted name; empty for the complete file.
        line: Line number.
    """

    def __init__(
        self, path: Path, name: str, node: object, known: Iterable[str] | None, error_type: type[InputError]
    ) -> None:
        """Read the keys of a mapping.

        Args:
            path: Path of the file.
            name: Dotted name.
            node: YAML node.
            known: Permitted keys; None = any.
            error_type: Type of the exceptions raised.

        Raises:
            InputError: The node is not a mapping, or a key is duplicate or unknown.
        """
        self.path = path
        self.name = name
        self.line = line_of(node) if isinstance(node, yaml.Node) else 1
        self._error_type = error_type
        self._lines: dict[str, int] = {}
        if not isinstance(node, yaml.MappingNode):
            raise self.error(None, "must be a mapping; write a key, a colon and a value per line")
        located = unfold(node, depth=1)
        for fault in located.faults:
            raise error_type(f"{path}:{fault.line}: {name or 'file'}: {fault.text}")
        self._values = located.values
        self._lines = {str(trail[0]): line for trail, line in located.lines.items() if trail}
        for key in self._values:
            if known is not None and key not in known:
                raise self.error(key, f"unknown key; {suggestion(key, known)}")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def where(self, key: str | None = None) -> str:
        """Return the file and the line of a key, or of the section."""
        return f"{self.path}:{self.line if key is None else self._lines.get(key, self.line)}"

    def error(self, key: str | None, complaint: str) -> InputError:
        """Return an error that names the file, the line and the key."""
        return self._error_type(f"{self.where(key)}: {self._dotted(key) or 'file'}: {complaint}")

    def read(self, key: str, reader: Callable[[str], _Value]) -> _Value:
        """Return a value.

        Args:
            key: Key of the value.
            reader: Converts the text; a ValueError is reported with file and line.

        Raises:
            InputError: The key is missing or its value is invalid.
        """
        if key not in self._values:
            raise self.error(key, "is missing; add it")
        value = self._values[key]
        if isinstance(value, yaml.Node):
            raise self.error(key, f"must be a word or a number, not {shown(value)}")
        return self.checked(key, reader, str(value).lower() if isinstance(value, bool) else str(value))

    def checked(self, key: str, reader: Callable[[str], _Value], text: str) -> _Value:
        """Return the text of a key, converted by a reader.

        Raises:
            InputError: The text is invalid.
        """
        try:
            return reader(text)
        except ValueError as error:
            raise self.error(key, str(error)) from None

    def read_or(self, key: str, reader: Callable[[str], _Value], default: _Value) -> _Value:
        """Return a value, or the default if the key is missing; see `read`."""
        return self.read(key, reader) if key in self._values else default

    def section(self, key: str, known: Iterable[str] | None = None) -> Section | None:
        """Return the mapping of a key; None if the key is missing."""
        if key not in self._values:
            return None
        return Section(self.path, self._dotted(key), self._node(key), known, self._error_type)

    def sections(self, key: str, known: Iterable[str] | None) -> list[Section]:
        """Return the mappings in the list of a key; an empty list if the key is missing.

        Args:
            key: The key.
            known: Permitted keys of a mapping; None = any.
        """
        return [
            Section(self.path, self._dotted(f"{key}[{number}]"), node, known, self._error_type)
            for number, node in enumerate(self._list(key), 1)
        ]

    def entries(self, key: str, known: Collection[str]) -> list[Section | str]:
        """Return the entries of the list stored under a key; each entry is a word or a mapping.

        Args:
            key: The key.
            known: Permitted keys of a mapping; if empty, an entry must be a word or a number.

        Raises:
            InputError: The value is not a list, or an entry is invalid.
        """
        entries: list[Section | str] = []
        for number, node in enumerate(self._list(key), 1):
            if isinstance(node, yaml.ScalarNode):
                entries.append(str(node.value))
            elif known and isinstance(node, yaml.MappingNode):
                name = self._dotted(f"{key}[{number}]")
                entries.append(Section(self.path, name, node, known, self._error_type))
            else:
                wanted = "a word or a mapping" if known else "a word or a number"
                raise self._entry_error(key, number, node, f"must be {wanted}, not {shown(node)}")
        return entries

    def words(self, key: str) -> list[str]:
        """Return the words or numbers in the list of a key.

        Args:
            key: The key.

        Raises:
            InputError: The value is not a list, or an entry is not a word or a number.
        """
        return [entry for entry in self.entries(key, ()) if isinstance(entry, str)]

    def word_lists(self, key: str, reader: Callable[[str], _Value]) -> list[list[_Value]]:
        """Return the lists of words in the list of a key; an empty list if the key is missing.

        Args:
            key: The key.
            reader: Converts the text of each word; a ValueError is reported with file and line.

        Raises:
            InputError: The value is not a list of lists, or an entry of them is not a word or a number.
        """
        lists: list[list[_Value]] = []
        for number, node in enumerate(self._list(key), 1):
            if not isinstance(node, yaml.SequenceNode):
                complaint = f"must be a list, not {shown(value_of(node))}; write it in brackets, [] for none"
                raise self._entry_error(key, number, node, complaint)
            for entry in node.value:
                if not isinstance(entry, yaml.ScalarNode):
                    raise self._entry_error(key, number, entry, f"must be a list of words, not of {shown(entry)}")
            try:
                lists.append([reader(str(entry.value)) for entry in node.value])
            except ValueError as error:
                raise self._entry_error(key, number, node, str(error)) from None
        return lists

    def _entry_error(self, key: str, number: int, node: yaml.Node, complaint: str) -> InputError:
        """Return an error at an entry of a list."""
        return self._error_type(f"{self.path}:{line_of(node)}: {self._dotted(f'{key}[{number}]')}: {complaint}")

    def _dotted(self, key: str | None) -> str:
        """Return the dotted name of a key; empty for the complete file."""
        return ".".join(part for part in (self.name, dotted((key,)) if key else "") if part)

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


def read_section(path: Path, known: Iterable[str], error_type: type[InputError]) -> Section:
    """Return the top level of a YAML file.

    Args:
        path: Path of the file.
        known: Permitted keys.
        error_type: Type of the exceptions raised, including those of nested sections.

    Raises:
        InputError: The file is not valid YAML, or a key is duplicate or unknown.
    """
    return Section(path, "", read_yaml(path, error_type), known, error_type)


def one_of(what: str, known: Iterable[_Name]) -> Callable[[str], _Name]:
    """Return a reader that accepts one of the known names."""
    names = {str(name): name for name in known}

    def read(text: str) -> _Name:
        if text not in names:
            raise ValueError(f"unknown {what} {text!r}; {suggestion(text, names)}")
        return names[text]

    return read


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a reader that accepts integers within limits."""

    def read(text: str) -> int:
        if re.fullmatch("-?[0-9]{1,18}", text) is None or not low <= int(text) <= high:
            raise ValueError(f"must be an integer, {low} to {high}, not {text!r}")
        return int(text)

    return read
