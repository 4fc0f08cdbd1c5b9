"""Orders from a browser: access levels, reasons for refusal, effect on the controller."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from controller.hmi.modbus.connection import ANSWER_LIMIT_S
from controller.hmi.panel.orders import operator
from controller.hmi.panel.orders.messages import MessageError, read_order
from controller.hmi.panel.orders.replies import REPLIES
from controller.hmi.panel.web import sockets
from controller.io.forcing import LEASE_MS
from controller.io.pace import Pace
from controller.io.scan_writes import NO_SCAN_LIMIT_S, ScanWrite
from controller.program.states import Mode, State
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.controller.hmi.panel.panel_rig import Browser, PanelRig
from tests.plant_sim.twin.twin_rig import switched_on
from tests.sampling import examples

ORDERS: list[dict[str, Any]] = [
    {"type": "command", "command": "abort"},
    {"type": "command", "command": "start"},
    {"type": "set", "name": "settle", "value": 30},
    {"type": "acknowledge", "alarm": None},
    {"type": "acknowledge"},
    {"type": "shelve", "alarm": 992, "minutes": 5},
    {"type": "unshelve", "alarm": 992},
    {"type": "pace", "percent": 50},
    {"type": "box", "button": "start", "pressed": True},
]
MAINTAIN_ORDERS: list[dict[str, Any]] = [
    {"type": "jog", "output": "left.lift_extend", "hold": True},
    {"type": "force", "point": "X5", "level": 1},
]


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[PanelRig]:
    with PanelRig(tmp_path) as rig:
        yield rig


def english(reply: dict[str, Any]) -> str:
    assert reply["ok"] is False
    assert reply["text"]["zh"]
    return str(reply["text"]["en"])


def test_view_level_permits_no_other_orders(rig: PanelRig) -> None:
    before = list(rig.hmi.audits)
    with rig.browser() as browser:
        assert browser.view["me"] == {"level": "view"}
        for order in ORDERS:
            assert english(browser.order(**order)) == "Operator login required", order
        for order in MAINTAIN_ORDERS:
            assert english(browser.order(**order)) == "Maintenance login required", order
    assert rig.hmi.audits == before
    assert rig.panel.operator.refused == len(ORDERS) + len(MAINTAIN_ORDERS)


@pytest.mark.parametrize("command", ["stop", "hold"])
def test_stop_and_hold_need_no_login_on_the_panel_computer(tmp_path: Path, command: str) -> None:
    twin = switched_on(mode=Mode.MANUAL)
    twin.home()
    twin.start()
    with PanelRig(tmp_path, twin) as rig, rig.browser() as browser:
        assert browser.view["me"] == {"level": "view"}
        assert browser.order(type="command", command=command)["ok"] is True
        browser.until(lambda view: view["machine"]["state"] != State.EXECUTE)
        assert [row[1:] for row in rig.hmi.audits] == [("view", command, "1", "done")]


def test_operate_level_permits_neither_jog_nor_forcing(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        assert browser.view["me"] == {"level": "operate"}
        for order in MAINTAIN_ORDERS:
            assert english(browser.order(**order)) == "Maintenance login required", order
        assert english(browser.order(type="command", command="jog_left_spread")) == "this output can only be jogged"
    assert not rig.hmi.audits


def test_command_is_executed_and_audited_with_the_user(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        reply = browser.order(type="command", command="mode_manual")
        assert reply["ok"] is True
        assert reply["text"]["en"] == "done"
        browser.until(lambda view: view["machine"]["mode"] == Mode.MANUAL)
    assert [row[1:] for row in rig.hmi.audits] == [("operate", "mode_manual", "1", "done")]


def test_refused_command_gives_the_reason_in_both_languages(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        why = browser.view["commands"]["start"]["why"]
        assert browser.view["commands"]["start"]["free"] is False
        reply = browser.order(type="command", command="start")
        reason = "cannot start: the machine is not in Idle or Suspended"
        assert why["en"] == reason
        assert english(reply) == f"{reason}; next: press X0 to reset and home"
        assert reply["text"]["zh"].startswith(why["zh"])
        view = browser.until(lambda view: view["machine"]["refusals"] == 1)
        assert view["machine"]["refusal"] == reply["text"]
        assert view["machine"]["next"]["en"] == "press X0 to reset and home"


def test_every_command_is_available_or_refused_as_shown(rig: PanelRig) -> None:
    names = [command.name for command in rig.twin.machine.tags.commands if not command.name.startswith("jog")]
    with rig.browser("operate") as browser:
        for name in names:
            if name in ("reset", "abort") or name.startswith("mode_"):
                continue  # these change the state in which the other commands are checked
            shown = browser.view["commands"][name]
            reply = browser.order(type="command", command=name)
            assert reply["ok"] is shown["free"], (name, reply, shown)
            reason_first = (reply["text"][language].startswith(shown["why"][language]) for language in ("en", "zh"))
            assert shown["free"] or all(reason_first)


def test_an_order_that_arrives_late_is_not_executed(rig: PanelRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its user may have left after *no reply*; an order that halts is executed however late it arrives."""
    monkeypatch.setattr(sockets, "LATEST_VIEWS", 3)
    mode: dict[str, Any] = {"type": "command", "command": "mode_step"}
    release: dict[str, Any] = {"type": "box", "button": "emergency_stop", "pressed": False}
    too_late = REPLIES["too late"].en
    with rig.browser("operate") as browser:
        for _ in range(6):
            browser.read()
        assert [english(browser.order(**order, seen=0)) for order in (mode, release)] == [too_late, too_late]
        assert browser.order(**mode, seen=browser.view_number)["ok"] is True
        halts: list[dict[str, Any]] = [
            *({"type": "command", "command": name} for name in ("stop", "hold", "abort")),
            release | {"pressed": True},
        ]
        assert too_late not in [browser.order(**order, seen=0)["text"]["en"] for order in halts]
    assert rig.twin.plc.read(rig.twin.machine.tags.machine.mode) == Mode.STEP


