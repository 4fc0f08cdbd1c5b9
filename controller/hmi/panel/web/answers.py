"""Parts of requests and answers that several routes share."""

from __future__ import annotations

import asyncio
from typing import Final, TypeVar

from pydantic import BaseModel, ValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from controller.hmi.panel.orders.replies import reply_text
from controller.hmi.panel.view.state import in_both
from controller.program.texts.operator import Text

MAX_BODY: Final = 4_096
"""Size limit of a request body, bytes."""
BODY_S: Final = 5.0
"""Time in which a request body must arrive after its header, s."""

Body = TypeVar("Body", bound=BaseModel)


def reply(status: int, key: str, **values: object) -> Response:
    """Return a response with the text of `replies.REPLIES` under this key."""
    return response(status, reply_text(key, **values))


def response(status: int, text: Text) -> Response:
    """Return a response with a text in both languages."""
    return JSONResponse({"ok": status == 200, "text": in_both(text)}, status_code=status)


async def body_of(request: Request, model: type[Body], what: str) -> Body | Response:
    """Return the JSON body of a request, or the response to one that is too long, too slow or malformed.

    Args:
        request: The request.
        model: Model of the body.
        what: Fields of the body, for the response.
    """
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > MAX_BODY:
                    return reply(400, "malformed", what=what)
        return model.model_validate_json(body)
    except TimeoutError:
        return reply(408, "too slow", seconds=f"{BODY_S:.0f}")
    except ValidationError:
        return reply(400, "malformed", what=what)


def whole_number(request: Request, name: str, default: str) -> int | None:
    """Return a non-negative integer from the query; None if it is malformed."""
    text = request.query_params.get(name, default)
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 18 else None
