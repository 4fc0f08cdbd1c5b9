"""Client of the debug adapter without a connection: requests in, messages out."""

from __future__ import annotations

from typing import Any

from controller.debug.adapter.session import AdapterSession
from controller.debug.adapter.wire import Request
from controller.debug.timeline import RunTimeline


class Editor:
    """Client of a session.

    Attributes:
        session: The session.
        messages: All messages of the adapter.
    """

    def __init__(self, line: RunTimeline) -> None:
        self.messages: list[dict[str, Any]] = []
        self.session = AdapterSession(line, self.messages.append)
        self._seq = 0

    def start(self, **launch: Any) -> None:
        """Go through the first requests."""
        self.call("initialize", adapterID="fx")
        self.call("launch", **launch)
        self.call("configurationDone")

    def send(self, command: str, **arguments: Any) -> list[dict[str, Any]]:
        """Send a request; return the messages that it causes, without a search."""
        self._seq += 1
        before = len(self.messages)
        self.session.answer(Request(self._seq, command, arguments))
        return self.messages[before:]

    def call(self, command: str, **arguments: Any) -> dict[str, Any]:
        """Send a request, search to the end, and return the body of the answer.

        Raises:
            AssertionError: The answer is an error.
        """
        response = next(each for each in self.send(command, **arguments) if each["type"] == "response")
        while self.session.is_searching:
            self.session.advance()
        assert response["success"], response
        body: dict[str, Any] = response.get("body", {})
        return body

    def error(self, command: str, **arguments: Any) -> str:
        """Send a request that is refused; return the message."""
        (response,) = self.send(command, **arguments)
        assert not response["success"], response
        assert response["body"]["error"]["format"] == response["message"]
        message: str = response["message"]
        return message

    def stop(self) -> dict[str, Any]:
        """Return the body of the last stop."""
        body: dict[str, Any] = next(each for each in reversed(self.messages) if each.get("event") == "stopped")["body"]
        return body

    def where(self) -> tuple[str, int]:
        """Return name and line of the top frame."""
        frame = self.call("stackTrace", threadId=1)["stackFrames"][0]
        return frame["name"], frame["line"]

    def variables(self, title: str) -> dict[str, str]:
        """Return the variables of a scope."""
        scopes = self.call("scopes", frameId=1)["scopes"]
        reference = next(each["variablesReference"] for each in scopes if each["name"] == title)
        return {
            each["name"]: each["value"] for each in self.call("variables", variablesReference=reference)["variables"]
        }
