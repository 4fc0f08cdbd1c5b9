"""What the live run does with signals, apart from its processes."""

from __future__ import annotations

import signal

import pytest

from plant_sim.bench.live import Interrupts


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_swallowed_by_a_destructor_is_not_lost() -> None:
    """Given a signal while a destructor runs, where nothing can be raised, it is raised at the next check."""

    class Signalled:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with Interrupts() as interrupts:
        interrupts.check()
        thing = Signalled()
        del thing
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()


def test_handlers_are_put_back() -> None:
    """After the run the signals do what they did before."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    with Interrupts(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
    assert [signal.getsignal(number) for number in numbers] == before
