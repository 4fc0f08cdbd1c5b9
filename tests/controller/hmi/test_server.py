"""Modbus server of the controller: framing, limits, TLS, malformed data."""

from __future__ import annotations

import os
import random
import socket
import ssl
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import trustme

from controller.hmi.access.status_registers import R_NAME
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.panel.modbus.naming import PANEL_NAME, name_words
from controller.hmi.serving.endpoints import ServerError
from tests.controller.common.modbus_rig import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    Client,
    exception,
    frame,
    read_pdu,
)
from tests.controller.hmi.hmi_rig import IDLE_S, READ_D0, HmiRig, let_pass, until, write_words, written
from tests.sampling import one_in

FIRST_COMMAND = 400
ALLOWED = {1, 2, 3, 4, 5, 6, 15, 16, 23, 43}
SIX_INVALID_BYTES = b"\xde\xad\xbe\xef\xde\xad"


@pytest.fixture
def rig() -> Iterator[HmiRig]:
    with HmiRig() as rig:
        yield rig


@pytest.fixture
def client(rig: HmiRig) -> Client:
    return rig.client()


@pytest.fixture(scope="module")
def shared() -> Iterator[HmiRig]:
    """Yield a server for tests whose requests change nothing."""
    with HmiRig() as rig:
        yield rig


# --- framing --------------------------------------------------------------------------------------


def test_thirty_requests_in_one_segment_are_answered_in_order(client: Client) -> None:
    client.send(b"".join(frame(read_pdu(3, n, 1), transaction=n, unit=n) for n in range(1, 31)))
    assert [client.receive()[:2] for _ in range(30)] == [(n, n) for n in range(1, 31)]


def test_many_requests_that_exceed_every_buffer(client: Client) -> None:
    client.send(b"".join(frame(READ_D0, transaction=n) for n in range(2_000)))
    assert [client.receive()[0] for _ in range(2_000)] == list(range(2_000))


def test_slow_reader_gets_every_response_before_a_bad_header_closes_the_connection(rig: HmiRig) -> None:
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        slow.settimeout(10.0)
        slow.connect(("127.0.0.1", rig.server.port))
        slow.sendall(frame(READ_D0))
        assert len(slow.recv(11, socket.MSG_WAITALL)) == 11
        assert rig.server.modbus is not None
        [connection] = rig.server.modbus._frontend.connections
        assert connection._transport is not None
        connection._transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4_096)
        slow.sendall(frame(read_pdu(3, 0, 125)) * 4_000 + b"\0\1\0\1\0\6\1")
        received = 0
        while chunk := slow.recv(1_024):
            received += len(chunk)
    assert received == 4_000 * (9 + 250)


@pytest.mark.parametrize(
    "header",
    ["0001 0001 0006 01", "0001 ff00 0006 01", "0001 0000 0000 01", "0001 0000 0001 01", "0001 0000 00ff 01"],
)
def test_bad_header_closes_the_connection_after_the_earlier_responses(rig: HmiRig, client: Client, header: str) -> None:
    bystander = rig.client()
    client.send(frame(READ_D0, transaction=7) + frame(READ_D0, transaction=8) + bytes.fromhex(header) + READ_D0)
    assert [client.receive()[0] for _ in range(2)] == [7, 8]
    assert client.rest() == b""
    assert rig.server.traffic.bad_frames == 1
    assert bystander.ask(READ_D0)[0] == 3


# --- requests -------------------------------------------------------------------------------------


@pytest.mark.parametrize("function_code", one_in(7, sorted(set(range(256)) - ALLOWED)))
def test_unsupported_functions_are_refused(shared: HmiRig, function_code: int) -> None:
    with Client(shared.server.port) as client:
        for body in (b"", bytes(4), bytes(20)):
            assert client.ask(bytes([function_code]) + body) == exception(function_code, ILLEGAL_FUNCTION)


@pytest.mark.parametrize("function_code", sorted(ALLOWED - {43}))
def test_supported_functions_require_a_body(shared: HmiRig, function_code: int) -> None:
    with Client(shared.server.port) as client:
        assert client.ask(bytes([function_code])) == exception(function_code, ILLEGAL_VALUE)


@pytest.mark.parametrize(
    ("function_code", "counts"),
    [(1, (0, 2_001, 65_535)), (2, (0, 2_001, 65_535)), (3, (0, 126, 65_535)), (4, (0, 126, 65_535))],
)
def test_counts_above_the_response_limit_are_refused(
    client: Client, function_code: int, counts: tuple[int, ...]
) -> None:
    for wanted in counts:
        assert client.ask(read_pdu(function_code, 0, wanted)) == exception(function_code, ILLEGAL_VALUE)


