"""Monitors, triggers and periodic actions of a twin."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from controller.core.expr import Bit, Expr, Word
from plant_sim.twin.conditions import CELLS, check_advances


@dataclass(eq=False)
class Trigger:
    """Action to be executed after each scan in which a condition has become true.

    Attributes:
        condition: Condition over the devices of the program and the state of the plant.
        action: The action.
        holds: Latest value of the condition.
        cells: Values stored by an `Advances` condition.
    """

    condition: Expr
    action: Callable[[], None]
    holds: bool = False
    cells: np.ndarray = field(default_factory=lambda: np.zeros(CELLS))

    def __post_init__(self) -> None:
        """Check the condition.

        Raises:
            ValueError: It contains `Advances` more than once.
        """
        check_advances(self.condition, allowed=1)

    def save(self) -> Any:
        """Return the current state."""
        return self.holds, self.cells.copy()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        self.holds, self.cells[:] = saved


class Watched(ABC):
    """Base class of a twin: functions that are called after its scans."""

    def __init__(self) -> None:
        self._monitors: list[tuple[Callable[[Any], None], tuple[Bit | Word, ...] | None]] = []
        self._triggers: list[Trigger] = []
        self._periodic: list[tuple[int, Callable[[Any], None]]] = []

    def watch(self, monitor: Callable[[Self], None], devices: Iterable[Bit | Word] | None = None) -> None:
        """Register a monitor that is called after scans.

        Args:
            monitor: Function to call.
            devices: Devices of the program on which it depends. It is called at least after every scan in which one of
                them has changed, and after every scan that follows a move of a seedling or an incident. None = it is
                called after every scan, so that the twin cannot run in machine code.
        """
        self._monitors.append((monitor, None if devices is None else tuple(devices)))
        self._on_watchers_changed()

    def when(self, condition: Expr, action: Callable[[], None]) -> None:
        """Register an action to be executed after every scan in which a condition has become true.

        Args:
            condition: Condition over the devices of the program and the state of the plant.
            action: The action.

        Raises:
            ValueError: The condition contains `Advances` more than once.
        """
        self._triggers.append(Trigger(condition, action))
        self._on_watchers_changed()

    def every(self, period_ms: int, action: Callable[[Self], None]) -> None:
        """Register an action to be executed after the scans at multiples of a period.

        Args:
            period_ms: Period, ms, a multiple of the scan period.
            action: The action.
        """
        self._periodic.append((period_ms, action))

    def unwatch(self) -> None:
        """Remove all monitors, triggers and periodic actions."""
        self._monitors.clear()
        self._triggers.clear()
        self._periodic.clear()
        self._on_watchers_changed()

    @property
    def _has_watchers(self) -> bool:
        return bool(self._monitors or self._triggers)

    @property
    def _watches_every_scan(self) -> bool:
        return any(devices is None for _, devices in self._monitors)

    @property
    def _watched_devices(self) -> list[Bit | Word]:
        return [device for _, devices in self._monitors for device in devices or ()]

    def _next_action_ms(self, now_ms: int) -> list[int]:
        """Return the time of the next call of every periodic action, ms."""
        return [now_ms + -now_ms % period_ms for period_ms, _ in self._periodic]

    def _begun(self, values: Iterable[bool]) -> list[Trigger]:
        """Store the values of the conditions of all triggers; return those whose conditions have become true."""
        begun = []
        for trigger, holds in zip(self._triggers, values, strict=True):
            if holds and not trigger.holds:
                begun.append(trigger)
            trigger.holds = holds
        return begun

    def _call_watchers(self, now_ms: int, begun: Iterable[Trigger]) -> None:
        for trigger in begun:
            trigger.action()
        for monitor, _ in self._monitors:
            monitor(self)
        for period_ms, act in self._periodic:
            if now_ms % period_ms == 0:
                act(self)

    def _save_watchers(self) -> Any:
        return [*self._monitors], [*self._periodic], [(trigger, trigger.save()) for trigger in self._triggers]

    def _restore_watchers(self, saved: Any) -> bool:
        """Restore the registered functions; return True if others were registered."""
        before = self._monitors, self._triggers
        monitors, periodic, triggers = saved
        self._monitors, self._periodic = [*monitors], [*periodic]
        self._triggers = [trigger for trigger, _ in triggers]
        for trigger, state in triggers:
            trigger.restore(state)
        return before != (self._monitors, self._triggers)

    @abstractmethod
    def _on_watchers_changed(self) -> None:
        """Adapt to other monitors and triggers."""
