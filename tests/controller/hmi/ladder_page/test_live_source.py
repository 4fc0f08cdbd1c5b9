"""Live page of a program: what it shows beside the devices, frozen scans, changes from outside, a lost connection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import httpx
import pytest
from pymodbus.client import ModbusTcpClient

from controller.fx.language.cpu_model import FX3U
from controller.fx.language.il import read_il
from controller.fx.observation.observed_plc import ObservedPlc
from controller.hmi.ladder_page import live_source
from controller.hmi.ladder_page.application import MOST_NAMED
from controller.hmi.modbus.fx3u_map import coil_address, discrete_address
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.ladder_page.evaluation import end_states
from tests.controller.hmi.ladder_page.page_rig import LadderRig

TEXT = """\
LD X0
OUT M0
LD M0
ANI X1
OUT Y0
LDP X2
SET M1
LD X3
RST M1
LD M1
OUT T0 K50
LD T0
OUT Y1
LD X1
OUT Y0
LD X2
CJ P1
LD X0
OUT Y2
P1
LD M8002
SET S20
STL S20
LD X0
OUT Y3
STL S21
LD X1
OUT Y4
RET
END
"""
SCANS: Sequence[Sequence[int]] = [(0,), (0, 2), (0, 1), (1, 2), (), (3,), (0, 3)]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[LadderRig]:
    monkeypatch.setattr(live_source, "PERIOD_MS", 0)
    with LadderRig(TEXT) as rig:
        yield rig


def foreign(rig: LadderRig) -> dict[str, bool]:
    """Return the devices as another Modbus client reads them."""
    with ModbusTcpClient("127.0.0.1", port=rig.port, timeout=PATIENT_S) as client:
        bits = {f"X{n}": on for n, on in enumerate(client.read_discrete_inputs(discrete_address("X", 0), count=8).bits)}
        for kind, first in (("Y", 0), ("M", 0), ("S", 16), ("T", 0)):
            read = client.read_coils(coil_address(kind, first), count=8).bits
            bits |= {f"{kind}{first + n}": on for n, on in enumerate(read)}
        pulse = client.read_coils(coil_address("M", 8000), count=8).bits
        return bits | {f"M{8000 + n}": on for n, on in enumerate(pulse)}


def test_end_values_are_those_that_another_client_reads(rig: LadderRig) -> None:
    for inputs in SCANS:
        rig.scan(inputs)
        expected = end_states(rig.ladder, foreign(rig).__getitem__)
        shown = rig.web.look("end")["symbols"]
        assert {at: shown[str(at)] for at in expected} == expected
        assert len(expected) >= 20


def test_the_scan_as_executed_is_that_of_the_program(rig: LadderRig) -> None:
    """The truth is recorded by another execution of the program from its start."""
    truth = ObservedPlc(rig.ladder, input_filter_ms=0)
    for n in range(3):
        truth.scan(10 * (n + 1), [])
    states: set[str] = set()
    for inputs in SCANS:
        rig.scan(inputs)
        truth.scan(rig.now_ms, [number in inputs for number in range(16)])
        look = rig.web.look("executed")
        seen = truth.observation
        end = str(len(rig.ladder.instructions) - 1)  # has no record, and is drawn as executed
        expected = {at: seen.state(int(at), rig.ladder.instructions[int(at)]).value for at in look["symbols"]}
        assert look["symbols"] == expected | {end: "on"}
        assert (look["scan"], look["at_ms"], look["differing"]) == (truth.scans, rig.now_ms, [])
        states.update(expected.values())
    assert states >= {"on", "off", "not-executed"}


def test_extension_registers_of_an_fx3u(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_source, "PERIOD_MS", 0)
    with LadderRig(read_il("LD X0\nINC R40\nLD> R40 R9000\nOUT Y0\nEND\n", cpu=FX3U)) as rig:
        for _ in range(4):
            rig.scan((0,))
        for view in ("end", "executed"):
            assert rig.web.look(view)["symbols"]["3"] == "on"
        assert rig.web.look("executed")["differing"] == []


def test_a_frozen_scan_stays_in_both_views_while_scans_go_on(rig: LadderRig) -> None:
    rig.scan((0, 2))
    kept = rig.web.look("end", keep=1)
    executed = rig.web.look("executed", scan=kept["scan"])
    rig.scan((), (1,))
    assert rig.web.look("end", scan=kept["scan"]) == kept
    assert rig.web.look("executed", scan=kept["scan"]) == executed
    assert rig.web.look("end")["scan"] == kept["scan"] + 2
    assert (executed["symbols"]["5"], kept["symbols"]["5"]) == ("on", "unknown"), "the pulse contact LDP X2"


def test_a_scan_is_not_shown_as_executed_if_another_wrote_a_device_in_it(rig: LadderRig) -> None:
    rig.scan(())
    rig.live.writes.submit(lambda: rig.live.plc.memory.M.__setitem__(1, True))
    rig.scan(())
    look = rig.web.look("executed")
    assert (look["differing"], look["known"], look["symbols"], look["wires"]) == (["M1"], False, {}, {})
    assert len(look["differing"]) <= MOST_NAMED
    assert rig.web.look("end")["symbols"]["9"] == "on", "LD M1"


def test_scans_that_are_no_longer_kept_are_told(rig: LadderRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_source, "KEPT_SCANS", 2)
    kept = []
    for _ in range(3):
        rig.scan(())
        kept.append(rig.web.look("end", keep=1)["scan"])
    answer = rig.web.get("/api/look", view="end", first=0, count=1, scan=kept[0])
    assert (answer.status_code, answer.json()["state"]) == (410, "gone")
    assert rig.web.look("end", scan=kept[1])["scan"] == kept[1]


def test_values_of_timers_and_active_devices_are_those_of_the_scan(rig: LadderRig) -> None:
    rig.scan((0, 2), *[(0,)] * 11)
    look = rig.web.look("end")
    assert look["values"] == {"T0": str(rig.live.plc.memory.TV[0])} == {"T0": "1"}
    assert look["active"] == ["Y2", "Y3", "S20"]


def test_a_controller_that_does_not_answer_is_told() -> None:
    with LadderRig(TEXT) as rig:
        rig.web.look("end")
        rig._server.__exit__(None, None, None)
        answer = rig.web.get("/api/look", view="executed", first=0, count=1)
        assert (answer.status_code, answer.json()["state"]) == (503, "lost")
        rig._server = type(rig._server)([rig.endpoint], rig.live.writes)
        rig._server.__enter__()


def test_the_page_has_no_request_that_writes(rig: LadderRig) -> None:
    paths = ("/", "/api/look", "/api/describe", "/api/why", "/api/command", "/api/machine", "/panel/app.js")
    for path in paths:
        for method in ("POST", "PUT", "DELETE", "PATCH"):
            answer = rig.web.client.request(method, path, headers={"origin": rig.web.origin})
            assert answer.status_code in {404, 405}, (method, path)


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("/api/look", {"view": "other", "first": 0, "count": 1}),
        ("/api/look", {"view": "end", "first": -1, "count": 1}),
        ("/api/look", {"view": "end", "first": 0, "count": 101}),
        ("/api/look", {"view": "end", "first": 0, "count": 1, "scan": "x"}),
        ("/api/rungs", {"first": 0, "count": 1, "columns": 1}),
        ("/api/describe", {"columns": 10}),
        ("/api/device", {"name": "left lift"}),
        ("/api/why", {"device": "Q1"}),
    ],
)
def test_malformed_requests_are_refused(rig: LadderRig, path: str, values: dict[str, object]) -> None:
    answer = rig.web.get(path, **values)
    assert (answer.status_code, answer.json()["state"]) == (400, "malformed")


def test_the_page_has_the_shared_scripts_and_fonts_besides_its_own_files(rig: LadderRig) -> None:
    for name in ("main.js", "texts.js", "dom.js", "fonts.css", "foreign/noto-sans-sc-400.woff2"):
        assert rig.web.get(f"/static/{name}").status_code == 200, name
    assert rig.web.get("/static/login.js").status_code == 404, "a file of the panel"


def test_another_site_is_refused(rig: LadderRig) -> None:
    answer = httpx.get(f"{rig.web.origin}/api/describe?columns=4", headers={"host": "example.com"})
    assert answer.status_code == 403