@pytest.mark.parametrize(
    "request_pdu",
    [
        pytest.param(READ_D0 + b"\0", id="read, a byte too long"),
        pytest.param(READ_D0[:-1], id="read, a byte too short"),
        pytest.param(struct.pack(">BHH", 5, FIRST_COMMAND, 1), id="a single coil of 1"),
        pytest.param(struct.pack(">BHH", 5, FIRST_COMMAND, 0xFF01), id="a single coil of ff01"),
        pytest.param(struct.pack(">BHHB", 5, FIRST_COMMAND, 0xFF00, 0), id="single coil, too long"),
        pytest.param(struct.pack(">BHHB", 6, 521, 20, 0), id="single register, too long"),
        pytest.param(struct.pack(">BHB", 6, 521, 20), id="single register, too short"),
        pytest.param(struct.pack(">BHHB", 15, FIRST_COMMAND, 0, 0), id="no coils"),
        pytest.param(struct.pack(">BHHBB", 15, FIRST_COMMAND, 9, 1, 1), id="nine coils in a byte"),
        pytest.param(struct.pack(">BHHBH", 15, FIRST_COMMAND, 8, 2, 1), id="eight coils in two bytes"),
        pytest.param(struct.pack(">BHHBB", 15, FIRST_COMMAND, 8, 2, 1), id="coils, fewer bytes than declared"),
        pytest.param(struct.pack(">BHHB", 15, 0, 1_969, 247) + bytes(247), id="1969 coils"),
        pytest.param(struct.pack(">BHHB", 16, 521, 0, 0), id="no registers"),
        pytest.param(struct.pack(">BHHBH", 16, 521, 2, 4, 20), id="registers, fewer bytes than declared"),
        pytest.param(struct.pack(">BHHBH", 16, 521, 1, 4, 20), id="registers, count and bytes differ"),
        pytest.param(struct.pack(">BHHBHB", 16, 521, 1, 2, 20, 0), id="registers, too long"),
        pytest.param(struct.pack(">BHHB", 16, 512, 124, 248) + bytes(244), id="124 registers"),
        pytest.param(struct.pack(">BHHHHBH", 23, 0, 0, 521, 1, 2, 20), id="read none, write one"),
        pytest.param(struct.pack(">BHHHHBH", 23, 0, 126, 521, 1, 2, 20), id="read 126, write one"),
        pytest.param(struct.pack(">BHHHHB", 23, 0, 1, 521, 0, 0), id="read one, write none"),
        pytest.param(struct.pack(">BHHHHB", 23, 0, 1, 512, 122, 244) + bytes(242), id="write 122 and read"),
        pytest.param(struct.pack(">BHHHHBH", 23, 0, 1, 521, 1, 4, 20), id="write and read, count and bytes differ"),
    ],
)
def test_wrong_lengths_and_counts_are_refused(shared: HmiRig, request_pdu: bytes) -> None:
    with Client(shared.server.port) as client:
        assert client.ask(request_pdu) == exception(request_pdu[0], ILLEGAL_VALUE)
    assert not shared.twin.runtime._orders
    assert shared.audits == []


@pytest.mark.parametrize(
    "request_pdu",
    [
        pytest.param(struct.pack(">BHHB", 15, 0, 1_968, 246) + bytes(246), id="1968 coils"),
        pytest.param(struct.pack(">BHHB", 16, 512, 123, 246) + bytes(246), id="123 registers"),
        pytest.param(struct.pack(">BHHHHB", 23, 0, 125, 512, 121, 242) + bytes(242), id="121 registers and 125 read"),
    ],
)
def test_largest_writes_are_refused_by_address(client: Client, request_pdu: bytes) -> None:
    assert client.ask(request_pdu) == exception(request_pdu[0], ILLEGAL_ADDRESS)


# --- identification---------------------------------------------------------------------------------


def identity(client: Client, read_code: int, wanted: int = 0) -> dict[int, str]:
    answer = client.ask(bytes([43, 14, read_code, wanted]))
    assert answer[:7] == bytes([43, 14, read_code, 0x81, 0, 0, answer[6]]), answer
    objects, rest = {}, answer[7:]
    while rest:
        number, length = rest[0], rest[1]
        objects[number], rest = rest[2 : 2 + length].decode(), rest[2 + length :]
    assert len(objects) == answer[6]
    return objects


