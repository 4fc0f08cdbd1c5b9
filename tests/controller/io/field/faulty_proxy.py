"""Proxy between a Modbus TCP client and its server that disturbs answers at random."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
from collections import Counter
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

HEADER_BYTES: Final = 7
UNIT_AT: Final = 6
LONGEST_DEAF: Final = 15
"""Most connections in a row that are accepted and not answered, as by a device that boots."""


def inverted(frame: bytes) -> bytes:
    """Return a frame with the header of an answer and the opposite data: a wrong answer must not be accepted."""
    return frame[: HEADER_BYTES + 2] + bytes(byte ^ 0xFF for byte in frame[HEADER_BYTES + 2 :])


class FaultyProxy:
    """Proxy for one client at a time, with a fault in some of the exchanges.

    Attributes:
        port: TCP port.
        faults: Number of injected faults by kind.
        share: Probability of a fault in an exchange; 0 = none.
        limit: Number of faults after which none is injected.
        ended: Number of connections that have ended; see `wait_until_ended`.
    """

    def __init__(self, server_port: int, seed: int) -> None:
        self.faults: Counter[str] = Counter()
        self.share = 0.0
        self.limit = 0
        self.ended = 0
        self._is_ended = threading.Condition()
        self._server_port = server_port
        self._random = random.Random(seed)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._client: socket.socket | None = None
        self._server: socket.socket
        self._old: dict[int, bytes] = {}
        self._held = b""
        self._deaf = 0
        self._kinds: dict[str, Callable[[bytes], bool]] = {
            name.removeprefix("_fault_"): getattr(self, name) for name in dir(self) if name.startswith("_fault_")
        }
        self._thread = threading.Thread(target=self._run)

    @property
    def kinds(self) -> set[str]:
        return {*self._kinds}

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._client.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()

    def wait_until_ended(self, connections: int) -> None:
        """Wait until no request of the first connections can reach the server any more."""
        with self._is_ended:
            assert self._is_ended.wait_for(lambda: self.ended >= connections, timeout=60)

    def _run(self) -> None:
        while True:
            try:
                self._client, _ = self._listener.accept()
            except OSError:
                return
            self._serve()
            with self._is_ended:
                self.ended += 1
                self._is_ended.notify_all()

    def _serve(self) -> None:
        assert self._client is not None
        with self._client, contextlib.suppress(OSError):
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._deaf:
                self._deaf -= 1
                self._wait_for_the_end()
                return
            with socket.create_connection(("127.0.0.1", self._server_port)) as self._server:
                self._server.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                while self._relay(self._frame(self._client)):
                    pass

    def _relay(self, request: bytes) -> bool:
        """Serve a request; return False if the connection ends."""
        if sum(self.faults.values()) >= self.limit or self._random.random() >= self.share:
            answer = self._ask(request)
            self._old[request[HEADER_BYTES]] = answer
            self._send(answer)
            return True
        kind = self._random.choice(sorted(self._kinds))
        self.faults[kind] += 1
        return self._kinds[kind](request)

    # kinds of faults; each returns False if the connection ends

    def _fault_wrong_unit(self, request: bytes) -> bool:
        answer = inverted(self._ask(request))
        self._send(answer[:UNIT_AT] + bytes([answer[UNIT_AT] ^ 0x55]) + answer[UNIT_AT + 1 :])
        return True

    def _fault_wrong_transaction(self, request: bytes) -> bool:
        answer = inverted(self._ask(request))
        other = int.from_bytes(answer[:2]) + self._random.randrange(1, 1 << 16)
        self._send((other & 0xFFFF).to_bytes(2) + answer[2:])
        return True

    def _fault_short(self, request: bytes) -> bool:
        answer = self._ask(request)
        self._send(answer[: self._random.randrange(1, len(answer))])
        return True

    def _fault_short_with_its_length(self, request: bytes) -> bool:
        answer = self._ask(request)
        cut = answer[: self._random.randrange(HEADER_BYTES + 1, len(answer))]
        self._send(cut[:4] + (len(cut) - 6).to_bytes(2) + cut[6:])
        return True

    def _fault_late(self, request: bytes) -> bool:
        """Send the answer only on the next connection, before its first answer."""
        self._held = inverted(self._ask(request))
        self._wait_for_the_end()
        return False

    def _fault_garbage(self, request: bytes) -> bool:
        self._ask(request)
        self._send(self._random.randbytes(self._random.randrange(1, 40)))
        return True

    def _fault_garbage_before_the_answer(self, request: bytes) -> bool:
        self._send(self._random.randbytes(self._random.randrange(1, 40)) + self._ask(request))
        return True

    def _fault_half_open(self, request: bytes) -> bool:
        self._wait_for_the_end()
        return False

    def _fault_boots(self, request: bytes) -> bool:
        """Close the connection, and accept the next ones without an answer."""
        self._deaf = self._random.randrange(1, LONGEST_DEAF) if self._random.random() < 0.05 else 1
        return False

    def _fault_cut_in_the_answer(self, request: bytes) -> bool:
        answer = self._ask(request)
        self._send(answer[: self._random.randrange(len(answer))])
        return False

    def _fault_cut_in_the_request(self, request: bytes) -> bool:
        self._server.sendall(request[: self._random.randrange(len(request))])
        return False

    def _fault_duplicated_old_answer(self, request: bytes) -> bool:
        """Send the old answer of the same function, with the opposite data, before the answer."""
        old = inverted(self._old.get(request[HEADER_BYTES], b""))
        self._send(old + self._ask(request))
        return True

    def _fault_duplicated_answer(self, request: bytes) -> bool:
        """Send the answer twice; the second one arrives before or with the answer to the next request."""
        answer = self._ask(request)
        self._send(answer + inverted(answer))
        return True

    def _fault_exception(self, request: bytes) -> bool:
        """Answer with an exception; the request is executed in half of the cases."""
        if self._random.random() < 0.5:
            self._ask(request)
        self._send(request[:4] + b"\x00\x03" + request[6:7] + bytes([request[7] | 0x80, 4]))
        return True

    # sockets

    def _ask(self, request: bytes) -> bytes:
        self._server.sendall(request)
        return self._frame(self._server)

    def _send(self, data: bytes) -> None:
        assert self._client is not None
        held, self._held = self._held, b""
        self._client.sendall(held + data)

    def _wait_for_the_end(self) -> None:
        assert self._client is not None
        while self._client.recv(1_000):
            pass

    @staticmethod
    def _frame(connection: socket.socket) -> bytes:
        data = b""
        while len(data) < HEADER_BYTES or len(data) < 6 + int.from_bytes(data[4:6]):
            wanted = (HEADER_BYTES if len(data) < HEADER_BYTES else 6 + int.from_bytes(data[4:6])) - len(data)
            chunk = connection.recv(wanted)
            if not chunk:
                raise ConnectionResetError
            data += chunk
        return data
