"""Signals and options of the live run, tested without starting processes."""

from __future__ import annotations

import argparse
import signal
from contextlib import AbstractContextManager
from itertools import pairwise
from pathlib import Path

import pytest

from controller.common.stop_request import SIGNALS, StopRequest
from plant_sim.cli.options.run import add_arguments
from plant_sim.twin import live
from plant_sim.twin.live import LiveOptions
from plant_sim.twin.process import Interrupts
from plant_sim.twin.progress import ProgressView


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_swallowed_by_a_destructor_is_not_lost() -> None:
    """An interrupt that arrives in a destructor, where exceptions are swallowed, is raised at the next check."""

    class Signalled:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with Interrupts() as interrupts:
        interrupts.check()
        thing = Signalled()
        del thing
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()


def test_signal_handlers_are_restored() -> None:
    """After the run, the previous signal handlers are installed again."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    with Interrupts(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
    assert [signal.getsignal(number) for number in numbers] == before


def test_further_signals_do_not_interrupt_the_stopping_of_the_processes() -> None:
    with Interrupts() as interrupts:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()


def test_a_repeated_signal_after_the_run_does_not_interrupt_its_end() -> None:
    """The command counts a signal that comes soon after one of the run as its repetition."""
    before = [signal.getsignal(number) for number in SIGNALS]
    try:
        with StopRequest() as stop:
            stop.listen()
            stop.interrupt()
            with Interrupts(), pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                pytest.fail("the repeated signal interrupted the end of the command")
    finally:
        for number, handler in zip(SIGNALS, before, strict=True):
            signal.signal(number, handler)


@pytest.mark.parametrize(
    ("given", "controller", "panel"),
    [((), "en", []), (("--language", "zh"), "zh", ["zh"]), (("--language", "en"), "en", ["en"])],
)
def test_the_language_is_passed_on_to_the_controller_and_if_given_to_the_panel(
    tmp_path: Path, given: tuple[str, ...], controller: str, panel: list[str]
) -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = parser.parse_args(given)
    run = LiveOptions(1, 1, "127.0.0.1", 5020, options.io_map, options.machine, options.language)
    assert language(live._control(run, tmp_path)) == [controller]
    assert language(live._panel(run, tmp_path, 8080, 5021)) == panel


def language(command: list[str]) -> list[str]:
    return [value for name, value in pairwise(command) if name == "--language"]


def test_the_controller_is_given_the_port_that_the_plant_has_opened(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Port 0 lets the plant choose; it is also given the planting frequency."""
    commands: dict[str, str] = {}

    class Started(AbstractContextManager["Started"]):
        def __init__(self, name: str, command: list[str], **_: object) -> None:
            commands[name] = " ".join(command)

        def __exit__(self, *_: object) -> None: ...

        def next_line(self, _: float) -> str:
            return "plant listening on 127.0.0.1:4711"

    opened: list[tuple[str, int]] = []

    class Connected(AbstractContextManager["Connected"]):
        def __init__(self, host: str, port: int) -> None:
            opened.append((host, port))

        def __exit__(self, *_: object) -> None: ...

        def telemetry(self) -> dict[str, float]:
            return {}

    monkeypatch.setattr(live, "Process", Started)
    monkeypatch.setattr(live, "Operator", Connected)
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    paths = parser.parse_args([])
    frequency = 60.0
    options = LiveOptions(
        1,
        1,
        "127.0.0.1",
        0,
        paths.io_map,
        paths.machine,
        planting_frequency_per_min=frequency,
        panel_port=None,
        folder=tmp_path / "trials",
    )
    with live.live_trial(options, ProgressView()):
        pass
    assert "--port 0 " in commands["plant"]
    assert "--planting-frequency 60.0" in commands["plant"]
    assert "--port 4711 " in commands["controller"]
    assert opened == [("127.0.0.1", 4711)]
