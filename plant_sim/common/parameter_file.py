"""Reader of parameter files: YAML sections whose entries have a value, a unit, a source and a note."""

import dataclasses
from collections import ChainMap
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar, cast, get_type_hints

import yaml
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, create_model

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.common.yaml_lines import LocatedMapping, dotted, read_yaml, unfold
from controller.common.yaml_model import StrictModel, complaints, validated
from plant_sim.common.limits import SpecError, require
from plant_sim.common.units import unit_of

Value = bool | int | float

_Specs = TypeVar("_Specs")


class ParameterEntry(StrictModel):
    """Entry of one parameter in a file."""

    value: Value = Field(description="write a number (powers of ten as 1.0e-9), true or false")
    unit: str = Field(description="write the unit that matches the name suffix, or - for none, in quotes")
    source: Literal["paper", "catalogue", "computed", "assumed"] = Field(
        description="write paper, catalogue, computed or assumed"
    )
    note: str = Field("", description="write the note in quotes")


class RangedEntry(ParameterEntry):
    """Parameter entry that may also state the plausible range of its value."""

    range: Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)] | None = Field(
        None, description="write the lowest and the highest plausible value: [0.01, 0.05]"
    )


class ParameterReader(Generic[_Specs]):
    """Reader of one kind of parameter file.

    The file has one section for each field of a frozen dataclass; the type of the field is a frozen spec dataclass
    with one field for each parameter of the section. A spec rejects invalid values with a `SpecError`.
    """

    def __init__(
        self,
        specs: type[_Specs],
        error: type[InputError],
        *,
        subject: str,
        entry: type[ParameterEntry] = ParameterEntry,
    ) -> None:
        """Initialise the reader.

        Args:
            specs: Class with one spec per section.
            error: Type of the exception raised for an invalid file or value.
            subject: Name of the described object in error messages, for example ``machine``.
            entry: Model of an entry.
        """
        self._specs = specs
        self._error = error
        self._subject = subject
        self._entry = entry
        self._checkers: dict[str, type[BaseModel]] = {}

    def load(self, path: Path) -> _Specs:
        """Read and validate a file.

        Raises:
            InputError: The file cannot be read or is invalid; the reader's error type is raised.
        """
        located, file = self._read(path)
        try:
            return self._specs(
                **{section: self._build(section, _values(section, entries)) for section, entries in file}
            )
        except SpecError as error:
            line = located.line_of(tuple(error.key.split(".", maxsplit=1)))
            raise self._error(f"{path}:{line}: {error.key}: {error.complaint}") from None

    def entries(self, path: Path) -> dict[str, ParameterEntry]:
        """Return the entries of a file by dotted name.

        Raises:
            InputError: The file cannot be read or is invalid; the reader's error type is raised.
        """
        _, file = self._read(path)
        return {f"{section}.{key}": entry for section, entries in file for key, entry in entries.items()}

    def changed(self, specs: _Specs, values: Mapping[str, Value]) -> _Specs:
        """Return the specs with some parameters changed.

        Args:
            specs: Specs to change; they are not modified.
            values: New values by dotted name, for example ``{"cups.planting_frequency_per_min": 60}``.

        Raises:
            InputError: A name is unknown or a value is invalid; the reader's error type is raised.
        """
        sections: dict[str, dict[str, Value]] = {}
        for name, value in values.items():
            section, dot, key = name.partition(".")
            if not dot:
                raise self._error(f"{name}: not a dotted name; write section.parameter")
            if section not in self._section_types:
                remedy = suggestion(section, self._section_types)
                raise self._error(f"{name}: unknown section of the {self._subject}; {remedy}")
            if key not in self._checker(section).model_fields:
                remedy = suggestion(key, self._checker(section).model_fields)
                raise self._error(f"{name}: unknown parameter of the {self._subject}; {remedy}")
            sections.setdefault(section, {})[key] = value
        try:
            built = {
                section: self._build(section, dataclasses.asdict(getattr(specs, section)) | new)
                for section, new in sections.items()
            }
            changed: _Specs = dataclasses.replace(cast("Any", specs), **built)
            return changed
        except SpecError as error:
            raise self._error(f"{error.key}: {error.complaint}") from None

    def _read(self, path: Path) -> tuple[LocatedMapping, BaseModel]:
        """Return the entries of a file with their line numbers, and the validated model."""
        located = unfold(read_yaml(path, self._error, loader=yaml.SafeLoader), depth=3, convert=_plain)
        located.values = {name: _with_merged_fields(entries) for name, entries in located.values.items()}
        file = validated(self._file_model, located)
        if file is None or located.faults:
            # missing keys last: a misspelt key also causes a fault for the missing correct key
            first = min(located.faults, key=lambda fault: (fault.path not in located.lines, fault.line))
            raise self._error(f"{path}:{first}")
        return located, file

    @cached_property
    def _section_types(self) -> dict[str, Any]:
        """Spec class of each section."""
        return get_type_hints(self._specs)

    @cached_property
    def _file_model(self) -> type[BaseModel]:
        """Model with all sections of the file."""
        fields: dict[str, Any] = dict.fromkeys(self._section_types, (dict[str, self._entry], ...))  # type: ignore[name-defined]
        return create_model(self._subject, __base__=StrictModel, **fields)

    def _checker(self, section: str) -> type[BaseModel]:
        """Return a model with the keys and types of a section."""
        if section not in self._checkers:
            hints = get_type_hints(self._section_types[section])
            fields: dict[str, Any] = {key: (hint, ...) for key, hint in hints.items()}
            model = create_model(section, __config__=ConfigDict(extra="forbid", strict=True), **fields)
            self._checkers[section] = model
        return self._checkers[section]

    def _build(self, section: str, values: Mapping[str, Value]) -> Any:
        """Return the spec of a section; the key of a `SpecError` is the dotted name."""
        model = self._checker(section)
        try:
            return self._section_types[section](**dict(model.model_validate(dict(values))))
        except ValidationError as error:
            path, complaint = complaints(error, model, values)[0]
            raise SpecError(f"{section}.{dotted(path)}", complaint) from None
        except SpecError as error:
            raise SpecError(f"{section}.{error.key}", error.complaint) from None


