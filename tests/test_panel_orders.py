"""What a browser may order: levels, reasons of refusal, what the controller makes of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from panel_rig import Browser, PanelRig
from twin_rig import switched_on

from controller.hmi.panel.messages import MessageError, read_order
from controller.io.pace import Pace
from controller.program.states import Mode, State
from plant_sim.bench.twin import Twin

ORDERS: list[dict[str, Any]] = [
    {"type": "command", "command": "stop"},
    {"type": "set", "name": "clamp", "value": 30},
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


def test_who_only_views_may_order_nothing(rig: PanelRig) -> None:
    before = list(rig.hmi.audits)
    with rig.browser() as browser:
        assert browser.view["me"] == {"level": "view"}
        for order in ORDERS:
            assert english(browser.order(**order)) == "log in as operate for this", order
        for order in MAINTAIN_ORDERS:
            assert english(browser.order(**order)) == "log in as maintain for this", order
    assert rig.hmi.audits == before
    assert rig.panel.operator.refused == len(ORDERS) + len(MAINTAIN_ORDERS)


def test_who_operates_may_neither_jog_nor_force(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        assert browser.view["me"] == {"level": "operate"}
        for order in MAINTAIN_ORDERS:
            assert english(browser.order(**order)) == "log in as maintain for this", order
        assert english(browser.order(type="command", command="jog_left_spread")).startswith("this output is held")
    assert not rig.hmi.audits


def test_a_command_is_signed_and_carried_out(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        reply = browser.order(type="command", command="mode_manual")
        assert reply["ok"] is True
        assert reply["text"]["en"] == "done"
        browser.until(lambda view: view["machine"]["mode"] == Mode.MANUAL)
    assert [row[1:] for row in rig.hmi.audits] == [("operate", "mode_manual", "1", "done")]


def test_a_refused_command_tells_why_in_both_languages(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        why = browser.view["commands"]["start"]["why"]
        assert browser.view["commands"]["start"]["free"] is False
        reply = browser.order(type="command", command="start")
        assert english(reply) == "cannot start: the machine is not in Idle or Suspended"
        assert reply["text"] == why
        view = browser.until(lambda view: view["machine"]["refusals"] == 1)
        assert view["machine"]["refusal"] == why


def test_every_command_is_free_or_refused_as_shown(rig: PanelRig) -> None:
    names = [command.name for command in rig.twin.machine.tags.commands if not command.name.startswith("jog")]
    with rig.browser("operate") as browser:
        for name in names:
            if name in ("reset", "abort") or name.startswith("mode_"):
                continue  # they change what the others meet
            shown = browser.view["commands"][name]
            reply = browser.order(type="command", command=name)
            assert reply["ok"] is shown["free"], (name, reply, shown)
            assert shown["free"] or reply["text"] == shown["why"]


def test_set_points(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        assert browser.order(type="set", name="clamp", value=33)["ok"] is True
        browser.until(lambda view: view["set_points"]["clamp"] == 33)
        assert english(browser.order(type="set", name="clamp", value=9)) == "give 10 to 200"
        assert english(browser.order(type="set", name="clamp", value=201)) == "give 10 to 200"
        assert "--set" in english(browser.order(type="set", name="arms_may_meet", value=1))
        assert english(browser.order(type="set", name="names", value=1)) == "there is no set-point 'names'"
        assert english(browser.order(type="set", name="clamp", value="20")) == "not understood: set.value"
        assert english(browser.order(type="set", name="clamp", value=True)) == "not understood: set.value"
    assert rig.twin.plc.read(rig.twin.machine.tags.sp.clamp) == 33


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
        assert "stops work" in english(browser.order(type="shelve", alarm=906, minutes=5))
        assert english(browser.order(type="acknowledge", alarm=7)).startswith("there is no alarm S7")
        for minutes in (0, 481, -1, 10**9):
            assert not browser.order(type="shelve", alarm=992, minutes=minutes)["ok"]
        assert browser.order(type="shelve", alarm=992, minutes=480)["ok"] is True
        view = browser.until(lambda view: len(view["alarms"]["rows"]) == 2)
        assert view["alarms"]["rows"][1]["state"] == 6
        assert view["alarms"]["rows"][1]["shelved_until_ms"] >= 480 * 60_000
        assert browser.order(type="unshelve", alarm=992)["ok"] is True
        browser.until(lambda view: len(view["alarms"]["rows"]) == 1)


def test_real_time_has_no_pace_and_no_box(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        assert english(browser.order(type="pace", percent=50)).startswith("time is real here")
        assert english(browser.order(type="box", button="start", pressed=True)).startswith("there is no operator box")


def test_simulated_time_is_paused_and_speeded(tmp_path: Path) -> None:
    pace = Pace()
    with PanelRig(tmp_path, pace=pace) as rig, rig.browser("operate") as browser:
        assert browser.order(type="pace", percent=0)["ok"] is True
        browser.until(lambda view: bool(view["link"]["paused"]) and view["link"]["pace_percent"] == 0)
        assert pace.percent == 0
        assert browser.order(type="pace", percent=65_535)["ok"] is True
        assert not browser.order(type="pace", percent=5_001)["ok"]
        assert browser.order(type="pace", percent=100)["ok"] is True
        assert pace.percent == 100


def test_inputs_are_forced_only_where_and_when_it_is_allowed(tmp_path: Path) -> None:
    order = {"type": "force", "point": "X22", "level": 1}
    with PanelRig(tmp_path) as rig, rig.browser("maintain") as browser:
        assert "allows no forcing" in english(browser.order(**order))
        assert english(browser.order(type="force", point="X77", level=1)) == "there is no input 'X77'"
        assert english(browser.order(type="force", point="Y0", level=1)) == "there is no input 'Y0'"
    with PanelRig(tmp_path / "other", allow_forcing=True) as rig, rig.browser("maintain") as browser:
        assert "Stopped, mode manual" in english(browser.order(**order))


def test_forced_inputs_last_as_long_as_their_browser(tmp_path: Path) -> None:
    twin = switched_on(mode=Mode.MANUAL)
    with PanelRig(tmp_path, twin, allow_forcing=True) as rig:
        forcing = twin.runtime.forcing
        with rig.browser("maintain") as browser:
            browser.until(lambda view: view["machine"]["state"] == State.STOPPED)
            assert browser.order(type="force", point="X22", level=1)["ok"] is True
            browser.until(lambda view: view["forced"] == ["X22"] and view["io"]["X22"] == 1)
            rig.for_scans(250)  # longer than the controller's lease: the panel renews it
            assert forcing.levels == {0o22: True}
            assert browser.order(type="force", point="X5", level=0)["ok"] is True
            assert browser.order(type="force", point="X22", level=2)["ok"] is True
            browser.until(lambda view: view["forced"] == ["X5"])
        rig.until(lambda: forcing.levels == {}, scans=50)


def test_orders_tell_that_the_controller_is_silent(rig: PanelRig) -> None:
    with rig.browser("operate") as browser:
        rig.silence()
        for order in ORDERS[:6]:
            assert english(browser.order(**order)) == "the controller does not answer; see that it runs", order


def test_messages_that_are_no_orders(rig: PanelRig) -> None:
    with rig.browser("maintain") as browser:
        for text, id_ in (
            ("", None), ("{", None), ("[]", None), ("1", None), ("[" * 2_000, None), ('{"type":"set"}', None),
            ('{"id":5,"type":"command"}', 5), ('{"id":"a","type":"none"}', "a"), ('{"id":6,"type":"jog"}', 6),
            ('{"id":true,"type":"command","command":"stop"}', None),
            ('{"id":7,"type":"command","command":"stop","more":1}', 7),
        ):  # fmt: skip
            browser.socket.send(text)
            assert english(browser.reply(id_)).startswith("not understood"), text
        assert english(browser.order(type="command", command="__init__")) == "there is no command '__init__'"
    assert not rig.hmi.audits


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
KEYS = ["type", "id", "command", "name", "value", "alarm", "minutes", "output", "hold", "button", "pressed", "percent",
        "point", "level"]  # fmt: skip
TYPES = ["command", "set", "acknowledge", "shelve", "unshelve", "jog", "box", "pace", "force"]


@given(st.text() | st.binary().map(lambda data: data.decode("latin-1")))
def test_any_text_is_an_order_or_refused(text: str) -> None:
    with pytest.raises(MessageError):
        read_order(text)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    message=st.dictionaries(st.sampled_from(KEYS), JSON, max_size=8),
    type_=st.sampled_from(TYPES),
    id_=st.integers(0, 1_000),
)
def test_whatever_a_browser_sends_it_is_answered(
    served: Browser, message: dict[str, Any], type_: str, id_: int
) -> None:
    served.socket.send(json.dumps(message | {"type": type_, "id": id_}))
    reply = served.reply(id_)
    assert set(reply) == {"type", "id", "ok", "text"}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with PanelRig(tmp_path_factory.mktemp("panel")) as rig, rig.browser() as browser:
        yield browser
