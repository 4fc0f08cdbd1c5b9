"""Messages from a browser: orders, each with an `id` that the reply repeats."""

from __future__ import annotations

import json
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from controller.hmi.panel.orders.session import Button

Id = Annotated[int, Field(ge=0, le=2**53)] | Annotated[str, Field(max_length=64)]
Name = Annotated[str, Field(max_length=64)]
Word = Annotated[int, Field(ge=0, le=0xFFFF)]


class MessageError(ValueError):
    """Raised for a malformed message.

    Attributes:
        id: The `id` of the message, or None if it is missing or invalid.
    """

    def __init__(self, location: str, id_: int | str | None) -> None:
        """Initialise the error with the location of the invalid part of the message."""
        super().__init__(location)
        self.id = id_


class _Order(BaseModel):
    """Order.

    Attributes:
        id: Repeated by the reply.
        seen: Number of the view in which the order was given; None if it is executed however late it arrives.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    id: Id
    seen: int | None = Field(default=None, ge=0, le=2**53)


class CommandOrder(_Order):
    """Request to issue a command from the command table."""

    type: Literal["command"]
    command: Name


class SetOrder(_Order):
    """Request to change a set-point; the value is in counts of its register."""

    type: Literal["set"]
    name: Name
    value: int


class AcknowledgeOrder(_Order):
    """Request to acknowledge one alarm, or all alarms."""

    type: Literal["acknowledge"]
    alarm: Word | None = None


class ShelveOrder(_Order):
    """Request to shelve a warning for a number of minutes."""

    type: Literal["shelve"]
    alarm: Word
    minutes: int


class UnshelveOrder(_Order):
    """Request to end the shelving of an alarm."""

    type: Literal["unshelve"]
    alarm: Word


class JogOrder(_Order):
    """Request to jog an output, repeated while the button is held."""

    type: Literal["jog"]
    output: Name
    hold: bool


class BoxOrder(_Order):
    """Press or release of a button of the simulated operator box."""

    type: Literal["box"]
    button: Button
    pressed: bool


class PaceOrder(_Order):
    """Request to change the speed of simulated time, percent."""

    type: Literal["pace"]
    percent: Word


class ForceOrder(_Order):
    """Request to force an input to a raw level; level 2 ends the forcing."""

    type: Literal["force"]
    point: Name
    level: Literal[0, 1, 2]


Order = (
    CommandOrder
    | SetOrder
    | AcknowledgeOrder
    | ShelveOrder
    | UnshelveOrder
    | JogOrder
    | BoxOrder
    | PaceOrder
    | ForceOrder
)

_ORDERS: Final[TypeAdapter[Order]] = TypeAdapter(Annotated[Order, Field(discriminator="type")])
_IDS: Final[TypeAdapter[int | str]] = TypeAdapter(Id, config=ConfigDict(strict=True))


def read_order(text: str) -> Order:
    """Parse one message from a browser.

    Raises:
        MessageError: The message is malformed.
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