def _plain(node: yaml.Node) -> object:
    """Return the Python value of a node according to YAML 1.1."""
    try:
        return yaml.constructor.SafeConstructor().construct_document(node)
    except (yaml.YAMLError, ValueError, LookupError, AttributeError):
        raise ValueError("must be a number, text, true or false") from None


def _with_merged_fields(entries: object) -> object:
    """Return the entries of a section, including fields merged from other entries with the YAML key ``<<``."""
    if not isinstance(entries, dict):
        return entries
    merged = dict(entries)
    for key, entry in entries.items():
        base = entry.get("<<") if isinstance(entry, dict) else None
        bases = base if isinstance(base, list) else [base]
        if all(isinstance(each, dict) for each in bases):
            merged[key] = {**ChainMap(*bases), **{name: value for name, value in entry.items() if name != "<<"}}
    return merged


def _values(section: str, entries: Mapping[str, ParameterEntry]) -> dict[str, Value]:
    """Return the values of a section.

    Raises:
        SpecError: The unit of a parameter does not match the suffix of its name, or its value is outside its range.
    """
    for key, entry in entries.items():
        require(entry.unit == unit_of(key), f"{section}.{key}", f"must have unit {unit_of(key)}, not {entry.unit}")
        if isinstance(entry, RangedEntry) and entry.range is not None:
            low, high = entry.range
            require(low <= high, f"{section}.{key}", f"has range [{low:g}, {high:g}]; write the lower limit first")
            within = low <= entry.value <= high
            require(within, f"{section}.{key}", f"must be within its range [{low:g}, {high:g}], not {entry.value:g}")
    return {key: entry.value for key, entry in entries.items()}
