"""Retentive memory: the retentive devices, and a file that is complete after any power failure."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.core import retentive_store
from controller.core.expr import Bit, Counter, Timer, Word
from controller.core.program import Block, Program
from controller.core.retentive_store import DamagedStoreError, FileStore, MemoryStore, NewerStoreError
from controller.core.rungs import Count, Inc, Mov, OnDelay, Out, Rst, Rung, Set
from controller.core.scan import Plc
from tests.controller.core.core_rig import THOROUGH, Rig, copied, d, m, program_of, s, x
from tests.paths import ROOT
from tests.sampling import examples, first_of, one_in

VALUES = {"C100": 1, "CN100": 3, "D512": -32_768, "D513": 32_767, "M500": 0, "M501": 1}


@pytest.fixture
def store(tmp_path: Path) -> FileStore:
    return FileStore(tmp_path / "var" / "retentive.json")


# ---- retentive devices ----------------------------------------------------------------------------------------


def retained_names(*rungs: Rung) -> list[str]:
    return list(Plc(program_of(*rungs)).retained())


def test_only_devices_of_the_program_in_battery_backed_ranges_are_retained() -> None:
    assert retained_names(
        Out(m(499), when=x(0)),
        Out(m(500), when=m(3071)),
        Set(s(500)),
        Set(s(20)),
        Mov(d(199), d(200)),
        Inc(d(7999), when=x(0)),
        Mov(1, d(8000)),
        Rst(m(1024)),
    ) == ["D200", "D7999", "M500", "M1024", "M3071"]


def test_a_retentive_timer_or_counter_retains_its_contact_and_its_current_value() -> None:
    assert retained_names(
        OnDelay(Timer(245), 10),
        OnDelay(Timer(246), 10),
        Count(Counter(99), 1, x(0)),
        Count(Counter(100), 1, x(0)),
        Rst(Counter(220)),
        Mov(Word("C", 199), d(0)),
    ) == ["C100", "CN100", "C199", "CN199", "C220", "CN220", "T246", "TN246"]


def test_system_bits_and_set_points_are_retained_with_their_names() -> None:
    program = Program(
        "names",
        (Block("all", (Set(m(500)), Set(Bit("M", 500, "left.loaded")))),),
        outputs="all",
        system=(m(501), m(100)),
        set_points=((d(512), 7), (d(100), 7)),
    )
    assert [str(device) for device in program.retentive] == ["D512", "M500", "M501"]
    assert [device.name for device in program.retentive] == ["", "left.loaded", ""]


COUNTING: list[Rung] = [
    Count(Counter(100), 3, when=x(0)),
    Count(Counter(220), 3, when=x(0)),
    OnDelay(Timer(250), 300, when=x(1)),
    Inc(d(512), when=x(2)),
    Set(m(500), when=x(2)),
    Set(s(500), when=x(2)),
]


@THOROUGH
@given(st.lists(st.sets(st.integers(0, 2)), min_size=1, max_size=12), st.integers(0, 12))
def test_a_power_cycle_changes_no_retentive_device(inputs: list[set[int]], off_after: int) -> None:
    """After a power cycle, a PLC continues counting exactly as if it had been idle for one scan."""
    cycled, steady = Rig(*COUNTING, scan_ms=100), Rig(*COUNTING, scan_ms=100)
    for n, on in enumerate(inputs):
        if n == off_after:
            retained = cycled.plc.retained()
            cycled = Rig(*COUNTING, scan_ms=100)
            cycled.plc.restore_retained(retained)
            assert cycled.plc.retained() == retained
            cycled.scan()
            steady.scan()
            assert not cycled.memory.S[500]
        cycled.scan(*on)
        steady.scan(*on)
        assert cycled.plc.retained() == steady.plc.retained()


@pytest.mark.parametrize("foreign", [{}, {"D512": 1}, dict(VALUES), {"C100": 0, "D512": 0, "D9": 0, "M500": 1}])
def test_memory_of_another_program_is_rejected_and_changes_nothing(foreign: dict[str, int]) -> None:
    rig = Rig(*COUNTING)
    rig.scan(0, 2)
    before = copied(rig.memory)
    with pytest.raises(ValueError, match="retentive devices of another program: "):
        rig.plc.restore_retained(foreign)
    assert rig.memory == before


def test_the_error_lists_missing_and_unknown_names() -> None:
    plc = Plc(program_of(*COUNTING))
    retained = plc.retained()
    with pytest.raises(ValueError, match=r"another program: D513$"):
        plc.restore_retained(retained | {"D513": 0})
    del retained["TN250"]
    with pytest.raises(ValueError, match=r"another program: TN250$"):
        plc.restore_retained(retained)


def test_the_retentive_image_changes_with_every_retentive_device() -> None:
    rig = Rig(*COUNTING, Inc(d(100), when=x(3)), OnDelay(Timer(251), d(513), when=x(1)), scan_ms=100)
    rig.plc.write(d(513), 99)
    rig.scan()

    def changes(*on: int) -> bool:
        image, retained = rig.plc.retentive_image(), rig.plc.retained()
        rig.scan(*on)
        assert (rig.plc.retained() != retained) is (rig.plc.retentive_image() != image)
        return rig.plc.retentive_image() != image

    inputs: dict[str, list[int]] = {
        "at rest": [],
        "not retentive": [3],
        "counted": [0],
        "held": [0],
        "set": [2],
        "driven": [1],
        "timed": [1],
    }
    changed = {name for name, on in inputs.items() if changes(*on)}
    assert changed == {"counted", "set", "timed"}
    rig.plc.write(d(513), 0)
    image, value = rig.plc.retentive_image(), rig.memory.TV[251]
    rig.scan(1, after_ms=0)
    assert (rig.memory.T[251], rig.memory.TV[251]) == (True, value)
    assert rig.plc.retentive_image() != image


# ---- the file -------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(st.dictionaries(st.text(max_size=8), st.integers(-(2**31), 2**31 - 1), max_size=20))
def test_saved_values_are_loaded(tmp_path_factory: pytest.TempPathFactory, values: dict[str, int]) -> None:
    store = FileStore(tmp_path_factory.getbasetemp() / "round trip.json")
    store.save({"D0": 1})
    store.save(values)
    assert FileStore(store.path).load() == values


def test_a_store_that_was_never_saved_loads_nothing(store: FileStore) -> None:
    assert store.load() is None
    memory = MemoryStore()
    assert memory.load() is None
    values = dict(VALUES)
    memory.save(values)
    values["D512"] = 0
    assert memory.load() == VALUES


def loads(store: FileStore) -> bool:
    try:
        store.load()
    except (DamagedStoreError, NewerStoreError):
        return False
    return True


@pytest.mark.parametrize("name", ["retentive.json", "retentive.json.mark"])
def test_every_changed_byte_is_detected(store: FileStore, name: str) -> None:
    """A file is rejected if any bit is inverted or any byte is replaced by a space, a tab or a digit."""
    store.save(VALUES)
    store.confirm()
    path = store.path.with_name(name)
    text = path.read_bytes()
    accepted = []
    with path.open("r+b", buffering=0) as file:

        def put(place: int, byte: int) -> None:
            file.seek(place)
            file.write(bytes([byte]))

        for place, byte in enumerate(text):
            for other in {*(byte ^ 1 << bit for bit in range(8)), *b" \t1"} - {byte}:
                put(place, other)
                if loads(store):
                    accepted.append((place, byte, other))
            put(place, byte)
    assert accepted == []
    assert store.load() == VALUES


@pytest.mark.parametrize("name", ["retentive.json", "retentive.json.mark"])
def test_every_truncation_is_detected(store: FileStore, name: str) -> None:
    store.save(VALUES)
    path = store.path.with_name(name)
    for size in reversed(range(path.stat().st_size)):
        os.truncate(path, size)
        assert not loads(store), f"truncated to {size} bytes"


@examples(20, nightly=60)
@given(st.data())
def test_any_other_damage_is_detected(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    store = FileStore(tmp_path_factory.getbasetemp() / "damaged.json")
    store.set_aside()  # that of the last example
    store.save(VALUES)
    text = store.path.read_bytes()
    start, end = sorted(data.draw(st.tuples(*[st.integers(0, len(text))] * 2)))
    damaged = text[:start] + data.draw(st.binary(max_size=20)) + text[end:]
    store.path.write_bytes(damaged)
    if damaged != text:
        assert not loads(store)


@pytest.mark.parametrize(
    "content",
    [
        "[" * 100_000,
        '{"a":' * 900 + "1" + "}" * 900,
        '{"format": []}',
        "",
        "[]",
        "null",
        "7",
        "{}",
        '{"values": {}}',
        '{"values": 7}',
        '{"values": [["D512", 1]]}',
        "\x00" * 200,
    ],
    ids=lambda content: ascii(content[:30]),
)
def test_a_file_that_is_not_a_store_is_rejected(store: FileStore, content: str) -> None:
    store.save(VALUES)
    store.path.write_text(content)
    with pytest.raises(DamagedStoreError, match="retentive memory is lost; check rows and claws before resetting"):
        store.load()


@pytest.mark.parametrize("value", ["1", "1.0", "true", "null", "[1]"])
def test_values_that_are_not_integers_are_rejected_even_with_a_valid_checksum(store: FileStore, value: str) -> None:
    store.save({"D512": json.loads(value)})
    if value == "1":
        assert store.load() == {"D512": 1}
    else:
        with pytest.raises(DamagedStoreError, match="checksum or format does not match"):
            store.load()


@pytest.mark.parametrize("format_", ["transplanter-retentive-0", "other-retentive-3", "transplanter-retentive-x", "3"])
def test_an_unknown_format_is_rejected(store: FileStore, monkeypatch: pytest.MonkeyPatch, format_: str) -> None:
    with monkeypatch.context() as later:
        later.setattr("controller.core.retentive_store.FORMAT", format_)
        store.save(VALUES)
        assert store.load() == VALUES
    with pytest.raises(DamagedStoreError, match="checksum or format does not match"):
        store.load()


@pytest.mark.parametrize("name", ["FORMAT", "MARK_FORMAT"])
def test_a_store_of_a_newer_program_is_refused_and_not_changed(
    store: FileStore, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    with monkeypatch.context() as later:
        known = getattr(retentive_store, name)
        later.setattr(retentive_store, name, f"{known[:-1]}{int(known[-1]) + 1}")
        store.save(VALUES)
        store.confirm()
    before = {path: path.read_bytes() for path in store.path.parent.iterdir()}
    for use in (store.load, lambda: FileStore(store.path).save(VALUES)):
        with pytest.raises(NewerStoreError, match="is newer than transplanter-retentive") as refused:
            use()
        assert "\n" not in str(refused.value)
    assert {path: path.read_bytes() for path in store.path.parent.iterdir()} == before


@pytest.mark.parametrize("lacking", ["store", "generation", "values"])
def test_a_store_without_a_part_is_rejected_even_with_a_valid_checksum(store: FileStore, lacking: str) -> None:
    store.save(VALUES)
    content = json.loads(store.path.read_bytes())
    del content["sha256"], content[lacking]
    store.path.write_bytes(retentive_store._document(content))
    with pytest.raises(DamagedStoreError, match="not a retentive store"):
        store.load()


def test_a_folder_in_place_of_the_file_is_rejected(store: FileStore) -> None:
    store.path.mkdir(parents=True)
    with pytest.raises(DamagedStoreError, match="Is a directory; retentive memory is lost"):
        store.load()
    with pytest.raises(DamagedStoreError, match="Is a directory"):
        store.save(VALUES)
    (aside,) = store.set_aside()
    assert aside.is_dir()
    assert store.load() is None


def test_a_failed_write_preserves_the_old_state(store: FileStore) -> None:
    store.save(VALUES)
    store.path.with_name(store.path.name + ".new").mkdir()
    with pytest.raises(OSError, match="directory"):
        store.save({"D512": 7})
    assert store.load() == VALUES


def test_a_damaged_file_is_renamed_and_a_new_store_can_be_written(store: FileStore) -> None:
    store.save(VALUES)
    for number, content in enumerate(("first damage", "second damage"), start=1):
        store.path.write_text(content)
        aside, mark_aside = store.set_aside()
        assert (aside.parent, aside.read_text()) == (store.path.parent, content)
        assert (aside.name, mark_aside.name) == (
            f"retentive.json.damaged-{number}",
            f"retentive.json.damaged-{number}.mark",
        )
        assert store.load() is None
        store.save(VALUES)
        assert store.load() == VALUES
    assert aside.with_name("retentive.json.damaged-1").read_text() == "first damage"


def test_the_new_state_is_synchronized_before_the_rename_and_the_folder_before_saving_ends(
    store: FileStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The order is checked at each call of fsync; a kill would not reveal an error, as the page cache survives."""
    store.save({"D512": 1})
    store.confirm()
    synchronized: list[tuple[int, int, object]] = []
    fsync = os.fsync

    def recorded(descriptor: int) -> None:
        fsync(descriptor)
        status = os.fstat(descriptor)
        synchronized.append((status.st_ino, status.st_size, store.load()))

    monkeypatch.setattr(os, "fsync", recorded)
    store.save({"D512": 2})
    file, folder = store.path.stat(), store.path.parent.stat()
    assert synchronized == [(file.st_ino, file.st_size, {"D512": 1}), (folder.st_ino, folder.st_size, {"D512": 2})]


