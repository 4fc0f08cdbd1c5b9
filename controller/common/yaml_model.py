"""Validation of the values of a YAML file with pydantic models.

A model declares the limits of a key in its type and the remedy in its description::

    offset: int = Field(ge=0, le=65_535, description="write a decimal number from 0 to 65535, without quotes")
"""

from collections.abc import Mapping
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from controller.common.suggestion import suggestion
from controller.common.yaml_lines import KeyPath, LocatedMapping, shown

_REMEDIES = {
    "bool": "write true or false",
    "int": "write an integer",
    "float": "write a number",
    "string": "write text",
    "list": "write a list",
    "dict": "write a mapping: a key, a colon and a value per line",
    "model": "write a mapping: a key, a colon and a value per line",
}
"""Remedies of fields without a description, by the first word of the pydantic error type."""


class StrictModel(BaseModel):
    """Model that rejects unknown keys and does not convert types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


_Model = TypeVar("_Model", bound=BaseModel)


def validated(model: type[_Model], located: LocatedMapping, context: object = None) -> _Model | None:
    """Return the values of a mapping as a model; if they are invalid, record the faults and return None."""
    try:
        return model.model_validate(located.values, context=context)
    except ValidationError as error:
        for path, text in complaints(error, model, located.values):
            located.add_fault(path, text)
        return None


def complaints(error: ValidationError, model: type[BaseModel], values: object) -> list[tuple[KeyPath, str]]:
    """Return the path, the problem and the remedy of every invalid value, unknown keys first.

    If a key is misspelt, the correct key is also missing; only the misspelling is reported.

    Args:
        error: Validation error.
        model: Model that rejected the values.
        values: Input of the model.
    """
    texts: dict[KeyPath, str] = {}
    for fault in sorted(error.errors(include_url=False), key=lambda fault: fault["type"] != "extra_forbidden"):
        path = fault["loc"] if fault["type"] == "missing" else _path(fault["loc"], values)
        text = _text(fault, path, model)
        is_misspelt = fault["type"] == "missing" and f"unknown key; did you mean {path[-1]}?" in (
            texts.get((*path[:-1], key)) for key in _at(values, path[:-1])
        )
        if not is_misspelt:
            texts.setdefault(path, text)  # each type of a union reports an error
    return list(texts.items())


def _path(location: KeyPath, values: object) -> KeyPath:
    """Return the part of an error location that exists in the values, excluding union types and missing keys."""
    for depth, part in enumerate(location):
        is_key = isinstance(values, Mapping) and part in values
        if not is_key and not (isinstance(values, list) and isinstance(part, int)):
            return location[:depth]
        values = values[part]  # type: ignore[index]
    return location


def _at(values: Any, path: KeyPath) -> Mapping[str, object]:
    for part in path:
        values = values[part]
    return values  # type: ignore[no-any-return]


def _text(fault: ErrorDetails, path: KeyPath, model: type[BaseModel]) -> str:
    """Return the description of a pydantic error: problem and remedy."""
    remedy: str | None = None
    siblings: Mapping[str, FieldInfo] = model.model_fields
    fields = siblings
    for part in path:
        if isinstance(part, str):
            siblings, field = fields, fields.get(part)
            remedy, fields = (field.description, _fields(field.annotation)) if field else (None, fields)
    match fault["type"]:
        case "value_error":
            return str(fault["ctx"]["error"])
        case "missing":
            return f"is missing; {remedy or 'add it'}"
        case "extra_forbidden":
            return f"unknown key; {suggestion(str(path[-1]), siblings)}"
        case kind:
            remedy = remedy or _REMEDIES.get(kind.partition("_")[0], "correct it")
            return f"cannot be {shown(fault['input'])}; {remedy}"


def _fields(annotation: object) -> Mapping[str, FieldInfo]:
    """Return the fields of the model in an annotation such as ``list[Change]``; empty if it contains no model."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation.model_fields
    return next((fields for each in get_args(annotation) if (fields := _fields(each))), {})
