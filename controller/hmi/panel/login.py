"""Who may do what: levels, passwords, sessions.

Passwords are kept as scrypt hashes with their parameters, each with a salt of its own, in a file nobody else can
read. Sessions live in memory: they end with the panel.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import os
import secrets
import stat
from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from controller.core.clock import Clock

User = Literal["operate", "maintain"]
USERS: Final[tuple[User, User]] = ("operate", "maintain")
SHORTEST: Final = 8
LONGEST: Final = 128
SESSION_MS: Final = 8 * 3_600_000
MOST_SESSIONS: Final = 100
MOST_TRIES: Final = 5
LOCKED_MS: Final = 30_000


class Level(IntEnum):
    """What somebody may do; a higher level may do all of the lower ones."""

    NONE = 0
    VIEW = 1
    OPERATE = 2
    MAINTAIN = 3


class UsersFileError(ValueError):
    """The file of users cannot be used; one line with the remedy."""


class Cost(BaseModel):
    """Parameters of scrypt; memory is 128 n r bytes."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    n: Annotated[int, Field(ge=2, le=1 << 20)] = 1 << 15
    r: Annotated[int, Field(ge=1, le=32)] = 8
    p: Annotated[int, Field(ge=1, le=16)] = 3


class _Kept(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    cost: Cost
    salt: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    hash: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1] = 1
    users: dict[User, _Kept]


class Users:
    """The passwords of the two users, in a file."""

    def __init__(self, path: Path, cost: Cost | None = None) -> None:
        """Read the file; where there is none, nobody has a password yet.

        Args:
            path: The file.
            cost: What the hash of a new password costs.

        Raises:
            UsersFileError: It cannot be read, is damaged, or others can read it.
        """
        self._path = path
        self._cost = cost or Cost()
        self._kept: dict[User, _Kept] = {}
        self._read()

    @property
    def first_run(self) -> bool:
        """Whether the passwords are still to be set."""
        return not self._kept

    def set_first(self, passwords: Mapping[User, str]) -> None:
        """Set both passwords and store them.

        Raises:
            OSError: They cannot be stored; nothing is set.
        """
        kept = {user: self._hashed(passwords[user]) for user in USERS}
        self._store(_File(users=kept))
        self._kept = kept

    def matches(self, user: str, password: str) -> bool:
        """Tell whether this is the user's password; it takes its time, so ask in a thread."""
        kept = next((kept for name, kept in self._kept.items() if name == user), None)
        if kept is None:
            _scrypt(password, bytes(16), self._cost)  # as long as for a user there is
            return False
        return hmac.compare_digest(_scrypt(password, bytes.fromhex(kept.salt), kept.cost), bytes.fromhex(kept.hash))

    def _hashed(self, password: str) -> _Kept:
        salt = secrets.token_bytes(16)
        return _Kept(cost=self._cost, salt=salt.hex(), hash=_scrypt(password, salt, self._cost).hex())

    def _read(self) -> None:
        try:
            mode = self._path.stat().st_mode
            text = self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or "is damaged"
            raise UsersFileError(f"--users {self._path}: {why}; name a file that can be read, or remove it") from error
        if stat.S_IMODE(mode) & 0o077:
            raise UsersFileError(f"--users {self._path}: others can read or write it; chmod 600 it")
        try:
            kept = _File.model_validate_json(text).users
        except ValidationError as error:
            raise UsersFileError(f"--users {self._path}: is damaged; remove it and set both passwords anew") from error
        if set(kept) != set(USERS):
            raise UsersFileError(
                f"--users {self._path}: not the users {' and '.join(USERS)}; remove it and set both anew"
            )
        self._kept = kept

    def _store(self, file: _File) -> None:
        """Write beside, then rename: never half a file, never one that others can read."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        beside = self._path.with_name(f"{self._path.name}.{secrets.token_hex(4)}.new")
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as written:
                written.write(file.model_dump_json(indent=2))
                written.flush()
                os.fsync(written.fileno())
            beside.replace(self._path)
        except OSError:
            beside.unlink(missing_ok=True)
            raise


def _scrypt(password: str, salt: bytes, cost: Cost) -> bytes:
    memory = 128 * cost.n * cost.r + 128 * cost.r * cost.p + (1 << 20)
    secret = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(secret, salt=salt, n=cost.n, r=cost.r, p=cost.p, maxmem=memory, dklen=32)


class Sessions:
    """Who is logged in."""

    def __init__(self, clock: Clock) -> None:
        """Begin with nobody."""
        self._clock = clock
        self._ends: dict[str, tuple[Level, int]] = {}

    def begin(self, user: User) -> str:
        """Return the secret of a new session, 256 bits; the oldest ends where there are too many."""
        self._forget_ended()
        if len(self._ends) >= MOST_SESSIONS:
            del self._ends[min(self._ends, key=lambda token: self._ends[token][1])]
        token = secrets.token_urlsafe(32)
        self._ends[token] = (Level[user.upper()], self._clock.now_ms() + SESSION_MS)
        return token

    def level(self, token: str | None) -> Level:
        """Return the level of a session; NONE if there is no such one, or not any more."""
        level, end_ms = self._ends.get(token or "", (Level.NONE, 0))
        return level if self._clock.now_ms() < end_ms else Level.NONE

    def end(self, token: str | None) -> None:
        """End a session, if there is one."""
        self._ends.pop(token or "", None)

    def _forget_ended(self) -> None:
        now_ms = self._clock.now_ms()
        self._ends = {token: kept for token, kept in self._ends.items() if kept[1] > now_ms}


class Tries:
    """Wrong passwords by peer: after some of them it has to wait."""

    def __init__(self, clock: Clock) -> None:
        """Begin with no wrong one."""
        self._clock = clock
        self._wrong: dict[str, tuple[int, int]] = {}

    def locked_s(self, peer: str) -> int:
        """Return how long a peer has to wait before its next try, s; 0 = it may try."""
        count, last_ms = self._wrong.get(peer, (0, 0))
        left_ms = last_ms + LOCKED_MS - self._clock.now_ms()
        return -(-left_ms // 1_000) if count >= MOST_TRIES and left_ms > 0 else 0

    def begin(self, peer: str) -> None:
        """Count a try as wrong before it is looked at, so that many at once are no more than one after another."""
        now_ms = self._clock.now_ms()
        self._wrong = {name: kept for name, kept in self._wrong.items() if kept[1] + LOCKED_MS > now_ms}
        count, _ = self._wrong.get(peer, (0, 0))
        self._wrong[peer] = (count + 1, now_ms)

    def right(self, peer: str) -> None:
        """Forget the wrong ones of a peer that gave the right password."""
        self._wrong.pop(peer, None)


def is_loopback(host: str | None) -> bool:
    """Tell whether a peer is on this computer."""
    try:
        address = ipaddress.ip_address(host or "")
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback
