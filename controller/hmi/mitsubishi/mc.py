"""MC protocol over TCP: a client session with frames 1E as an FX3U has them, or 3E and 4E as an FX5U has them.

The code, binary or ASCII, is recognised from the first byte of each frame. Model codes: FX3U-ENET-ADP user's manual 7.6
(F3h); of the FX5U from memory (general knowledge).
"""

from __future__ import annotations

from typing import Final, Literal

from controller.common.connections import RECEIVE_BYTES, Answered, LateAnswer, begun
from controller.common.mitsubishi import commands_3e, mc1e
from controller.common.mitsubishi.mc1e import Abnormal1EError, Frame1E
from controller.common.mitsubishi.mc3e import Frame3E
from controller.common.mitsubishi.requests import FrameError, RequestError, TypeName
from controller.hmi.mitsubishi.execution import execute
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError, AccessSource, DeviceAccess
from controller.hmi.serving.endpoints import EndpointNames, TcpEndpoint, TcpSettings

FrameName = Literal["1e", "3e"]
FRAMES: Final[tuple[FrameName, ...]] = ("1e", "3e")
"""Frames that a port can serve; 3e includes 4E."""
DEFAULT_PORT: Final = 5007
"""Default TCP port (assumed; a PLC has no default, it is set in its parameters)."""
MC_NAMES: Final = EndpointNames(
    "MC server", "the MC protocol", "--mc-host", "--mc-port", "--mc-allow-remote", "omit --mc"
)

_CODES_1E: Final = {
    AccessRefusal.NOT_READY: Abnormal1EError(mc1e.MODE_ERROR),
    AccessRefusal.NO_DEVICE: RequestError(mc1e.TOO_MANY_POINTS),
    AccessRefusal.NOT_WRITABLE: Abnormal1EError(mc1e.MODE_ERROR),
    AccessRefusal.BAD_VALUE: Abnormal1EError(mc1e.MODE_ERROR),
    AccessRefusal.NOT_SUPPORTED: Abnormal1EError(mc1e.REMOTE_ERROR),
}
_CODES_3E: Final = {
    AccessRefusal.NOT_READY: RequestError(0xC05F),
    AccessRefusal.NO_DEVICE: RequestError(0xC056),
    AccessRefusal.NOT_WRITABLE: RequestError(commands_3e.NO_SUCH_DEVICE),
    AccessRefusal.BAD_VALUE: RequestError(commands_3e.WRONG_CONTENTS),
    AccessRefusal.NOT_SUPPORTED: RequestError(0xC05F),
}
"""C05Fh: the request cannot be executed for this CPU."""
_MODEL_1E: Final = TypeName(0xF3)
_MODEL_3E: Final = TypeName(0x4A23, "FX5UCPU")


class McSession:
    """Session of one client."""

    def __init__(self, access: DeviceAccess, frame: FrameName) -> None:
        """Create the session of a client.

        Args:
            access: Devices of the PLC as the client may read and write them.
            frame: Frame of the port.
        """
        self._access = access
        self._frames: type[Frame1E | Frame3E] = Frame1E if frame == "1e" else Frame3E
        self._codes = _CODES_1E if frame == "1e" else _CODES_3E
        self._model = _MODEL_1E if frame == "1e" else _MODEL_3E

    @property
    def has_name(self) -> bool:
        """True if the client has told the name of its operator."""
        return self._access.has_name

    def on_disconnect(self) -> None:
        """Notice that the client is gone."""
        self._access.on_disconnect()

    def answer(self, received: memoryview) -> Answered:
        """Answer the complete frames; data that is not a frame is invalid."""
        used = requests = 0
        answers: list[bytes] = []
        while used < len(received):
            data = bytes(received[used:])
            try:
                frame = self._frames.of(data)
                length = frame.request_length(data)
            except FrameError:
                return Answered(used, b"".join(answers), requests, is_valid=False)
            if length is None or length > len(data):
                is_too_long = length is not None and length > RECEIVE_BYTES
                return Answered(used, b"".join(answers), requests, is_valid=not is_too_long)
            answer = begun(self._answer(frame, data[:length]))
            requests += 1
            used += length
            if isinstance(answer, LateAnswer):
                return Answered(used, b"".join(answers), requests, late=answer)
            answers.append(answer)
        return Answered(used, b"".join(answers), requests)

    async def _answer(self, frame: Frame1E | Frame3E, data: bytes) -> bytes:
        self._access.on_request()
        try:
            request = frame.decode_request(data)
            return frame.encode_reply(request, await execute(self._access, request, self._model))
        except RequestError as error:
            return frame.encode_error(data, error)
        except AccessRefusedError as error:
            return frame.encode_error(data, self._codes[error.refusal])


def mc_tcp(
    source: AccessSource, frame: FrameName, settings: TcpSettings, names: EndpointNames = MC_NAMES
) -> TcpEndpoint:
    """Return a TCP port with the MC protocol.

    Raises:
        ServerError: The address is invalid.
    """
    return TcpEndpoint(lambda peer: McSession(source.session(peer), frame), settings, names)