def test_identity_in_full_and_by_object(client: Client) -> None:
    objects = {0: "seedling-transplanter", 1: "transplanter", 2: "1.2.3"}
    for read_code in (1, 2, 3):
        assert identity(client, read_code) == objects
    assert [identity(client, 4, number) for number in objects] == [{n: text} for n, text in objects.items()]


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("0e0400ff", ILLEGAL_VALUE),
        ("0e04", ILLEGAL_VALUE),
        ("0e0000", ILLEGAL_VALUE),
        ("0e0500", ILLEGAL_VALUE),
        ("0e0403", ILLEGAL_ADDRESS),
        ("0d0100", ILLEGAL_FUNCTION),
        ("", ILLEGAL_FUNCTION),
    ],
)
def test_invalid_identity_requests_are_refused(client: Client, body: str, code: int) -> None:
    assert client.ask(b"\x2b" + bytes.fromhex(body)) == exception(43, code)


def test_two_servers_are_independent() -> None:
    with HmiRig() as one, HmiRig() as other:
        other.server.identity[2] = "4.5.6"
        first, second = one.client(), other.client()
        assert (identity(first, 1)[2], identity(second, 1)[2]) == ("1.2.3", "4.5.6")
        one.twin.run_for(500)
        assert first.ask(read_pdu(3, 0x2140, 1)) != second.ask(read_pdu(3, 0x2140, 1))
        one.press(first, "acknowledge")
        assert (len(one.audits), other.audits) == (1, [])


# --- connections ----------------------------------------------------------------------------------


def test_seventeenth_client_is_closed_until_a_connection_is_free() -> None:
    with HmiRig() as rig:
        clients = [rig.client() for _ in range(16)]
        assert all(client.ask(READ_D0)[0] == 3 for client in clients)
        with rig.client() as seventeenth:
            seventeenth.send(frame(READ_D0))
            assert seventeenth.rest_after_rubbish() == b""
        assert rig.server.traffic.refused == 1
        clients[0].socket.close()
        until(lambda: rig.connections == 15, clients[1])
        assert rig.client().ask(READ_D0)[0] == 3


def test_silent_clients_displace_each_other_and_no_client_that_works() -> None:
    with HmiRig() as rig:
        works = rig.client()
        assert works.ask(READ_D0)[0] == 3
        assert rig.server.modbus is not None
        [slot] = rig.server.modbus._frontend.slots.taken
        first_ms = slot.active_ms
        until(lambda: slot.active_ms > first_ms, works)
        silent = [rig.client() for _ in range(30)]
        assert all(client.rest_after_rubbish() == b"" for client in silent[:11])
        assert works.ask(READ_D0)[0] == silent[-1].ask(READ_D0)[0] == 3
        assert (rig.server.traffic.refused, rig.server.traffic.displaced) == (0, 11)


def test_the_panel_gets_a_reserved_place_when_sixteen_clients_work() -> None:
    with HmiRig() as rig:
        for _ in range(16):
            assert rig.client().ask(READ_D0)[0] == 3
        panel = rig.client()
        assert written(write_words(panel, "R", R_NAME, *name_words(PANEL_NAME)))
        for _ in range(10):
            rig.client()
        assert panel.ask(READ_D0)[0] == 3
        with rig.client() as other:
            other.send(frame(READ_D0))
            assert other.rest_after_rubbish() == b""
        assert panel.ask(READ_D0)[0] == 3


def test_idle_client_is_closed_and_active_client_is_not() -> None:
    """An incomplete request does not reset the idle timeout."""
    with HmiRig(options=HmiOptions(port=0, idle_timeout_s=IDLE_S)) as rig:
        idle, dribbling, busy = rig.client(), rig.client(), rig.client()
        until(lambda: rig.connections == 3, busy)
        assert rig.server.modbus is not None
        for piece, seconds in ((slice(0, 5), IDLE_S - 1), (slice(5, 9), 2.0)):
            dribbling.send(frame(READ_D0)[piece])
            assert busy.ask(READ_D0)[0] == 3
            assert rig.server.traffic.timed_out == 0
            let_pass(rig.server.modbus._frontend, seconds)
        assert idle.rest_after_rubbish() == dribbling.rest_after_rubbish() == b""
        assert busy.ask(READ_D0)[0] == 3
        assert rig.server.traffic.timed_out == 2


