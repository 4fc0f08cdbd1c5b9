"""Marks of the retentive memory: no crash is taken for an old copy, and no old or copied file for a crash."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from controller.core.retentive_store import DamagedStoreError, FileStore
from tests.controller.core.disk import Disk, Files

MEMORY, MARK = "retentive.json", "retentive.json.mark"
FORMER = b'{"format": "transplanter-retentive-1", "values": {"D512": 7}, "sha256": "0"}'


@dataclass(frozen=True)
class Progress:
    """Progress of a run when it crashes.

    Attributes:
        durable: Values of the last save that has returned; 0 = none.
        begun: Values of the last save that has begun.
        state: "open" after a confirmed save, "closed" after the end of a run, empty if either is possible.
    """

    durable: int = 0
    begun: int = 0
    state: str = ""


class Folder:
    """Folder with a store that is filled with given files."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.mkdir(exist_ok=True)

    def put(self, files: Files) -> FileStore:
        for old in self.path.iterdir():
            old.unlink()
        for name, content in files.items():
            (self.path / name).write_bytes(content)
        return FileStore(self.path / MEMORY)

    def files(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in self.path.iterdir()}

    def refusal(self, files: Files) -> str:
        """Return the reason for which `load` refuses these files; empty if it accepts them."""
        store = self.put(files)
        try:
            store.load()
        except DamagedStoreError as error:
            return str(error)
        return ""


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path / "var")


def values(n: int) -> dict[str, int]:
    return {"D512": n}


def loaded(store: FileStore) -> int:
    found = store.load()
    return 0 if found is None else found["D512"]


ACTIONS = "save confirm save confirm save save confirm close start save confirm save close start save save confirm"
"""Two orderly runs, with saves that follow each other before the first one is confirmed, and the begin of a third."""
RESTARTED = "start save confirm save confirm close"
"""Run after a crash."""


def crashes(folder: Folder, files: Files, actions: str, patch: pytest.MonkeyPatch) -> list[tuple[Progress, Files]]:
    """Carry out the actions of a store on these files, and return every state in which a crash may leave the disk."""
    store = folder.put(files)
    progress = Progress(first := loaded(FileStore(store.path)), first)
    disk = Disk(folder.path)
    with patch.context() as watched:
        disk.watch(watched)
        for action in actions.split():
            disk.note = progress
            if action == "start":
                store = FileStore(store.path)
                assert loaded(store) == progress.durable
            elif action == "save":
                disk.note = progress = Progress(progress.durable, progress.begun + 1)
                store.save(values(progress.begun))
                progress = Progress(progress.begun, progress.begun)
            elif action == "confirm":
                store.confirm()
                progress = Progress(progress.durable, progress.begun, "open")
            else:
                disk.note = Progress(progress.durable, progress.begun)
                store.close()
                progress = Progress(progress.durable, progress.begun, "closed")
            disk.note = progress
            disk.record()
    return [(note, dict(found)) for note, found in dict.fromkeys(disk.seen)]


def check(folder: Folder, progress: Progress, files: Files) -> None:
    """Check that the files of a crash are accepted, with no values that are older than the last save that returned."""
    assert folder.refusal(files) == "", progress
    store = folder.put(files)
    assert progress.durable <= loaded(store) <= progress.begun
    if progress.state:
        assert store.interrupted is (progress.state == "open"), progress


def generations(files: Files) -> tuple[int, int, bool]:
    """Return mark A, mark B and whether the run is open."""
    memory, mark = (json.loads(files[name]) if name in files else {} for name in (MEMORY, MARK))
    return memory.get("generation", 0), mark.get("generation", -1), mark.get("open", False)


