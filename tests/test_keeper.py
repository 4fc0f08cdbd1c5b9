"""The keeper between the scan and the store: what is settled, what is newest, what is refused."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from core_rig import PATIENT_S, GatedStore, wait_until

from controller.core.retain import FileStore, MemoryStore
from controller.io.keeper import DirectKeeper, Keeper, ThreadKeeper


def values(n: int) -> dict[str, int]:
    return {"D512": n, "D513": n}


@pytest.fixture
def store(tmp_path: Path) -> GatedStore:
    return GatedStore(tmp_path / "retentive.json")


@pytest.fixture
def keeper(store: GatedStore) -> Iterator[ThreadKeeper]:
    keeper = ThreadKeeper(store)
    yield keeper
    store.let(1_000)
    keeper.close()


def test_with_nothing_submitted_all_is_settled(store: GatedStore, keeper: ThreadKeeper) -> None:
    assert (keeper.settled, keeper.error, store.load()) == (True, None, None)


def test_what_is_submitted_is_settled_when_it_is_in_the_file_and_not_before(
    store: GatedStore, keeper: ThreadKeeper
) -> None:
    for n in range(1, 4):
        keeper.submit(values(n))
        assert not keeper.settled
        store.wait_for_begin()
        assert not keeper.settled
        assert store.load() == (values(n - 1) if n > 1 else None)
        store.let()
        assert wait_until(keeper, lambda: keeper.settled)
        assert FileStore(store.path).load() == values(n)


def test_submitting_never_waits_for_the_store_and_only_the_newest_is_saved(
    store: GatedStore, keeper: ThreadKeeper
) -> None:
    keeper.submit(values(1))
    store.wait_for_begin()
    for n in range(2, 100):
        keeper.submit(values(n))
    store.let(2)
    assert wait_until(keeper, lambda: keeper.settled)
    assert store.asked == [values(1), values(99)]
    assert store.load() == values(99)


def test_an_older_state_in_the_file_settles_nothing_while_a_newer_one_waits(
    store: GatedStore, keeper: ThreadKeeper
) -> None:
    keeper.submit(values(1))
    store.wait_for_begin()
    keeper.submit(values(2))
    store.let()
    store.wait_for_begin()  # the second has begun, so the first is done
    assert store.load() == values(1)
    assert not keeper.settled
    store.let()
    assert wait_until(keeper, lambda: keeper.settled)
    assert store.load() == values(2)


def test_closing_saves_what_is_pending(store: GatedStore) -> None:
    keeper = ThreadKeeper(store)
    keeper.submit(values(1))
    store.wait_for_begin()
    keeper.submit(values(2))
    closing = threading.Thread(target=keeper.close)
    closing.start()
    store.let(2)
    closing.join(PATIENT_S)
    assert not closing.is_alive()
    assert store.load() == values(2)
    assert keeper.settled


def test_closing_with_nothing_pending_ends_the_thread() -> None:
    before = threading.active_count()
    keeper = ThreadKeeper(MemoryStore())
    assert threading.active_count() == before + 1
    keeper.close()
    assert threading.active_count() == before


def test_a_store_that_refuses_is_an_error_until_it_takes_something(store: GatedStore, keeper: ThreadKeeper) -> None:
    store.let(3)
    keeper.submit(values(1))
    assert wait_until(keeper, lambda: keeper.settled)
    in_the_way = store.path.with_name(store.path.name + ".new")
    in_the_way.mkdir()
    keeper.submit(values(2))
    assert wait_until(keeper, lambda: keeper.error is not None)
    assert "Is a directory" in str(keeper.error)
    assert not keeper.settled
    assert store.load() == values(1)
    in_the_way.rmdir()
    assert "Is a directory" in str(keeper.error)
    keeper.submit(values(3))
    assert wait_until(keeper, lambda: keeper.settled)
    assert keeper.error is None
    assert store.load() == values(3)


def test_a_file_in_place_of_the_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "var").write_text("not a folder")
    keeper = ThreadKeeper(FileStore(tmp_path / "var" / "retentive.json"))
    keeper.submit(values(1))
    keeper.close()
    assert isinstance(keeper.error, OSError)
    assert not keeper.settled


@pytest.mark.parametrize("make", [DirectKeeper, ThreadKeeper])
def test_whatever_the_keeper_the_last_values_are_in_the_store_after_closing(
    make: type[DirectKeeper] | type[ThreadKeeper], tmp_path: Path
) -> None:
    store = FileStore(tmp_path / "retentive.json")
    keeper: Keeper = make(store)
    for n in range(20):
        keeper.submit(values(n))
    keeper.close()
    assert keeper.settled
    assert keeper.error is None
    assert store.load() == values(19)


def test_a_direct_keeper_is_refused_until_the_store_takes_something(tmp_path: Path) -> None:
    store = FileStore(tmp_path / "retentive.json")
    keeper = DirectKeeper(store)
    in_the_way = tmp_path / "retentive.json.new"
    in_the_way.mkdir()
    keeper.submit(values(1))
    assert "Is a directory" in str(keeper.error)
    assert not keeper.settled
    in_the_way.rmdir()
    keeper.submit(values(2))
    assert (keeper.settled, keeper.error, store.load()) == (True, None, values(2))


def test_a_direct_keeper_has_saved_when_it_returns() -> None:
    store = MemoryStore()
    keeper = DirectKeeper(store)
    keeper.submit(values(1))
    assert keeper.settled
    assert store.load() == values(1)
