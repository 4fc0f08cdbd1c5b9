"""Field devices with TLS."""

from __future__ import annotations

import socket
import ssl
import threading
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import trustme

from controller.common.errors import InputError
from controller.io.field.field_file import FieldFileError
from controller.io.link import LinkError
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    OUTPUT_TAGS,
    PATIENT_MS,
    FieldRig,
    at_rest,
    device,
    file_of,
    wires,
)
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import TcpModule


class Security:
    """Certificate authority and certificates of both sides."""

    def __init__(self, folder: Path) -> None:
        self.authority = trustme.CA()
        self.authority.cert_pem.write_to_path(folder / "ca.pem")
        client = self.authority.issue_cert("controller@farm.example")
        client.cert_chain_pems[0].write_to_path(folder / "own.pem")
        client.private_key_pem.write_to_path(folder / "own.key")
        (folder / "own.key").chmod(0o600)
        self.context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        self.context.verify_mode = ssl.CERT_REQUIRED
        self.authority.configure_trust(self.context)
        self.authority.issue_cert("io.farm.example").configure_cert(self.context)

    def wrap(self, plain: socket.socket) -> socket.socket:
        return self.context.wrap_socket(plain, server_side=True)


def tls_way(port: int, *more: str) -> str:
    names = ["ca: ca.pem", "certificate: own.pem", "key: own.key", *more]
    return f"tls: {{host: 127.0.0.1, port: {port}, {', '.join(names)}}}"


def one_box(stack: ExitStack, folder: Path, way: str, timeout_ms: int = PATIENT_MS) -> FieldRig:
    tags = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
    rig = FieldRig(file_of(folder, device("cabinet", "coils", way, tags, timeout_ms=timeout_ms)), [])
    stack.callback(rig.link.close)
    return rig


def test_a_key_that_others_can_read_is_refused(stack: ExitStack, tmp_path: Path) -> None:
    Security(tmp_path)
    (tmp_path / "own.key").chmod(0o604)
    with pytest.raises(FieldFileError, match=r"key: .*own\.key: accessible to other users; run chmod 600 on it$"):
        one_box(stack, tmp_path, tls_way(1))


def test_a_device_with_tls(stack: ExitStack, tmp_path: Path) -> None:
    box = Box()
    at_rest(box)
    module = stack.enter_context(TcpModule(box, Security(tmp_path).wrap))
    rig = one_box(stack, tmp_path, tls_way(module.port, "server_name: io.farm.example"))
    rig.start()
    rig.move()
    assert any(box.outputs)
    rig.scan(20)
    assert (rig.is_aborted, rig.events) == (False, [])


def test_a_tls_handshake_longer_than_the_timeout_is_continued(stack: ExitStack, tmp_path: Path) -> None:
    """A small device computes for longer than the timeout of an answer; the scan must not wait for it."""
    security, go, connections = Security(tmp_path), threading.Event(), [0]
    box = Box()

    def wrap(plain: socket.socket) -> socket.socket:
        connections[0] += 1
        go.wait(PATIENT_MS / 1_000)
        return security.wrap(plain)

    module = stack.enter_context(TcpModule(box, wrap))
    way = tls_way(module.port, "server_name: io.farm.example")
    link = one_box(stack, tmp_path, way, timeout_ms=200).link
    for _ in range(2):
        with pytest.raises(LinkError, match="the TLS handshake is not complete"):
            link.open()
    go.set()
    for _ in range(100):
        with suppress(LinkError):
            link.open()
            break
    assert link.read_inputs()
    assert connections == [1]


def test_a_device_with_another_name_is_not_used(stack: ExitStack, tmp_path: Path) -> None:
    box = Box()
    module = stack.enter_context(TcpModule(box, Security(tmp_path).wrap))
    rig = one_box(stack, tmp_path, tls_way(module.port, "server_name: other.farm.example"))
    with pytest.raises(LinkError, match="cabinet"):
        rig.link.open()
    assert box.requests == []


def test_an_invalid_certificate_is_reported_at_the_start(stack: ExitStack, tmp_path: Path) -> None:
    Security(tmp_path)
    (tmp_path / "own.key").write_text("no key", encoding="utf-8")
    with pytest.raises(InputError, match=r"own\.key") as error:
        one_box(stack, tmp_path, tls_way(802))
    assert "\n" not in str(error.value)
