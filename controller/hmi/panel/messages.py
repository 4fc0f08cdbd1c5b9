"""What a browser may send over its socket: orders, each with an `id` for the answer."""

from __future__ import annotations

import json
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from controller.hmi.panel.hand import Button

Id = Annotated[int, Field(ge=0, le=2**53)] | Annotated[str, Field(max_length=64)]
Name = Annotated[str, Field(max_length=64)]
Word = Annotated[int, Field(ge=0, le=0xFFFF)]


class MessageError(ValueError):
    """A message that is no order.

    Attributes:
        id: Its `id`, where it has a usable one.
    """

    def __init__(self, what: str, id_: int | str | None) -> None:
        """Take what is wrong."""
        super().__init__(what)
        self.id = id_


class _Order(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    id: Id


class CommandOrder(_Order):
    """A press of the command table."""

    type: Literal["command"]
    command: Name


class SetOrder(_Order):
    """A set-point, in counts of its register."""

    type: Literal["set"]
    name: Name
    value: int


class AcknowledgeOrder(_Order):
    """One alarm, or all."""

    type: Literal["acknowledge"]
    alarm: Word | None = None


class ShelveOrder(_Order):
    """A warning out of the way for a time."""

    type: Literal["shelve"]
    alarm: Word
    minutes: int


class UnshelveOrder(_Order):
    """The end of a shelf."""

    type: Literal["unshelve"]
    alarm: Word


class JogOrder(_Order):
    """An output held by hand: renewed while held."""

    type: Literal["jog"]
    output: Name
    hold: bool


class BoxOrder(_Order):
    """A button of the simulated operator box."""

    type: Literal["box"]
    button: Button
    pressed: bool


class PaceOrder(_Order):
    """The speed of simulated time, percent."""

    type: Literal["pace"]
    percent: Word


class ForceOrder(_Order):
    """An input held at a raw level; 2 = let go."""

    type: Literal["force"]
    point: Name
    level: Literal[0, 1, 2]


Order = (
    CommandOrder | SetOrder | AcknowledgeOrder | ShelveOrder | UnshelveOrder | JogOrder | BoxOrder | PaceOrder
    | ForceOrder
)  # fmt: skip

_ORDERS: Final[TypeAdapter[Order]] = TypeAdapter(Annotated[Order, Field(discriminator="type")])
_IDS: Final[TypeAdapter[int | str]] = TypeAdapter(Id, config=ConfigDict(strict=True))


def read_order(text: str) -> Order:
    """Read one message of a browser.

    Raises:
        MessageError: It is no order.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MessageError("JSON", None) from error
    try:
        return _ORDERS.validate_python(message)
    except ValidationError as error:
        first = error.errors()[0]
        raise MessageError(".".join(str(part)[:64] for part in first["loc"]) or "type", _id_of(message)) from error


def _id_of(message: object) -> int | str | None:
    try:
        return _IDS.validate_python(message.get("id") if isinstance(message, dict) else None)
    except ValidationError:
        return None