def test_an_order_that_halts_waits_for_no_other(rig: PanelRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither for a place among the pending orders, nor for the outcome of an order before it."""
    monkeypatch.setattr(sockets, "MAX_PENDING", 1)
    monkeypatch.setattr(operator, "OUTCOME_SCANS", 1 << 30)
    monkeypatch.setattr(operator, "OUTCOME_MS", 3_000)
    with rig.browser("operate") as browser:
        waiting = browser.send(type="command", command="mode_step")
        busy = browser.send(type="command", command="mode_manual")
        browser.send(type="command", command="abort")
        assert browser.reply(busy)["text"]["en"] == REPLIES["busy"].en
        browser.until(lambda view: view["machine"]["state"] == State.ABORTED)
        assert not browser.is_answered(waiting)


def test_set_points(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        assert browser.order(type="set", name="settle", value=33)["ok"] is True
        browser.until(lambda view: view["set_points"]["settle"] == 33)
        assert english(browser.order(type="set", name="settle", value=4)) == "enter 5 to 200"
        assert english(browser.order(type="set", name="settle", value=201)) == "enter 5 to 200"
        for name in ("arms_may_meet", "clamp"):
            assert english(browser.order(type="set", name=name, value=1)).endswith("when the controller starts")
        assert english(browser.order(type="set", name="names", value=1)) == "unknown set-point 'names'"
        assert english(browser.order(type="set", name="settle", value="20")) == "invalid request: set.value"
        assert english(browser.order(type="set", name="settle", value=True)) == "invalid request: set.value"
    assert rig.twin.plc.read(rig.twin.machine.tags.sp.settle) == 33


def test_alarms_are_acknowledged_shelved_and_unshelved(tmp_path: Path) -> None:
    twin = Twin()
    twin.press("emergency_stop", for_ms=10**7)
    with PanelRig(tmp_path, twin) as rig, rig.browser("operate") as browser:
        view = browser.until(lambda view: bool(view["alarms"]["rows"]))
        row = view["alarms"]["rows"][0]
        assert (row["number"], row["state"], row["shelved_until_ms"]) == (900, 1, None)
        assert browser.order(type="acknowledge", alarm=900)["ok"] is True
        browser.until(lambda view: view["alarms"]["rows"][0]["state"] == 2)
        assert "safety alarm" in english(browser.order(type="shelve", alarm=900, minutes=5))
        assert "stops the machine" in english(browser.order(type="shelve", alarm=906, minutes=5))
        assert english(browser.order(type="acknowledge", alarm=7)).startswith("unknown alarm S7")
        for minutes in (0, 481, -1, 10**9):
            assert not browser.order(type="shelve", alarm=992, minutes=minutes)["ok"]
        assert browser.order(type="shelve", alarm=992, minutes=480)["ok"] is True
        view = browser.until(lambda view: len(view["alarms"]["rows"]) == 2)
        assert view["alarms"]["rows"][1]["state"] == 6
        assert view["alarms"]["rows"][1]["shelved_until_ms"] >= 480 * 60_000
        assert browser.order(type="unshelve", alarm=992)["ok"] is True
        browser.until(lambda view: len(view["alarms"]["rows"]) == 1)


def test_in_real_time_neither_pace_nor_operator_box_is_available(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        assert english(browser.order(type="pace", percent=50)).startswith("not a simulation")
        assert english(browser.order(type="box", button="start", pressed=True)).startswith("no simulated operator box")


def test_simulated_time_is_paused_and_sped_up(tmp_path: Path) -> None:
    pace = Pace()
    with PanelRig(tmp_path, pace=pace) as rig, rig.browser("operate") as browser:
        assert browser.order(type="pace", percent=0)["ok"] is True
        browser.until(lambda view: bool(view["link"]["paused"]) and view["link"]["pace_percent"] == 0)
        assert pace.percent == 0
        assert browser.order(type="pace", percent=65_535)["ok"] is True
        assert not browser.order(type="pace", percent=5_001)["ok"]
        assert browser.order(type="pace", percent=100)["ok"] is True
        assert pace.percent == 100


def test_without_a_scan_an_order_is_not_executed(rig: PanelRig, monkeypatch: pytest.MonkeyPatch) -> None:
    with rig.browser("operate") as browser, monkeypatch.context() as patch:
        patch.setattr(ScanWrite, "limit_s", NO_SCAN_LIMIT_S)
        for order in ({"type": "command", "command": "mode_manual"}, {"type": "set", "name": "settle", "value": 33}):
            with rig.without_scans():
                assert english(browser.order(**order)).startswith("not executed: the controller does not scan")
        rig.for_scans(5)
    machine = rig.twin.machine.tags
    assert rig.twin.plc.read(machine.machine.mode) == Mode.CONTINUOUS
    assert rig.twin.plc.read(machine.sp.settle) != 33


def test_the_panel_waits_longer_than_a_busy_controller_that_withdraws_a_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It shows that the order was not executed, not that there is no response; all waits are five times as long."""
    longer = 5
    with (
        PanelRig(tmp_path, answer_s=longer * ANSWER_LIMIT_S) as rig,
        rig.browser("operate") as browser,
        monkeypatch.context() as patch,
    ):
        patch.setattr(ScanWrite, "limit_s", longer * (NO_SCAN_LIMIT_S + 0.1))  # answered late
        with rig.without_scans():
            reply = browser.order(type="command", command="mode_manual")
        assert english(reply).startswith("not executed: the controller does not scan")


def test_inputs_are_forced_only_where_and_when_allowed(tmp_path: Path) -> None:
    order = {"type": "force", "point": "X22", "level": 1}
    with PanelRig(tmp_path) as rig, rig.browser("maintain") as browser:
        assert "does not allow forcing" in english(browser.order(**order))
        assert english(browser.order(type="force", point="X77", level=1)) == "unknown input 'X77'"
        assert english(browser.order(type="force", point="Y0", level=1)) == "unknown input 'Y0'"
    with PanelRig(tmp_path / "other", allow_forcing=True) as rig, rig.browser("maintain") as browser:
        assert "Stopped, in manual mode" in english(browser.order(**order))


def test_forcing_ends_with_the_browser(tmp_path: Path) -> None:
    twin = switched_on(mode=Mode.MANUAL)
    with PanelRig(tmp_path, twin, allow_forcing=True) as rig:
        forcing = twin.runtime.forcing
        with rig.browser("maintain") as browser:
            browser.until(lambda view: view["machine"]["state"] == State.STOPPED)
            assert browser.order(type="force", point="X22", level=1)["ok"] is True
            browser.until(lambda view: view["forced"] == ["X22"] and view["io"]["X22"] == 1)
            rig.for_scans(LEASE_MS // SCAN_MS + 20)  # longer than the lease of the controller: the panel renews it
            assert forcing.levels == {0o22: True}
            assert browser.order(type="force", point="X5", level=0)["ok"] is True
            assert browser.order(type="force", point="X22", level=2)["ok"] is True
            browser.until(lambda view: view["forced"] == ["X5"])
        rig.until(lambda: forcing.levels == {}, scans=50)


def test_orders_report_a_controller_that_does_not_respond(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        rig.stop_server()
        for order in ORDERS[:6]:
            assert english(browser.order(**order)) == "the controller does not respond; check that it is running", order


def test_malformed_messages_are_refused(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        for text, id_ in (
            ("", None),
            ("{", None),
            ("[]", None),
            ("1", None),
            ("[" * 2_000, None),
            ('{"type":"set"}', None),
            ('{"id":5,"type":"command"}', 5),
            ('{"id":"a","type":"none"}', "a"),
            ('{"id":6,"type":"jog"}', 6),
            ('{"id":true,"type":"command","command":"stop"}', None),
            ('{"id":7,"type":"command","command":"stop","more":1}', 7),
        ):
            browser.socket.send(text)
            assert english(browser.reply(id_)).startswith("invalid request"), text
        assert english(browser.order(type="command", command="__init__")) == "unknown command '__init__'"
    assert not rig.hmi.audits


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
KEYS = [
    "type",
    "id",
    "command",
    "name",
    "value",
    "alarm",
    "minutes",
    "output",
    "hold",
    "button",
    "pressed",
    "percent",
    "point",
    "level",
]
TYPES = ["command", "set", "acknowledge", "shelve", "unshelve", "jog", "box", "pace", "force"]


@given(st.text() | st.binary().map(lambda data: data.decode("latin-1")))
def test_any_text_is_an_order_or_refused(text: str) -> None:
    with pytest.raises(MessageError):
        read_order(text)


@examples(20, nightly=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    message=st.dictionaries(st.sampled_from(KEYS), JSON, max_size=8),
    type_=st.sampled_from(TYPES),
    id_=st.integers(0, 1_000),
)
def test_every_message_gets_a_reply(served: Browser, message: dict[str, Any], type_: str, id_: int) -> None:
    served.socket.send(json.dumps(message | {"type": type_, "id": id_}))
    reply = served.reply(id_)
    assert set(reply) == {"type", "id", "ok", "text", "why"}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with PanelRig(tmp_path_factory.mktemp("panel")) as rig, rig.browser() as browser:
        yield browser