def test_server_stop_closes_every_client() -> None:
    with HmiRig() as rig:
        client = Client(rig.server.port)
        client.ask(READ_D0)
    with client:
        assert client.rest_after_rubbish() == b""
    with pytest.raises(OSError, match="refused"):
        Client(rig.server.port)


def test_port_in_use_is_reported_in_one_line(rig: HmiRig) -> None:
    message = "address already in use.*--hmi-port"
    with pytest.raises(ServerError, match=message), HmiRig(options=HmiOptions(port=rig.server.port)):
        pass


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "::"])  # noqa: S104 - refused
def test_remote_addresses_require_permission(host: str) -> None:
    with pytest.raises(ServerError, match="--hmi-allow-remote"):
        HmiRig(options=HmiOptions(host, 0))


def test_host_name_is_refused_as_address() -> None:
    with pytest.raises(ServerError, match="must be an IP address or localhost"):
        HmiRig(options=HmiOptions("panel.example", 0))


# --- TLS ------------------------------------------------------------------------------------------


class Certificates:
    """Certificate files of an authority, a server and a client."""

    def __init__(self, folder: Path) -> None:
        self.authority = trustme.CA()
        self.authority_file = folder / "ca.pem"
        self.authority.cert_pem.write_to_path(self.authority_file)
        self.server, self.server_key = self.issue(folder, "server", "127.0.0.1")
        self.client, self.client_key = self.issue(folder, "client", "panel@example.org")

    def issue(self, folder: Path, name: str, identity: str) -> tuple[Path, Path]:
        issued = self.authority.issue_cert(identity)
        files = folder / f"{name}.pem", folder / f"{name}.key"
        issued.cert_chain_pems[0].write_to_path(files[0])
        issued.private_key_pem.write_to_path(files[1])
        files[1].chmod(0o600)
        return files

    def options(self, *, ask_clients: bool = False) -> HmiOptions:
        clients = str(self.authority_file) if ask_clients else None
        return HmiOptions(port=0, certificate=str(self.server), key=str(self.server_key), clients=clients)

    def connect(self, port: int, *, with_certificate: bool = False, trusting: bool = True) -> Client:
        context = ssl.create_default_context(cafile=str(self.authority_file) if trusting else None)
        if with_certificate:
            context.load_cert_chain(str(self.client), str(self.client_key))
        client = Client(port)
        try:
            client.socket = context.wrap_socket(client.socket, server_hostname="127.0.0.1")
        except BaseException:
            client.socket.close()
            raise
        return client


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Certificates:
    return Certificates(tmp_path_factory.mktemp("certificates"))


def test_trusting_client_is_served_over_tls(certificates: Certificates) -> None:
    with HmiRig(options=certificates.options()) as rig, certificates.connect(rig.server.port) as client:
        client.send(b"".join(frame(READ_D0, transaction=n) for n in range(500)))
        assert [client.receive()[0] for _ in range(500)] == list(range(500))


def test_client_without_trust_disconnects(certificates: Certificates) -> None:
    with HmiRig(options=certificates.options()) as rig, pytest.raises(ssl.SSLCertVerificationError):
        certificates.connect(rig.server.port, trusting=False)


def test_client_without_a_required_certificate_is_refused(certificates: Certificates) -> None:
    with HmiRig(options=certificates.options(ask_clients=True)) as rig:
        with certificates.connect(rig.server.port, with_certificate=True) as client:
            assert client.ask(READ_D0)[0] == 3
        # with TLS 1.3 the refusal arrives after the handshake of the client, or only as the end of the connection
        with suppress(ssl.SSLError, ConnectionError), certificates.connect(rig.server.port) as client:
            client.send(frame(READ_D0))
            assert client.rest_after_rubbish() == b""
        assert rig.server.traffic.requests == 1


def test_plain_client_is_closed_without_response(certificates: Certificates) -> None:
    with HmiRig(options=certificates.options()) as rig, rig.client() as client:
        client.send(frame(READ_D0))
        alert = client.rest_after_rubbish()
        assert len(alert) <= 7
        assert rig.audits == []
        assert rig.server.traffic.requests == 0


def test_malformed_data_inside_tls_closes_that_client_only(
    certificates: Certificates, caplog: pytest.LogCaptureFixture
) -> None:
    with HmiRig(options=certificates.options()) as rig, certificates.connect(rig.server.port) as bystander:
        with certificates.connect(rig.server.port) as client:
            with suppress(OSError):  # the server may have closed the connection before all data was sent
                client.send(frame(READ_D0) + SIX_INVALID_BYTES * 10_000)
            with suppress(OSError):
                client.rest_after_rubbish()
        assert bystander.ask(READ_D0)[0] == 3
        assert rig.server.traffic.bad_frames == 1
    assert caplog.records == []


def test_mismatched_certificate_files_are_reported_in_one_line(certificates: Certificates) -> None:
    wrong = HmiOptions(port=0, certificate=str(certificates.server), key=str(certificates.client_key))
    with pytest.raises(ServerError, match="specify a matching set of PEM files") as error:
        HmiRig(options=wrong)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("options", [HmiOptions(key="k.pem"), HmiOptions(clients="ca.pem")])
def test_key_or_clients_without_a_certificate_are_refused(options: HmiOptions) -> None:
    with pytest.raises(ServerError, match="--hmi-certificate"):
        HmiRig(options=options)


def test_missing_certificate_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ServerError, match=r"none\.pem"):
        HmiRig(options=HmiOptions(certificate=str(tmp_path / "none.pem")))


def test_a_key_that_others_can_read_is_refused(tmp_path: Path) -> None:
    certificates = Certificates(tmp_path)
    certificates.server_key.chmod(0o644)
    with pytest.raises(ServerError, match=f"--hmi-key {certificates.server_key}: accessible to other users") as error:
        HmiRig(options=certificates.options())
    assert "\n" not in str(error.value)


# --- endurance ------------------------------------------------------------------------------------

FRAMES_A_CONNECTION = 20
RSS_LIMIT_BYTES = 5_000_000
SEEDS = [
    READ_D0,
    read_pdu(1, 0, 2_000),
    read_pdu(2, 0x3400, 22),
    read_pdu(4, 0x2140, 125),
    struct.pack(">BHH", 5, FIRST_COMMAND, 0xFF00),
    struct.pack(">BHHBB", 15, FIRST_COMMAND, 8, 1, 0x55),
    struct.pack(">BHH", 6, 521, 20),
    struct.pack(">BHHBHHH", 16, 0x2140 + 300, 3, 6, 1, 0, 0),
    struct.pack(">BHHHHBH", 23, 0, 10, 521, 1, 2, 20),
    b"\x2b\x0e\x01\x00",
]


def rss_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def mutated(rng: random.Random) -> bytes:
    data = bytearray(frame(rng.choice(SEEDS)))
    for _ in range(rng.randint(1, 4)):
        place = rng.randrange(len(data))
        match rng.randrange(4):
            case 0:
                data[place] = rng.randrange(256)
            case 1:
                data[place] ^= 1 << rng.randrange(8)
            case 2:
                del data[place:]
                data += bytes(rng.randrange(1, 12))
            case _:
                data[place:place] = rng.randbytes(rng.randrange(1, 300))
    return bytes(data)


def send_mutated(rig: HmiRig, rng: random.Random, frames: int) -> None:
    for _ in range(frames // FRAMES_A_CONNECTION):
        with Client(rig.server.port) as client:
            with suppress(OSError):  # the server may already have closed or reset the connection
                client.send(b"".join(mutated(rng) for _ in range(FRAMES_A_CONNECTION)))
                client.socket.shutdown(socket.SHUT_WR)
            client.rest_after_rubbish()
        rig.twin.scan()
        rig.audits.clear()


@pytest.mark.parametrize("frames", [2_000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_mutated_frames_neither_stop_the_server_nor_leak_memory(rig: HmiRig, client: Client, frames: int) -> None:
    rng = random.Random(20_260_101)
    send_mutated(rig, rng, 1_000)
    before_bytes = rss_bytes()
    send_mutated(rig, rng, frames)
    assert rss_bytes() - before_bytes < RSS_LIMIT_BYTES
    assert client.ask(READ_D0)[0] == 3
    assert rig.server.traffic.bad_frames > frames // FRAMES_A_CONNECTION // 2
    assert rig.server.traffic.refused == 0


@pytest.mark.parametrize("cycles", [500, pytest.param(10_000, marks=pytest.mark.nightly)])
def test_closed_connections_leave_no_resources(rig: HmiRig, client: Client, cycles: int) -> None:
    for cycle in range(cycles):
        with Client(rig.server.port) as guest:
            assert guest.ask(READ_D0)[0] == 3
        if cycle % 10 == 0:
            client.ask(READ_D0)
    until(lambda: rig.connections == 1, client)
    assert rig.server.traffic.refused == 0
