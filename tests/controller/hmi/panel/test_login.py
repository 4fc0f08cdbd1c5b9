"""Access control: first run, passwords, lockout, sessions, host names, origins and security headers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import ClientConnection

from controller.common.client_slots import is_loopback
from controller.core.clock import SimulatedClock
from controller.hmi.panel.orders.login import (
    LOCKOUT_MS,
    MAX_ATTEMPTS,
    MAX_LOCKS,
    SESSION_MS,
    AccessLevel,
    Cost,
    LoginSessions,
    LoginThrottle,
    Users,
    UsersFileError,
)
from tests.controller.hmi.panel.panel_rig import CHEAP, ELSEWHERE, PASSWORDS, PanelRig
from tests.real_time import WAIT_S

FIRST = {"operate": "operate-1", "maintain": "maintain-1"}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelRig]:
    with PanelRig(tmp_path_factory.mktemp("panel")) as rig:
        yield rig


def read_until_closed(socket: ClientConnection) -> None:
    for _ in range(100):
        socket.recv(timeout=WAIT_S)


def test_passwords_are_salted_hashes_in_a_private_file(tmp_path: Path) -> None:
    path = tmp_path / "deeper" / "users.json"
    assert Users(path).first_run
    users = Users(path)
    assert not users.matches("operate", "")
    users.set_first({"operate": "the same one", "maintain": "the same one"})
    assert not users.first_run
    assert path.stat().st_mode & 0o777 == 0o600
    assert [each.name for each in path.parent.iterdir()] == [path.name]  # no temporary file remains
    stored = json.loads(path.read_text())["users"]
    assert stored["operate"]["salt"] != stored["maintain"]["salt"]
    assert stored["operate"]["hash"] != stored["maintain"]["hash"]
    assert stored["operate"]["cost"]["n"] * stored["operate"]["cost"]["r"] >= 1 << 17
    assert "the same one" not in path.read_text()
    again = Users(path, Cost(n=2, r=1, p=1))
    assert again.matches("operate", "the same one")
    assert not again.matches("operate", "the same onE")
    assert not again.matches("view", "the same one")
    assert not again.matches("", "")


def with_scrypt_n(n: int) -> str:
    stored = {"cost": {"n": n}, "salt": "0" * 32, "hash": "0" * 64}
    return json.dumps({"format": 1, "users": {"operate": stored, "maintain": stored}})


@pytest.mark.parametrize(
    ("text", "mode", "wrong"),
    [
        ("{", 0o600, "corrupt"),
        ('{"format":0,"users":{}}', 0o600, "corrupt"),
        ('{"format":2,"users":[]}', 0o600, "newer than this program"),
        ('{"users":' * 100_000, 0o600, "corrupt"),
        (with_scrypt_n(3), 0o600, "corrupt"),
        ('{"format":1,"users":{}}', 0o600, "must define"),
        ("{}", 0o640, "chmod 600"),
    ],
)
def test_invalid_or_unsafe_users_file_is_refused(tmp_path: Path, text: str, mode: int, wrong: str) -> None:
    path = tmp_path / "users.json"
    path.write_text(text)
    path.chmod(mode)
    with pytest.raises(UsersFileError, match=wrong) as raised:
        Users(path)
    assert "\n" not in str(raised.value)
    assert [each.name for each in tmp_path.iterdir()] == [path.name], "a renamed file would be a first run"
    assert path.read_text() == text


@pytest.mark.parametrize("has_file", [True, False])
def test_a_users_file_that_others_could_replace_is_refused(tmp_path: Path, has_file: bool) -> None:
    """Without a file, the first one to set passwords would be let in."""
    path = tmp_path / "shared" / "users.json"
    if has_file:
        Users(path, CHEAP).set_first({"operate": "operate-1", "maintain": "maintain-1"})
        Users(path)
    path.parent.mkdir(exist_ok=True)
    path.parent.chmod(0o777)
    with pytest.raises(UsersFileError, match=f"--users {path.parent}: other users can write it; run chmod go-w on it"):
        Users(path)


def test_passwords_that_cannot_be_stored_are_not_set(tmp_path: Path) -> None:
    users = Users(tmp_path / "missing" / "users.json", CHEAP)
    (tmp_path / "missing").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="File exists"):
        users.set_first({"operate": "a", "maintain": "b"})
    assert users.first_run


def test_session_ends_by_timeout_or_request() -> None:
    clock = SimulatedClock()
    sessions = LoginSessions(clock)
    one, other = sessions.begin("operate"), sessions.begin("maintain")
    assert len(one) >= 43  # 256 bits
    assert one != other
    assert (sessions.level(one), sessions.level(other)) == (AccessLevel.OPERATE, AccessLevel.MAINTAIN)
    assert sessions.level(None) is sessions.level("") is sessions.level("guess") is AccessLevel.NONE
    sessions.end(other)
    assert sessions.level(other) is AccessLevel.NONE
    clock.advance(SESSION_MS - 1)
    assert sessions.level(one) is AccessLevel.OPERATE
    clock.advance(1)
    assert sessions.level(one) is AccessLevel.NONE


def test_a_user_is_locked_out_at_an_address_after_five_wrong_passwords() -> None:
    clock = SimulatedClock()
    throttle = LoginThrottle(clock)
    for _ in range(MAX_ATTEMPTS):
        assert throttle.locked_s("operate", "192.0.2.1") == 0
        throttle.begin("operate", "192.0.2.1")
    assert throttle.locked_s("operate", "192.0.2.1") == 30
    assert throttle.locked_s("maintain", "192.0.2.1") == 0
    assert throttle.locked_s("operate", "192.0.2.2") == 0
    clock.advance(LOCKOUT_MS - 1)
    assert throttle.locked_s("operate", "192.0.2.1") == 1
    clock.advance(1)
    assert throttle.locked_s("operate", "192.0.2.1") == 0
    throttle.begin("operate", "192.0.2.1")
    throttle.succeed("operate", "192.0.2.1")
    for _ in range(MAX_ATTEMPTS - 1):
        throttle.begin("operate", "192.0.2.1")
    assert throttle.locked_s("operate", "192.0.2.1") == 0


def test_unknown_users_of_an_address_and_addresses_of_a_network_are_one() -> None:
    """Neither invented names nor the addresses that one IPv6 client can choose give further tries."""
    throttle = LoginThrottle(SimulatedClock())
    for index in range(MAX_ATTEMPTS):
        throttle.begin(f"user{index}", f"2001:db8::{index}")
    assert throttle.locked_s("user", "2001:db8::ffff") == 30
    assert throttle.locked_s("operate", "2001:db8::1") == 0


def test_the_memory_of_wrong_passwords_is_bounded_and_forgets_locks_last() -> None:
    clock = SimulatedClock()
    throttle = LoginThrottle(clock)
    for _ in range(MAX_ATTEMPTS):
        throttle.begin("operate", "192.0.2.1")
    for index in range(MAX_LOCKS + 500):
        clock.advance(1)
        throttle.begin("operate", f"10.0.{index // 256}.{index % 256}")
    assert throttle.remembered == MAX_LOCKS
    assert throttle.locked_s("operate", "192.0.2.1") > 0


@pytest.mark.parametrize(
    ("host", "here"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("10.0.0.1", False),
        ("localhost", False),
        ("", False),
        (None, False),
        ("::ffff:10.0.0.1", False),
    ],
)
def test_loopback_addresses_are_local(host: str | None, here: bool) -> None:
    assert is_loopback(host) is here


def test_first_run_sets_both_passwords_once_and_only_locally(tmp_path: Path) -> None:
    with PanelRig(tmp_path, first_run=True) as rig:
        elsewhere = rig.client(ELSEWHERE)
        assert rig.here.get("/api/me").json() == {"level": "view", "first_run": True}
        assert elsewhere.post("/api/first", json=FIRST).status_code == 403
        login = {"user": "operate", "password": FIRST["operate"]}
        assert rig.here.post("/api/login", json=login).status_code == 409
        for changed in (
            {"operate": "seven77"},
            {"operate": FIRST["maintain"]},
            {"more": "x"},
            {"operate": 12345678},
            {"operate": "x" * 129},
        ):
            wrong = FIRST | changed
            assert rig.here.post("/api/first", json=wrong).status_code == 400, wrong
        assert not rig.users_file.exists()
        assert rig.here.post("/api/first", json=FIRST).json()["ok"] is True
        assert rig.here.get("/api/me").json() == {"level": "view", "first_run": False}
        assert rig.here.post("/api/first", json=FIRST).status_code == 409
        assert rig.here.post("/api/login", json=login).status_code == 200


def test_login_cookie_is_http_only_and_logout_ends_the_session(rig: PanelRig) -> None:
    client = rig.client()
    answer = client.post("/api/login", json={"user": "maintain", "password": PASSWORDS["maintain"]})
    cookie = answer.headers["set-cookie"].lower()
    assert all(flag in cookie for flag in ("httponly", "samesite=strict", "path=/", "max-age=28800"))
    assert client.get("/api/me").json()["level"] == "maintain"
    cookies = dict(client.cookies)
    assert client.post("/api/logout", json={}).status_code == 200
    client.cookies.update(cookies)
    assert client.get("/api/me").json()["level"] == "view"


def test_wrong_passwords_lock_out_this_user_at_this_address_only(rig: PanelRig) -> None:
    mallory = rig.client("198.51.100.1")
    right = {"user": "operate", "password": PASSWORDS["operate"]}
    for _ in range(MAX_ATTEMPTS):
        assert mallory.post("/api/login", json=right | {"password": "guess-work"}).status_code == 401
    locked = mallory.post("/api/login", json=right)
    assert locked.status_code == 429
    assert 1 <= int(locked.headers["retry-after"]) <= 30
    assert "of this user at this address" in locked.json()["text"]["en"]
    other = {"user": "maintain", "password": PASSWORDS["maintain"]}
    assert rig.client("198.51.100.1").post("/api/login", json=other).status_code == 200
    assert rig.client("198.51.100.2").post("/api/login", json=right).status_code == 200


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b'{"user":"operate"}', b"x" * 5_000])
def test_malformed_login_is_refused(rig: PanelRig, body: bytes) -> None:
    assert rig.here.post("/api/login", content=body).status_code == 400


def test_remote_clients_need_a_login(rig: PanelRig) -> None:
    remote = rig.client(ELSEWHERE)
    trends = "/api/trends?span=600000&points=300"
    for path in ("/api/history/events", "/api/history/last_cycle?side=left", trends, "/metrics"):
        assert remote.get(path).status_code == 401, path
        assert rig.here.get(path).status_code in (200, 404), path
    described = remote.get("/api/describe")
    assert described.status_code == 401
    assert set(described.json()) == {"language", "languages", "texts"}
    assert remote.get("/api/me").json() == {"level": "none", "first_run": False}
    with pytest.raises(InvalidStatus):
        rig.socket(remote)
    remote.post("/api/login", json={"user": "operate", "password": PASSWORDS["operate"]})
    assert remote.get("/metrics").status_code == 200
    with rig.socket(remote) as socket:
        assert json.loads(socket.recv(timeout=WAIT_S))["view"]["me"] == {"level": "operate"}


@pytest.mark.parametrize(
    "header",
    [
        *("Forwarded", "Via", "X-Forwarded-For", "x-forwarded-host", "X-Forwarded-Proto"),
        *("X-Real-IP", "X-Client-IP", "X-Cluster-Client-IP", "True-Client-IP", "CF-Connecting-IP"),
    ],
)
def test_a_client_of_a_proxy_on_this_computer_needs_a_login(rig: PanelRig, header: str) -> None:
    forwarded = {header: "198.51.100.7"}
    assert rig.here.get("/api/me", headers=forwarded).json()["level"] == "none"
    assert rig.here.get("/metrics", headers=forwarded).status_code == 401
    assert rig.here.post("/api/first", json=FIRST, headers=forwarded).status_code == 403
    with pytest.raises(InvalidStatus):
        rig.socket(rig.client(), None, **forwarded)


def test_socket_closes_with_its_session(rig: PanelRig) -> None:
    client = rig.client(ELSEWHERE)
    client.post("/api/login", json={"user": "operate", "password": PASSWORDS["operate"]})
    with rig.socket(client) as socket:
        socket.recv(timeout=WAIT_S)
        client.post("/api/logout", json={})
        with pytest.raises(ConnectionClosedError):
            read_until_closed(socket)
        assert socket.close_code == 4401


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1", "a@127.0.0.1:{port}", ""]
)
def test_unknown_host_name_is_refused(rig: PanelRig, host: str) -> None:
    named = host.format(port=rig.host.rpartition(":")[2])
    origin = f"http://{named}"
    for path in ("/", "/api/me", "/metrics"):
        assert rig.here.get(path, headers={"host": named}).status_code in (400, 403), path
    assert rig.here.post("/api/logout", headers={"host": named, "origin": origin}).status_code in (400, 403)


@pytest.mark.parametrize("name", ["localhost", "panel.test", "PANEL.test", "127.0.0.1"])
def test_served_host_name_is_accepted(rig: PanelRig, name: str) -> None:
    assert rig.here.get("/api/me", headers={"host": f"{name}:{rig.host.rpartition(':')[2]}"}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://{host}", "http://127.0.0.1", ""])
def test_other_origins_can_neither_post_nor_open_a_socket(rig: PanelRig, origin: str) -> None:
    sent = origin.format(host=rig.host)
    assert rig.here.post("/api/logout", headers={"origin": sent}).status_code == 403
    with pytest.raises(InvalidStatus):
        rig.socket(Origin=sent)


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/me", "/api/none", "/metrics"])
def test_every_response_has_restrictive_security_headers(rig: PanelRig, path: str) -> None:
    headers = rig.here.get(path).headers
    policy = dict(each.strip().split(" ", 1) for each in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["object-src"] == policy["base-uri"] == "'none'"
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
