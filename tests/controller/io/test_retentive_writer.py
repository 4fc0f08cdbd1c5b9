"""Retentive writers: completion, replacement of pending values and store errors."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.core.retentive_store import FileStore, MemoryStore
from controller.io.retentive_writer import DirectRetentiveWriter, RetentiveWriter, ThreadedRetentiveWriter
from tests.controller.core.core_rig import PATIENT_S, GatedStore, wait_until


def values(n: int) -> dict[str, int]:
    return {"D512": n, "D513": n}


@pytest.fixture
def store(tmp_path: Path) -> GatedStore:
    return GatedStore(tmp_path / "retentive.json")


@pytest.fixture
def writer(store: GatedStore) -> Iterator[ThreadedRetentiveWriter]:
    writer = ThreadedRetentiveWriter(store)
    yield writer
    store.permit(1_000)
    writer.close()


def test_a_new_writer_is_settled(store: GatedStore, writer: ThreadedRetentiveWriter) -> None:
    assert (writer.settled, writer.error, store.load()) == (True, None, None)


def test_submitted_values_are_settled_once_they_are_in_the_file(
    store: GatedStore, writer: ThreadedRetentiveWriter
) -> None:
    for n in range(1, 4):
        writer.submit(values(n))
        assert not writer.settled
        store.wait_for_start()
        assert not writer.settled
        assert store.load() == (values(n - 1) if n > 1 else None)
        store.permit()
        assert wait_until(writer, lambda: writer.settled)
        assert FileStore(store.path).load() == values(n)


def test_submitting_never_waits_for_the_store_and_only_the_newest_values_are_saved(
    store: GatedStore, writer: ThreadedRetentiveWriter
) -> None:
    writer.submit(values(1))
    store.wait_for_start()
    for n in range(2, 100):
        writer.submit(values(n))
    store.permit(2)
    assert wait_until(writer, lambda: writer.settled)
    assert store.requested == [values(1), values(99)]
    assert store.load() == values(99)


def test_the_writer_is_not_settled_while_newer_values_are_pending(
    store: GatedStore, writer: ThreadedRetentiveWriter
) -> None:
    writer.submit(values(1))
    store.wait_for_start()
    writer.submit(values(2))
    store.permit()
    store.wait_for_start()  # the second save has started, so the first is complete
    assert store.load() == values(1)
    assert not writer.settled
    store.permit()
    assert wait_until(writer, lambda: writer.settled)
    assert store.load() == values(2)


def test_closing_saves_pending_values(store: GatedStore) -> None:
    writer = ThreadedRetentiveWriter(store)
    writer.submit(values(1))
    store.wait_for_start()
    writer.submit(values(2))
    closing = threading.Thread(target=writer.close)
    closing.start()
    store.permit(2)
    closing.join(PATIENT_S)
    assert not closing.is_alive()
    assert store.load() == values(2)
    assert writer.settled


def test_closing_without_pending_values_ends_the_thread() -> None:
    before = threading.active_count()
    writer = ThreadedRetentiveWriter(MemoryStore())
    assert threading.active_count() == before + 1
    writer.close()
    assert threading.active_count() == before


def test_a_store_error_is_reported_until_the_next_success(store: GatedStore, writer: ThreadedRetentiveWriter) -> None:
    store.permit(3)
    writer.submit(values(1))
    assert wait_until(writer, lambda: writer.settled)
    obstacle = store.path.with_name(store.path.name + ".new")
    obstacle.mkdir()
    writer.submit(values(2))
    assert wait_until(writer, lambda: writer.error is not None)
    assert "Is a directory" in str(writer.error)
    assert not writer.settled
    assert store.load() == values(1)
    obstacle.rmdir()
    assert "Is a directory" in str(writer.error)
    writer.submit(values(3))
    assert wait_until(writer, lambda: writer.settled)
    assert writer.error is None
    assert store.load() == values(3)


def test_a_file_in_place_of_the_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "var").write_text("not a folder")
    writer = ThreadedRetentiveWriter(FileStore(tmp_path / "var" / "retentive.json"))
    writer.submit(values(1))
    writer.close()
    assert "Not a directory" in str(writer.error)
    assert not writer.settled


@pytest.mark.parametrize("make", [DirectRetentiveWriter, ThreadedRetentiveWriter])
def test_after_closing_any_writer_the_last_values_are_in_the_store(
    make: type[DirectRetentiveWriter] | type[ThreadedRetentiveWriter], tmp_path: Path
) -> None:
    store = FileStore(tmp_path / "retentive.json")
    writer: RetentiveWriter = make(store)
    for n in range(20):
        writer.submit(values(n))
    writer.close()
    assert writer.settled
    assert writer.error is None
    assert store.load() == values(19)


def test_a_direct_writer_reports_a_store_error_until_the_next_success(tmp_path: Path) -> None:
    store = FileStore(tmp_path / "retentive.json")
    writer = DirectRetentiveWriter(store)
    obstacle = tmp_path / "retentive.json.new"
    obstacle.mkdir()
    writer.submit(values(1))
    assert "Is a directory" in str(writer.error)
    assert not writer.settled
    obstacle.rmdir()
    writer.submit(values(2))
    assert (writer.settled, writer.error, store.load()) == (True, None, values(2))


def test_a_direct_writer_saves_before_it_returns() -> None:
    store = MemoryStore()
    writer = DirectRetentiveWriter(store)
    writer.submit(values(1))
    assert writer.settled
    assert store.load() == values(1)
