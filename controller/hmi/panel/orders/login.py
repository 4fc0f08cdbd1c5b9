"""Access levels, passwords and sessions.

Passwords are stored as individually salted scrypt hashes, together with the scrypt parameters, in a file that only its
owner can read. LoginSessions are held in memory and end when the panel stops.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from collections.abc import Mapping
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from controller.common.client_slots import address_group
from controller.common.errors import InputError
from controller.common.files.trust import secret_exposure
from controller.core.clock import Clock

User = Literal["operate", "maintain"]
USERS: Final[tuple[User, User]] = ("operate", "maintain")
FORMAT: Final = 1
"""Format of the users file."""
PASSWORD_MIN: Final = 8
PASSWORD_MAX: Final = 128
"""Length limits of a password, characters."""
SESSION_MS: Final = 8 * 3_600_000
MAX_SESSIONS: Final = 100
MAX_ATTEMPTS: Final = 5
"""Number of wrong passwords after which a user is locked out at an address."""
LOCKOUT_MS: Final = 30_000
MAX_LOCKS: Final = 1_000
"""Number of users at addresses with wrong passwords that are remembered; the one with the fewest is forgotten first."""


class AccessLevel(IntEnum):
    """Access level; each level includes the permissions of the lower ones."""

    NONE = 0
    VIEW = 1
    OPERATE = 2
    MAINTAIN = 3


HALTING: Final = ("stop", "hold", "abort")
"""Commands that halt the machine: they are never asked about, too late or too many."""
FOR_EVERYONE: Final = ("stop", "hold")
"""Commands that halt it in an orderly way: whoever may see the machine may give them."""


def command_level(command: str) -> AccessLevel:
    """Return the lowest access level at which a command is executed."""
    return AccessLevel.VIEW if command in FOR_EVERYONE else AccessLevel.OPERATE


class UsersFileError(InputError):
    """Raised for an invalid or unsafe users file; the message is one line with the remedy."""


class Cost(BaseModel):
    """Scrypt parameters; the memory requirement is 128 n r bytes."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    n: Annotated[int, Field(ge=2, le=1 << 20)] = 1 << 15
    r: Annotated[int, Field(ge=1, le=32)] = 8
    p: Annotated[int, Field(ge=1, le=16)] = 3

    @field_validator("n")
    @classmethod
    def _power_of_two(cls, n: int) -> int:
        if n & (n - 1):
            raise ValueError("must be a power of two")
        return n


class _StoredPassword(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    cost: Cost
    salt: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    hash: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _UsersFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1] = FORMAT
    users: dict[User, _StoredPassword]


class _Format(BaseModel):
    format: int


