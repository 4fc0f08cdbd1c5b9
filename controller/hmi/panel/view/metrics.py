"""Prometheus metrics: scan timing, links, refusals and alarms."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from controller.common.supervision.failures import ITEMS, dropped, failures
from controller.hmi.access import status_registers as status
from controller.hmi.panel.modbus import mirror as registers
from controller.hmi.panel.modbus.mirror import Mirror
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.orders.operator import OrderHandler
from controller.io.loop import BOUNDS_US
from controller.program.machine import Transplanter

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

_R_OVERRUNS: Final = 10
_R_LONGEST_MS: Final = 12
_R_REFUSED_WRITES: Final = 14
_R_CONNECTIONS: Final = 16
_PREFIX: Final = "transplanter"


class Metrics(Collector):
    """Collector that reads the mirror on request; controller values are omitted if the controller does not respond."""

    def __init__(
        self,
        machine: Transplanter,
        mirror: Mirror,
        operator: OrderHandler,
        telemetry: Telemetry | None,
        browsers: Callable[[], int],
    ) -> None:
        """Initialise a collector for a mirror and the panel itself."""
        self._machine = machine.tags.machine
        self._mirror = mirror
        self._operator = operator
        self._telemetry = telemetry
        self._browsers = browsers
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)

    def text(self) -> bytes:
        """Return all metrics in the Prometheus text format."""
        return generate_latest(self._registry)

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics."""
        mirror, operator = self._mirror, self._operator
        yield _gauge("controller_up", "1 = the controller responds to the panel", mirror.fresh)
        yield _gauge("poll_age_seconds", "time since the last response of the controller", mirror.age_ms / 1_000)
        if self._telemetry is not None:
            yield _gauge("telemetry_up", "1 = the telemetry source responds", self._telemetry.fresh)
        yield _gauge("panel_clients", "browsers connected", self._browsers())
        orders = CounterMetricFamily(f"{_PREFIX}_panel_orders", "orders of browsers", labels=["result"])
        orders.add_metric(["done"], operator.done)
        orders.add_metric(["refused"], operator.refused)
        yield orders
        failed = CounterMetricFamily(f"{_PREFIX}_panel_failures", "unexpected exceptions of the panel", labels=["part"])
        for part, count in sorted(failures().items()):
            failed.add_metric([part], count)
        yield failed
        yield _dropped("panel_dropped", "panel", {item: dropped(item) for item in ("trends", "log")})
        if mirror.fresh:
            yield from self._controller()

    def _controller(self) -> Iterator[Metric]:
        mirror, machine = self._mirror, self._machine
        memory = mirror.memory
        yield _histogram("scan_duration_seconds", "scan duration", mirror, status.R_DURATIONS, status.R_DURATION_SUM)
        yield _histogram("scan_lateness_seconds", "scan start delay", mirror, status.R_LATENESS, status.R_LATENESS_SUM)
        yield _counter("scans", "completed scans", mirror.long(0))
        yield _counter("overruns", "scans that ended after the next one was due", mirror.long(_R_OVERRUNS))
        yield _gauge("longest_scan_seconds", "longest scan since the start", mirror.word(_R_LONGEST_MS) / 1_000)
        yield _gauge("field_up", "1 = the field I/O responds to the controller", not mirror.word(registers.R_LINK_LOST))
        yield _counter("refused_writes", "refused Modbus writes", mirror.long(_R_REFUSED_WRITES))
        yield _gauge("modbus_connections", "connected Modbus clients", mirror.word(_R_CONNECTIONS))
        yield _counter("failures", "unexpected exceptions of the controller", mirror.long(status.R_FAILURES))
        lost = {item: mirror.long(number) for item, (number, _) in status.DROPPED.items()}
        yield _dropped("dropped", "controller", lost)
        yield _counter("refused_commands", "commands refused by the program", memory.D[machine.refusals.number])
        yield _gauge("state", "PackML state number", memory.D[machine.state.number])
        yield _gauge("mode", "mode number", memory.D[machine.mode.number])
        rows = [mirror.word(status.R_ALARMS + status.ALARM_WORDS * row) for row in range(status.ALARM_ROWS)]
        yield _gauge("alarms_listed", "rows of the operator's alarm list, at most 16", sum(map(bool, rows)))
        yield _gauge("alarms_active", "active annunciators", sum(memory.S[900:]))


def _gauge(name: str, meaning: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"{_PREFIX}_{name}", meaning, value=float(value))


def _counter(name: str, meaning: str, value: float) -> CounterMetricFamily:
    return CounterMetricFamily(f"{_PREFIX}_{name}", meaning, value=float(value))


def _dropped(name: str, process: str, counts: Mapping[str, int]) -> CounterMetricFamily:
    meaning = f"lost items of the {process}: " + "; ".join(f"{item} = {ITEMS[item]}" for item in counts)
    family = CounterMetricFamily(f"{_PREFIX}_{name}", meaning, labels=["item"])
    for item, count in counts.items():
        family.add_metric([item], count)
    return family


def _histogram(name: str, meaning: str, mirror: Mirror, first: int, sum_register: int) -> HistogramMetricFamily:
    """Return a histogram; the counts of the controller are made cumulative, as Prometheus requires."""
    counts = [mirror.long(first + 2 * bucket) for bucket in range(len(BOUNDS_US) + 1)]
    bounds = [str(bound / 1_000_000) for bound in BOUNDS_US] + ["+Inf"]
    cumulative = 0
    buckets: list[tuple[str, float]] = []
    for bound, count in zip(bounds, counts, strict=True):
        cumulative += count
        buckets.append((bound, float(cumulative)))
    total_s = mirror.long(sum_register) / 1_000_000
    return HistogramMetricFamily(f"{_PREFIX}_{name}", meaning, buckets=buckets, sum_value=total_s)
