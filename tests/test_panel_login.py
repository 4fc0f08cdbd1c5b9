"""Who is let in: first run, passwords, tries, sessions, names and origins, what the answers forbid a browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from panel_rig import CHEAP, ELSEWHERE, PASSWORDS, PanelRig
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import ClientConnection

from controller.core.clock import SimulatedClock
from controller.hmi.panel.login import (
    LOCKED_MS,
    MOST_TRIES,
    SESSION_MS,
    Cost,
    Level,
    Sessions,
    Tries,
    Users,
    UsersFileError,
    is_loopback,
)

FIRST = {"operate": "operate-1", "maintain": "maintain-1"}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelRig]:
    with PanelRig(tmp_path_factory.mktemp("panel")) as rig:
        yield rig


def read_on(socket: ClientConnection) -> None:
    for _ in range(100):
        socket.recv(timeout=10)


def test_passwords_are_hashed_with_their_own_salt_and_kept_to_oneself(tmp_path: Path) -> None:
    path = tmp_path / "deeper" / "users.json"
    assert Users(path).first_run
    users = Users(path)
    assert not users.matches("operate", "")
    users.set_first({"operate": "the same one", "maintain": "the same one"})
    assert not users.first_run
    assert path.stat().st_mode & 0o777 == 0o600
    assert [each.name for each in path.parent.iterdir()] == [path.name]  # nothing half-written stays
    kept = json.loads(path.read_text())["users"]
    assert kept["operate"]["salt"] != kept["maintain"]["salt"]
    assert kept["operate"]["hash"] != kept["maintain"]["hash"]
    assert kept["operate"]["cost"]["n"] * kept["operate"]["cost"]["r"] >= 1 << 17
    assert "the same one" not in path.read_text()
    again = Users(path, Cost(n=2, r=1, p=1))
    assert again.matches("operate", "the same one")
    assert not again.matches("operate", "the same onE")
    assert not again.matches("view", "the same one")
    assert not again.matches("", "")


@pytest.mark.parametrize(
    ("text", "mode", "wrong"),
    [
        ("{", 0o600, "damaged"),
        ('{"format":2,"users":{}}', 0o600, "damaged"),
        ('{"format":1,"users":{}}', 0o600, "not the users"),
        ("{}", 0o640, "chmod 600"),
    ],
)
def test_a_file_of_users_that_cannot_be_trusted_is_refused(tmp_path: Path, text: str, mode: int, wrong: str) -> None:
    path = tmp_path / "users.json"
    path.write_text(text)
    path.chmod(mode)
    with pytest.raises(UsersFileError, match=wrong) as raised:
        Users(path)
    assert "\n" not in str(raised.value)


def test_what_cannot_be_stored_is_not_set(tmp_path: Path) -> None:
    users = Users(tmp_path / "missing" / "users.json", CHEAP)
    (tmp_path / "missing").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="File exists"):
        users.set_first({"operate": "a", "maintain": "b"})
    assert users.first_run


def test_a_session_ends_after_its_time_or_by_order() -> None:
    clock = SimulatedClock()
    sessions = Sessions(clock)
    one, other = sessions.begin("operate"), sessions.begin("maintain")
    assert len(one) >= 43  # 256 bits
    assert one != other
    assert (sessions.level(one), sessions.level(other)) == (Level.OPERATE, Level.MAINTAIN)
    assert sessions.level(None) is sessions.level("") is sessions.level("guess") is Level.NONE
    sessions.end(other)
    assert sessions.level(other) is Level.NONE
    clock.advance(SESSION_MS - 1)
    assert sessions.level(one) is Level.OPERATE
    clock.advance(1)
    assert sessions.level(one) is Level.NONE


def test_after_five_wrong_tries_a_peer_waits() -> None:
    clock = SimulatedClock()
    tries = Tries(clock)
    for _ in range(MOST_TRIES):
        assert tries.locked_s("a") == 0
        tries.begin("a")
    assert tries.locked_s("a") == 30
    assert tries.locked_s("b") == 0
    clock.advance(LOCKED_MS - 1)
    assert tries.locked_s("a") == 1
    clock.advance(1)
    assert tries.locked_s("a") == 0
    tries.begin("a")
    tries.right("a")
    for _ in range(MOST_TRIES - 1):
        tries.begin("a")
    assert tries.locked_s("a") == 0


@pytest.mark.parametrize(
    ("host", "here"),
    [("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("::ffff:127.0.0.1", True), ("10.0.0.1", False),
     ("localhost", False), ("", False), (None, False), ("::ffff:10.0.0.1", False)],
)  # fmt: skip
def test_this_computer_is_known_by_its_address(host: str | None, here: bool) -> None:
    assert is_loopback(host) is here


def test_the_first_run_sets_both_passwords_once_and_here_only(tmp_path: Path) -> None:
    with PanelRig(tmp_path, first_run=True) as rig:
        elsewhere = rig.client(ELSEWHERE)
        assert rig.here.get("/api/me").json() == {"level": "view", "first_run": True}
        assert elsewhere.post("/api/first", json=FIRST).status_code == 403
        login = {"user": "operate", "password": FIRST["operate"]}
        assert rig.here.post("/api/login", json=login).status_code == 409
        for changed in ({"operate": "seven77"}, {"operate": FIRST["maintain"]}, {"more": "x"}, {"operate": 12345678},
                        {"operate": "x" * 129}):  # fmt: skip
            wrong = FIRST | changed
            assert rig.here.post("/api/first", json=wrong).status_code == 400, wrong
        assert not rig.users_file.exists()
        assert rig.here.post("/api/first", json=FIRST).json()["ok"] is True
        assert rig.here.get("/api/me").json() == {"level": "view", "first_run": False}
        assert rig.here.post("/api/first", json=FIRST).status_code == 409
        assert rig.here.post("/api/login", json=login).status_code == 200


def test_a_login_gives_a_cookie_no_script_can_read_and_a_logout_ends_it(rig: PanelRig) -> None:
    client = rig.client()
    answer = client.post("/api/login", json={"user": "maintain", "password": PASSWORDS["maintain"]})
    cookie = answer.headers["set-cookie"].lower()
    assert all(flag in cookie for flag in ("httponly", "samesite=strict", "path=/", "max-age=28800"))
    assert client.get("/api/me").json()["level"] == "maintain"
    kept = dict(client.cookies)
    assert client.post("/api/logout", json={}).status_code == 200
    client.cookies.update(kept)
    assert client.get("/api/me").json()["level"] == "view"


def test_wrong_passwords_are_refused_and_then_locked_out_by_peer(rig: PanelRig) -> None:
    mallory = rig.client("198.51.100.1")
    for user in ("operate", "maintain", "view", "", "operate"):
        assert mallory.post("/api/login", json={"user": user, "password": "guess-work"}).status_code == 401
    right = {"user": "operate", "password": PASSWORDS["operate"]}
    locked = mallory.post("/api/login", json=right)
    assert locked.status_code == 429
    assert 1 <= int(locked.headers["retry-after"]) <= 30
    assert rig.client("198.51.100.2").post("/api/login", json=right).status_code == 200


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b'{"user":"operate"}', b"x" * 5_000])
def test_a_login_that_is_none(rig: PanelRig, body: bytes) -> None:
    assert rig.here.post("/api/login", content=body).status_code == 400


def test_from_elsewhere_nothing_is_seen_without_a_login(rig: PanelRig) -> None:
    stranger = rig.client(ELSEWHERE)
    for path in ("/api/history/events", "/api/history/last_cycle?side=left", "/api/trends", "/metrics"):
        assert stranger.get(path).status_code == 401, path
        assert rig.here.get(path).status_code in (200, 404), path
    described = stranger.get("/api/describe")
    assert described.status_code == 401
    assert set(described.json()) == {"languages", "texts"}
    assert stranger.get("/api/me").json() == {"level": "none", "first_run": False}
    with pytest.raises(InvalidStatus):
        rig.socket(stranger)
    stranger.post("/api/login", json={"user": "operate", "password": PASSWORDS["operate"]})
    assert stranger.get("/metrics").status_code == 200
    with rig.socket(stranger) as socket:
        assert json.loads(socket.recv(timeout=10))["view"]["me"] == {"level": "operate"}


def test_a_socket_closes_with_its_session(rig: PanelRig) -> None:
    client = rig.client(ELSEWHERE)
    client.post("/api/login", json={"user": "operate", "password": PASSWORDS["operate"]})
    with rig.socket(client) as socket:
        socket.recv(timeout=10)
        client.post("/api/logout", json={})
        with pytest.raises(ConnectionClosedError):
            read_on(socket)
        assert socket.close_code == 4401


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1", "a@127.0.0.1:{port}", ""]
)
def test_a_name_that_is_not_served_is_refused(rig: PanelRig, host: str) -> None:
    named = host.format(port=rig.host.rpartition(":")[2])
    origin = f"http://{named}"
    for path in ("/", "/api/me", "/metrics"):
        assert rig.here.get(path, headers={"host": named}).status_code in (400, 403), path
    assert rig.here.post("/api/logout", headers={"host": named, "origin": origin}).status_code in (400, 403)


@pytest.mark.parametrize("name", ["localhost", "panel.test", "PANEL.test", "127.0.0.1"])
def test_a_name_that_is_served_is_answered(rig: PanelRig, name: str) -> None:
    assert rig.here.get("/api/me", headers={"host": f"{name}:{rig.host.rpartition(':')[2]}"}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://{host}", "http://127.0.0.1", ""])
def test_another_origin_may_neither_post_nor_open_a_socket(rig: PanelRig, origin: str) -> None:
    sent = origin.format(host=rig.host)
    assert rig.here.post("/api/logout", headers={"origin": sent}).status_code == 403
    with pytest.raises(InvalidStatus):
        rig.socket(Origin=sent)


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/me", "/api/none", "/metrics"])
def test_every_answer_forbids_what_the_page_does_not_need(rig: PanelRig, path: str) -> None:
    headers = rig.here.get(path).headers
    policy = dict(each.strip().split(" ", 1) for each in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["object-src"] == policy["base-uri"] == "'none'"
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