def test_no_crash_at_any_operation_is_a_false_alarm(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    found = crashes(folder, {}, ACTIONS, monkeypatch)
    for progress, files in found:
        check(folder, progress, files)
    assert len(found) > 35
    assert {a - b for a, b, _ in (generations(files) for _, files in found)} == {0, 1}


def test_a_second_crash_after_any_crash_is_no_false_alarm(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    first = {generations(files): files for _, files in crashes(folder, {}, ACTIONS, monkeypatch)}
    for files in first.values():
        for progress, later in crashes(folder, files, RESTARTED, monkeypatch):
            check(folder, progress, later)
    assert len(first) > 15


def history(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> list[Files]:
    """Return all states of the disk in the life of one store, one for each pair of files."""
    return list({generations(files): files for _, files in crashes(folder, {}, ACTIONS, monkeypatch)}.values())


def versions(states: Iterable[Files], name: str) -> list[bytes]:
    return sorted({files[name] for files in states if name in files}, key=lambda text: json.loads(text)["generation"])


def test_of_all_pairs_of_files_only_those_of_a_crash_are_accepted(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    states = history(folder, monkeypatch)
    accepted = []
    for memory in versions(states, MEMORY):
        for mark in versions(states, MARK):
            files = {MEMORY: memory, MARK: mark}
            a, b, _ = generations(files)
            refusal = folder.refusal(files)
            if refusal:
                assert refusal.endswith("; retentive memory is lost; check rows and claws before resetting")
                assert "\n" not in refusal
                assert f"an old copy: the mark says {b}, the memory says {a};" in refusal
                assert refusal.startswith(str(folder.path / (MEMORY if b > a else MARK)) + ":")
            else:
                accepted.append((a, b))
    every_a, every_b = {a for a, _ in accepted}, {b for _, b in accepted}
    assert (min(every_a), min(every_b), max(every_a)) == (1, 0, 8)
    assert set(accepted) == {(a, b) for a in every_a for b in (a - 1, a) if b in every_b}


def test_an_old_memory_is_accepted_in_one_case_only(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    """No file can tell a copy that is one save old from a crash between both marks in which that save was lost."""
    states = history(folder, monkeypatch)
    undetected = []
    for files in states:
        a, b, _ = generations(files)
        for memory in versions(states, MEMORY):
            old, _, _ = generations({MEMORY: memory})
            if old < a and not folder.refusal({**files, MEMORY: memory}):
                undetected.append((a - old, a - b))
    assert set(undetected) == {(1, 1)}


def test_a_missing_file_is_detected(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    for files in history(folder, monkeypatch):
        a, b, _ = generations(files)
        if a > 0:
            assert f"{MARK} is missing, so it may be an old copy" in folder.refusal({MEMORY: files[MEMORY]})
        if b >= 0:
            refusal = folder.refusal({MARK: files[MARK]})
            assert (f"{MEMORY}: missing, although {MARK} exists" in refusal) is (b > 0)


def one_store(folder: Folder, n: int) -> dict[str, bytes]:
    store = folder.put({})
    for each in range(1, n + 1):
        store.save(values(each))
        store.confirm()
    return folder.files()


def test_memory_of_another_machine_is_detected(folder: Folder) -> None:
    ours, theirs = one_store(folder, 3), one_store(folder, 3)
    refusal = folder.refusal({**ours, MEMORY: theirs[MEMORY]})
    assert f"memory of another machine: {MARK} belongs to another store" in refusal
    assert folder.refusal({**ours, MARK: theirs[MARK]})
    assert not folder.refusal(theirs)


def test_memory_of_an_earlier_version_is_detected(folder: Folder) -> None:
    for files in ({}, one_store(folder, 3)):
        assert "memory of an earlier version, without marks" in folder.refusal({**files, MEMORY: FORMER})


@pytest.mark.parametrize("names", [(MARK, MEMORY), (MEMORY, MEMORY), (MARK, MARK)])
def test_exchanged_files_are_detected(folder: Folder, names: tuple[str, str]) -> None:
    files = one_store(folder, 3)
    assert folder.refusal(dict(zip((MEMORY, MARK), (files[name] for name in names), strict=True)))


def test_the_whole_folder_restored_is_not_detected(folder: Folder) -> None:
    """Both files of one moment agree, whenever they are put back."""
    early = one_store(folder, 2)
    store = folder.put(early)
    store.save(values(3))
    store.close()
    assert loaded(folder.put(early)) == 2


def refused(files: Files) -> Iterator[Files]:
    yield {name: content for name, content in files.items() if name == MEMORY}
    yield {name: content for name, content in files.items() if name == MARK}
    yield {**files, MEMORY: FORMER}
    yield {**files, MARK: b"damaged"}


def test_a_crash_while_files_are_set_aside_never_revives_them(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    for files in refused(one_store(folder, 3)):
        store = folder.put(files)
        with pytest.raises(DamagedStoreError):
            store.load()
        disk = Disk(folder.path)
        with monkeypatch.context() as watched:
            disk.watch(watched)
            store.set_aside()
            store.save(values(9))
            store.confirm()
            disk.record()
        assert loaded(FileStore(store.path)) == 9
        for _, found in disk.seen:
            left = dict(found)
            assert folder.refusal(left) or loaded(folder.put(left)) in (0, 9)


def test_a_memory_that_is_set_aside_for_its_values_is_not_continued(folder: Folder) -> None:
    """Memory of another program is loaded before it is set aside; its copy does not belong to the new store."""
    old = one_store(folder, 3)
    store = folder.put(old)
    assert loaded(store) == 3
    store.set_aside()
    store.save(values(9))
    assert loaded(FileStore(store.path)) == 9
    store.confirm()
    assert "memory of another machine" in folder.refusal({**folder.files(), MEMORY: old[MEMORY]})


def test_a_failed_confirmation_precedes_the_next_save(folder: Folder) -> None:
    """Mark B is never more than one behind, although its file cannot be written for a while."""
    store = folder.put(one_store(folder, 1))
    obstacle = folder.path / (MARK + ".new")
    store.save(values(2))
    obstacle.mkdir()
    for attempt in (store.confirm, lambda: store.save(values(3)), store.close):
        with pytest.raises(OSError, match="directory"):
            attempt()
    assert loaded(FileStore(store.path)) == 2
    obstacle.rmdir()
    store.save(values(3))
    assert generations(folder.files()) == (3, 2, True)
    assert loaded(FileStore(store.path)) == 3


def test_a_failed_save_is_repeated_with_the_same_generation(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    """The name of the new file is given, but the folder cannot be synchronised: the save has failed."""
    store = folder.put(one_store(folder, 1))
    with monkeypatch.context() as broken:
        broken.setattr("os.open", lambda *_: (_ for _ in ()).throw(OSError("no folder")))
        for _ in range(3):
            with pytest.raises(OSError, match="no folder"):
                store.save(values(2))
            assert loaded(FileStore(store.path)) == 2
    store.save(values(3))
    assert generations(folder.files()) == (2, 1, True)
