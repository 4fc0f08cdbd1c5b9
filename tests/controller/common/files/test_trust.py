"""Folders and secrets that another user of the computer could have written or read."""

from __future__ import annotations

import grp
import os
import pwd
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from controller.common.files import trust
from controller.common.files.trust import exposure, secret_exposure, trusted_folder
from tests.controller.common.files.trust_rig import private_folders

NAME = "program-1"
WRITABLE = "other users can write it; run chmod go-w on it"


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return tmp_path / "above" / "cache"


def give_away(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a path belong to another user than the one of this process, who is not the administrator."""
    if os.geteuid() == 0:
        os.chown(path, 12_345, -1, follow_symlinks=False)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 12_345)


def test_a_new_folder_is_private_whatever_the_file_mode_mask_is(base: Path) -> None:
    before = os.umask(0)
    try:
        folder = trusted_folder(base, NAME)
    finally:
        os.umask(before)
    assert folder == base / NAME
    assert [stat.S_IMODE(each.stat().st_mode) for each in (folder, base, base.parent)] == [0o700] * 3
    assert trusted_folder(base, NAME) == folder


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702, 0o1777])
@pytest.mark.parametrize("place", ["folder", "base", "above"])
def test_a_folder_that_others_can_write_is_replaced_by_a_private_one_with_one_line(
    base: Path, place: str, mode: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The sticky bit protects what is in a folder above, not a folder whose content is looked up by name."""
    folder = trusted_folder(base, NAME)
    exposed = {"folder": folder, "base": base, "above": base.parent}[place]
    exposed.chmod(mode)
    monkeypatch.setattr(trust, "_private_group", lambda: None)
    with private_folders(monkeypatch):
        given = trusted_folder(base, NAME)
        if mode & stat.S_ISVTX and place != "folder":
            assert (given, caplog.messages) == (folder, [])
            return
        assert given.name == NAME
        assert not given.is_relative_to(base)
        assert exposure(given) is None
        assert trusted_folder(base, NAME) == given
    assert caplog.messages == [f"{exposed}: {WRITABLE}: machine code in it is not used, but compiled in {given.parent}"]


@pytest.mark.parametrize(
    ("name", "members", "is_private"),
    [("me", [], True), ("me", ["me"], True), ("me", ["you"], False), ("staff", [], False)],
)
def test_a_folder_that_the_private_group_of_the_user_can_write_is_used(
    base: Path, name: str, members: list[str], monkeypatch: pytest.MonkeyPatch, *, is_private: bool
) -> None:
    """With such groups, many systems create folders with mode 775."""
    folder = trusted_folder(base, NAME)
    base.chmod(0o775)
    group = base.stat().st_gid
    monkeypatch.setattr(pwd, "getpwuid", lambda _: SimpleNamespace(pw_name="me", pw_gid=group))
    monkeypatch.setattr(grp, "getgrgid", lambda _: SimpleNamespace(gr_name=name, gr_gid=group, gr_mem=members))
    trust._private_group.cache_clear()
    try:
        assert (exposure(folder) is None) == is_private
    finally:
        trust._private_group.cache_clear()


def test_nothing_is_created_in_a_folder_that_others_can_write(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base.mkdir(parents=True)
    base.chmod(0o777)
    with private_folders(monkeypatch):
        trusted_folder(base, NAME)
    assert list(base.iterdir()) == []


@pytest.mark.parametrize("place", ["folder", "base", "file"])
def test_what_belongs_to_another_user_is_not_used(base: Path, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = trusted_folder(base, NAME)
    planted = folder / "planted.o"
    planted.write_bytes(b"")
    give_away({"folder": folder, "base": base, "file": planted}[place], monkeypatch)
    with private_folders(monkeypatch):
        assert trusted_folder(base, NAME) != folder


def test_a_file_that_others_could_write_is_not_used_after_its_folder_is_closed(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = trusted_folder(base, NAME)
    (folder / "code.o").touch()
    (folder / "code.o").chmod(0o666)
    assert trusted_folder(base, NAME) == folder, "nobody else can reach it"
    folder.chmod(0o755)
    with private_folders(monkeypatch):
        assert trusted_folder(base, NAME) != folder
    (folder / "code.o").unlink()
    (folder / "link.o").symlink_to(base)
    with private_folders(monkeypatch):
        assert trusted_folder(base, NAME) != folder


def test_a_link_does_not_hide_the_folder_behind_it(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared = base.parent / "shared"
    (shared / "inner").mkdir(parents=True)
    shared.chmod(0o777)
    base.symlink_to(shared / "inner")
    assert exposure(base) == f"{shared}: {WRITABLE}"
    shared.chmod(0o755)
    assert exposure(base) is None
    give_away(base, monkeypatch)
    assert "belongs to another user" in str(exposure(base))


USES = (
    "import sys; from pathlib import Path; from controller.common.files.trust import trusted_folder; "
    "print(trusted_folder(Path(sys.argv[1]), 'child'))"
)


def test_a_child_uses_the_private_folder_of_its_parent_without_a_line(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base.mkdir(parents=True)
    base.chmod(0o777)
    with private_folders(monkeypatch):
        own = trusted_folder(base, NAME)
        child = subprocess.run([sys.executable, "-c", USES, base], check=True, capture_output=True, text=True)
        assert Path(child.stdout.strip()) == own.with_name("child")
        assert own.with_name("child").is_dir()
        own.parent.chmod(0o777)
        other = subprocess.run([sys.executable, "-c", USES, base], check=True, capture_output=True, text=True)
    assert Path(other.stdout.strip()).parent != own.parent
    assert not Path(other.stdout.strip()).exists(), "deleted at the end of its process"
    assert other.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("mode", "is_safe"), [(0o600, True), (0o400, True), (0o640, False), (0o604, False), (0o620, False)]
)
def test_a_secret_is_for_its_owner_alone(tmp_path: Path, mode: int, is_safe: bool) -> None:
    secret = tmp_path / "key.pem"
    secret.touch()
    secret.chmod(mode)
    assert (secret_exposure(secret) is None) is is_safe


def test_a_secret_of_the_administrator_may_be_readable_by_the_group_of_a_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    secret = tmp_path / "key.pem"
    secret.touch(mode=0o640)
    if os.geteuid() != 0:
        monkeypatch.setattr(trust, "_is_own", lambda _: True)
        status = os.stat_result((stat.S_IFREG | 0o640, 0, 0, 1, 0, 0, 0, 0, 0, 0))
        monkeypatch.setattr(Path, "stat", lambda *_, **__: status)
    monkeypatch.setattr(os, "geteuid", lambda: 12_345)
    assert secret_exposure(secret) is None


def test_without_owners_only_the_profile_of_the_user_is_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows has no file modes; `os.geteuid` is missing there."""
    monkeypatch.delattr(os, "geteuid")
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "user")
    inside, outside = tmp_path / "user" / "cache", tmp_path / "cache"
    outside.mkdir(mode=0o777)
    for _ in range(2):
        assert trusted_folder(inside, NAME) == inside / NAME
        (inside / NAME / "code.o").touch(mode=0o666)
    assert exposure(outside) == f"{outside}: outside the profile of the user; choose another folder"
    assert secret_exposure(outside) is None