class Users:
    """Passwords of the two users, stored in a file.

    A file that cannot be used ends the start and is not renamed: without a file, whoever comes first sets passwords.
    """

    def __init__(self, path: Path, cost: Cost | None = None) -> None:
        """Read the file; if there is no file, no passwords are set.

        Args:
            path: Users file.
            cost: Scrypt parameters of new passwords.

        Raises:
            UsersFileError: The file is unreadable, corrupt, newer, or accessible to other users.
        """
        self._path = path
        self._cost = cost or Cost()
        self._stored: dict[User, _StoredPassword] = {}
        self._read()

    @property
    def first_run(self) -> bool:
        """True until the passwords have been set."""
        return not self._stored

    def set_first(self, passwords: Mapping[User, str]) -> None:
        """Set both passwords and store them.

        Raises:
            OSError: The passwords cannot be stored; the current passwords remain valid.
        """
        stored = {user: self._hashed(passwords[user]) for user in USERS}
        self._store(_UsersFile(users=stored))
        self._stored = stored

    def matches(self, user: str, password: str) -> bool:
        """Return whether the password of a user is correct; slow, so call it in a thread."""
        stored = next((stored for name, stored in self._stored.items() if name == user), None)
        if stored is None:
            _scrypt(password, bytes(16), self._cost)  # same duration as for an existing user
            return False
        return hmac.compare_digest(
            _scrypt(password, bytes.fromhex(stored.salt), stored.cost), bytes.fromhex(stored.hash)
        )

    def _hashed(self, password: str) -> _StoredPassword:
        salt = secrets.token_bytes(16)
        return _StoredPassword(cost=self._cost, salt=salt.hex(), hash=_scrypt(password, salt, self._cost).hex())

    def _read(self) -> None:
        problem = None
        try:
            problem = secret_exposure(self._path)
            text = self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            text = None
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "is corrupt"
            raise UsersFileError(f"--users {self._path}: {reason}; specify a readable file, or remove it") from error
        if problem is not None:  # also without a file: whoever can remove it can set the passwords
            raise UsersFileError(f"--users {problem}")
        if text is None:
            return
        try:
            stored = _UsersFile.model_validate_json(text).users
        except ValidationError as error:
            problem = "is corrupt; remove it and set both passwords again"
            if _is_newer(text):
                problem = "is newer than this program; use the program version that wrote it, or choose another file"
            raise UsersFileError(f"--users {self._path}: {problem}") from error
        if set(stored) != set(USERS):
            raise UsersFileError(
                f"--users {self._path}: must define {' and '.join(USERS)}; remove it and set both passwords again"
            )
        self._stored = stored

    def _store(self, file: _UsersFile) -> None:
        """Write a temporary file with mode 600, then rename it; the file is never incomplete or readable by others."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self._path.with_name(f"{self._path.name}.{secrets.token_hex(4)}.new")
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
                stream.write(file.model_dump_json(indent=2))
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(self._path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise


def _is_newer(text: str) -> bool:
    with suppress(ValidationError):
        return _Format.model_validate_json(text).format > FORMAT
    return False


def _scrypt(password: str, salt: bytes, cost: Cost) -> bytes:
    memory = 128 * cost.n * cost.r + 128 * cost.r * cost.p + (1 << 20)
    secret = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(secret, salt=salt, n=cost.n, r=cost.r, p=cost.p, maxmem=memory, dklen=32)


class LoginSessions:
    """Active login sessions."""

    def __init__(self, clock: Clock) -> None:
        """Initialise with no sessions."""
        self._clock = clock
        self._ends: dict[str, tuple[AccessLevel, int]] = {}

    def begin(self, user: User) -> str:
        """Return the 256-bit token of a new session; at the session limit, the oldest session ends."""
        self._remove_expired()
        if len(self._ends) >= MAX_SESSIONS:
            del self._ends[min(self._ends, key=lambda token: self._ends[token][1])]
        token = secrets.token_urlsafe(32)
        self._ends[token] = (AccessLevel[user.upper()], self._clock.now_ms() + SESSION_MS)
        return token

    def level(self, token: str | None) -> AccessLevel:
        """Return the level of a session; NONE if it is unknown or has expired."""
        level, end_ms = self._ends.get(token or "", (AccessLevel.NONE, 0))
        return level if self._clock.now_ms() < end_ms else AccessLevel.NONE

    def end(self, token: str | None) -> None:
        """End a session; an unknown token is ignored."""
        self._ends.pop(token or "", None)

    def _remove_expired(self) -> None:
        now_ms = self._clock.now_ms()
        self._ends = {token: session for token, session in self._ends.items() if session[1] > now_ms}


class LoginThrottle:
    """Lockout after repeated wrong passwords, of one user at one address.

    Another user of the address, and the user at another address, can log in. All unknown users of an address count as
    one, so that the number of locks of an address is bounded, and at most `MAX_LOCKS` are remembered.
    """

    def __init__(self, clock: Clock) -> None:
        """Initialise with no failed attempts."""
        self._clock = clock
        self._failures: dict[tuple[str, str], tuple[int, int]] = {}

    @property
    def remembered(self) -> int:
        """Number of users at addresses with wrong passwords that are remembered."""
        return len(self._failures)

    def locked_s(self, user: str, peer: str) -> int:
        """Return the remaining lockout of a user at an address, s; 0 if there is none."""
        count, last_ms = self._failures.get(_lock_key(user, peer), (0, 0))
        remaining_ms = last_ms + LOCKOUT_MS - self._clock.now_ms()
        return -(-remaining_ms // 1_000) if count >= MAX_ATTEMPTS and remaining_ms > 0 else 0

    def begin(self, user: str, peer: str) -> None:
        """Count an attempt as failed before checking it, so that the limit also applies to concurrent attempts."""
        now_ms = self._clock.now_ms()
        self._failures = {key: failed for key, failed in self._failures.items() if failed[1] + LOCKOUT_MS > now_ms}
        key = _lock_key(user, peer)
        count, _ = self._failures.pop(key, (0, 0))
        if len(self._failures) >= MAX_LOCKS:
            del self._failures[min(self._failures, key=lambda other: self._failures[other])]
        self._failures[key] = (count + 1, now_ms)

    def succeed(self, user: str, peer: str) -> None:
        """Clear the failed attempts of a user at an address after a correct password."""
        self._failures.pop(_lock_key(user, peer), None)


def _lock_key(user: str, peer: str) -> tuple[str, str]:
    return user if user in USERS else "", address_group(peer)
