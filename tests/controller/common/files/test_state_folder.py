"""Folder of the files that are kept from run to run."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.common.files import state_folder as module
from controller.common.files.lock import FileLockError, lock_file, place_problem
from controller.common.files.new_files import NewFiles
from controller.common.files.state_folder import state_folder


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the home folder of a user whose package is installed, so that no project file is beside it."""
    monkeypatch.setattr(module, "_ROOT", tmp_path / "site-packages")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


def test_a_checkout_keeps_its_files_in_var() -> None:
    assert state_folder() == Path("var")


@pytest.mark.parametrize("given", ["", "state", None])
def test_an_installed_package_uses_the_state_folder_of_the_user(
    given: str | None, installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Empty and relative paths in the variable count as none."""
    if given is not None:
        monkeypatch.setenv("XDG_STATE_HOME", given)
    assert state_folder() == installed / ".local/state/transplanter"


@pytest.mark.usefixtures("installed")
def test_the_variable_names_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / "state/transplanter"


@pytest.mark.usefixtures("installed")
def test_a_user_without_a_home_folder_uses_the_current_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home(_: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "expanduser", no_home)
    assert state_folder() == Path("var")


def test_the_state_folder_is_created_with_those_above_it_and_a_failed_start_removes_them(installed: Path) -> None:
    """Another folder is not: two missing folders are probably a typo."""
    path = state_folder() / "history.sqlite"
    assert place_problem(path) == ""
    files = NewFiles([path, path.with_name("history.sqlite.lock")])
    lock_file(path).release()
    assert state_folder().is_dir()
    files.remove()
    assert list(installed.iterdir()) == []
    with pytest.raises(FileLockError, match="does not exist"):
        lock_file(installed / ".local/typo/history.sqlite")