# ---- killed while saving --------------------------------------------------------------------------------------

SAVER = """
import sys
from pathlib import Path
from controller.core.retentive_store import FileStore

store = FileStore(Path(sys.argv[1]))
for n in range(1, 1_000_000):
    store.save({f"D{512 + k}": n for k in range(int(sys.argv[2]))})
    print(n, flush=True)
    store.confirm()
"""
KILLED_AT_EVERY_LINE = """
import json, os, signal, sys
from pathlib import Path
from controller.core.retentive_store import FileStore

store, every = FileStore(Path(sys.argv[1])), int(sys.argv[2])

def killed_at(line):
    def trace(frame, event, argument):
        nonlocal line
        line -= event == "line"
        if line < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return trace

    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] != 0
    sys.settrace(trace)
    store.save({"D512": 2, "D513": 2})
    store.confirm()
    sys.settrace(None)
    os._exit(0)

killed, line = True, 0
while killed:
    store = FileStore(store.path)
    store.save({"D512": 1, "D513": 1})
    killed, line = killed_at(line), line + every
    print(json.dumps([killed, FileStore(store.path).load()]))
"""


def run_python(text: str, *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", text, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)


@pytest.mark.parametrize("kill", one_in(5, range(25)))
def test_a_file_of_a_process_killed_at_any_moment_contains_one_complete_state(store: FileStore, kill: int) -> None:
    """A process that saves continuously and is killed at a random time leaves the last saved state or the next one."""
    dice = random.Random(kill)
    devices = dice.choice([2, 2_000])
    process = run_python(SAVER, store.path, devices)
    assert process.stdout is not None
    with process:
        printed = [int(process.stdout.readline()) for _ in range(dice.randint(1, 20))]
        process.kill()
        printed += [int(line) for line in process.stdout]
    assert process.returncode == -signal.SIGKILL
    values = FileStore(store.path).load()
    assert values is not None
    (n,) = set(values.values())
    assert len(values) == devices
    assert printed[-1] <= n <= printed[-1] + 1


@pytest.mark.parametrize("every", first_of([10, 1]))
def test_a_kill_before_any_line_of_saving_leaves_the_old_or_the_new_state(store: FileStore, every: int) -> None:
    """The file is complete if the process is killed before any line of Python that saving executes, in any module.

    It is killed before one line in ten by default, before each line every night.
    """
    with run_python(KILLED_AT_EVERY_LINE, store.path, every) as process:
        assert process.stdout is not None
        results = [json.loads(line) for line in process.stdout]
    assert process.returncode == 0
    assert [killed for killed, _ in results] == [True] * (len(results) - 1) + [False]
    states = [values for _, values in results]
    old, new = {"D512": 1, "D513": 1}, {"D512": 2, "D513": 2}
    turn = states.index(new)
    assert turn > 10 // every
    assert states == [old] * turn + [new] * (len(states) - turn)
