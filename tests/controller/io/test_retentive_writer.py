"""Retentive writers: completion, replacement of pending values and store errors."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from controller.common.errors import InputError
from controller.core.retentive_store import FileStore, MemoryStore
from controller.io.retentive_writer import (
    DirectRetentiveWriter,
    RetentiveWriter,
    ThreadedRetentiveWriter,
    writer_until_end,
)
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


# ---- marks ----------------------------------------------------------------------------------------------------


def marks(store: FileStore) -> tuple[int, int, bool]:
    """Return mark A, mark B and whether the run is open."""
    memory, mark = json.loads(store.path.read_bytes()), json.loads(store.mark_path.read_bytes())
    return memory["generation"], mark["generation"], mark["open"]


class LateStore(MemoryStore):
    """Store that confirms a save only when the test permits it."""

    def __init__(self) -> None:
        super().__init__()
        self.permitted = threading.Event()

    def confirm(self) -> None:
        assert self.permitted.wait(PATIENT_S)


@pytest.mark.parametrize("threaded", [True, False])
def test_each_save_is_confirmed_without_a_further_one(tmp_path: Path, threaded: bool) -> None:
    store = FileStore(tmp_path / "retentive.json")
    writer = ThreadedRetentiveWriter(store) if threaded else DirectRetentiveWriter(store)
    writer.submit(values(1))
    writer.close()
    assert marks(store) == (1, 1, True)


def test_values_are_settled_before_their_save_is_confirmed() -> None:
    store = LateStore()
    writer = ThreadedRetentiveWriter(store)
    writer.submit(values(1))
    settled = wait_until(writer, lambda: writer.settled)
    still_open = not store.permitted.is_set()
    store.permitted.set()
    writer.close()
    assert (settled, still_open) == (True, True)


@pytest.mark.parametrize("threaded", [True, False])
def test_an_error_of_a_confirmation_is_a_store_error_until_the_next_success(tmp_path: Path, threaded: bool) -> None:
    store = FileStore(tmp_path / "retentive.json")
    store.save(values(0))
    store.confirm()
    writer = ThreadedRetentiveWriter(store) if threaded else DirectRetentiveWriter(store)
    obstacle = tmp_path / "retentive.json.mark.new"
    obstacle.mkdir()

    def failed() -> bool:
        return writer.error is not None

    writer.submit(values(1))
    assert wait_until(writer, failed) if isinstance(writer, ThreadedRetentiveWriter) else failed()
    assert "Is a directory" in str(writer.error)
    assert not writer.settled
    obstacle.rmdir()
    writer.submit(values(2))
    writer.close()
    assert (writer.settled, writer.error, marks(store)) == (True, None, (3, 3, True))


@pytest.mark.parametrize("threaded", [True, False])
@pytest.mark.parametrize(
    ("error", "in_order"), [(None, True), (InputError("port in use"), True), (RuntimeError("unexpected"), False)]
)
def test_the_end_in_order_is_recorded_after_the_last_save(
    store: GatedStore, threaded: bool, error: Exception | None, in_order: bool
) -> None:
    """The save begins at the end of the block, and is complete before the end is recorded."""
    store.permit(1)
    with suppress(InputError, RuntimeError), writer_until_end(store, threaded=threaded) as writer:
        writer.submit(values(1))
        if error is not None:
            raise error
    assert marks(store) == (1, 1, not in_order)
    assert FileStore(store.path).load() == values(1)


@pytest.mark.parametrize("threaded", [True, False])
def test_an_end_with_values_that_are_not_stored_is_not_in_order_and_told(
    tmp_path: Path, threaded: bool, caplog: pytest.LogCaptureFixture
) -> None:
    store = FileStore(tmp_path / "retentive.json")
    with writer_until_end(store, threaded=threaded) as writer:
        writer.submit(values(1))
        if threaded:
            assert isinstance(writer, ThreadedRetentiveWriter)
            assert wait_until(writer, lambda: writer.settled)
        (tmp_path / "retentive.json.new").mkdir()
        writer.submit(values(2))
    assert marks(store)[2] is True
    assert FileStore(store.path).load() == values(1)
    assert [record.message for record in caplog.records if "the last values are not stored" in record.message]


@pytest.mark.parametrize("threaded", [True, False])
def test_an_end_that_cannot_be_recorded_is_told(
    tmp_path: Path, threaded: bool, caplog: pytest.LogCaptureFixture
) -> None:
    store = FileStore(tmp_path / "retentive.json")
    with writer_until_end(store, threaded=threaded) as writer:
        writer.submit(values(1))
        writer.close()
        (tmp_path / "retentive.json.mark.new").mkdir()
    (message,) = [record.message for record in caplog.records]
    assert message.startswith("retentive memory: the end of the run is not recorded: ")
    assert FileStore(store.path).load() == values(1)
