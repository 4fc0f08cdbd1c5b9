"""What a Prometheus server reads: timing of the scan, links, refusals, alarms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from controller.hmi import own_registers as own
from controller.hmi.panel import source
from controller.hmi.panel.orders import Operator
from controller.hmi.panel.source import Mirror
from controller.hmi.panel.telemetry import Telemetry
from controller.io.loop import BOUNDS_US
from controller.program.machine import Transplanter

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

_R_OVERRUNS: Final = 10
_R_LONGEST_MS: Final = 12
_R_REFUSED_WRITES: Final = 14
_R_CONNECTIONS: Final = 16
_PREFIX: Final = "transplanter"


class Metrics(Collector):
    """Collects from the mirror when it is asked; values of the controller are left out while it is silent."""

    def __init__(
        self,
        machine: Transplanter,
        mirror: Mirror,
        operator: Operator,
        telemetry: Telemetry | None,
        browsers: Callable[[], int],
    ) -> None:
        """Collect from a mirror and from the panel itself."""
        self._machine = machine.tags.machine
        self._mirror = mirror
        self._operator = operator
        self._telemetry = telemetry
        self._browsers = browsers
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)

    def text(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self._registry)

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics."""
        mirror, operator = self._mirror, self._operator
        yield _gauge("controller_up", "1 = the controller answers the panel", mirror.fresh)
        yield _gauge("poll_age_seconds", "time since the controller's last answer", mirror.age_ms / 1_000)
        if self._telemetry is not None:
            yield _gauge("telemetry_up", "1 = the source of telemetry answers", self._telemetry.fresh)
        yield _gauge("panel_clients", "browsers connected", self._browsers())
        orders = CounterMetricFamily(f"{_PREFIX}_panel_orders", "orders of browsers", labels=["result"])
        orders.add_metric(["done"], operator.done)
        orders.add_metric(["refused"], operator.refused)
        yield orders
        if mirror.fresh:
            yield from self._controller()

    def _controller(self) -> Iterator[Metric]:
        mirror, machine = self._mirror, self._machine
        memory = mirror.memory
        yield _histogram("scan_duration_seconds", "time a scan takes", mirror, own.R_DURATIONS, own.R_DURATION_SUM)
        yield _histogram("scan_lateness_seconds", "delay of a scan's begin", mirror, own.R_LATENESS,
                         own.R_LATENESS_SUM)  # fmt: skip
        yield _counter("scans", "scans done", mirror.long(0))
        yield _counter("overruns", "scans that ended after the next was due", mirror.long(_R_OVERRUNS))
        yield _gauge("longest_scan_seconds", "longest scan since the start", mirror.word(_R_LONGEST_MS) / 1_000)
        yield _gauge("field_up", "1 = the field answers the controller", not mirror.word(source.R_LINK_LOST))
        yield _counter("refused_writes", "Modbus writes refused", mirror.long(_R_REFUSED_WRITES))
        yield _gauge("modbus_connections", "Modbus clients connected", mirror.word(_R_CONNECTIONS))
        yield _counter("refused_commands", "commands refused by the program", memory.D[machine.refusals.number])
        yield _gauge("state", "PackML state number", memory.D[machine.state.number])
        yield _gauge("mode", "mode number", memory.D[machine.mode.number])
        rows = [mirror.word(own.R_ALARMS + own.ALARM_WORDS * row) for row in range(own.ALARM_ROWS)]
        yield _gauge("alarms_listed", "rows of the operator's alarm list, at most 16", sum(map(bool, rows)))
        yield _gauge("alarms_active", "annunciators that are set", sum(memory.S[900:]))


def _gauge(name: str, meaning: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"{_PREFIX}_{name}", meaning, value=float(value))


def _counter(name: str, meaning: str, value: float) -> CounterMetricFamily:
    return CounterMetricFamily(f"{_PREFIX}_{name}", meaning, value=float(value))


def _histogram(name: str, meaning: str, mirror: Mirror, first: int, first_of_sum: int) -> HistogramMetricFamily:
    """Return a histogram; Prometheus' buckets hold all that is not longer, the controller's each its own."""
    counts = [mirror.long(first + 2 * bucket) for bucket in range(len(BOUNDS_US) + 1)]
    bounds = [str(bound / 1_000_000) for bound in BOUNDS_US] + ["+Inf"]
    so_far = 0
    buckets: list[tuple[str, float]] = []
    for bound, count in zip(bounds, counts, strict=True):
        so_far += count
        buckets.append((bound, float(so_far)))
    total_s = mirror.long(first_of_sum) / 1_000_000
    return HistogramMetricFamily(f"{_PREFIX}_{name}", meaning, buckets=buckets, sum_value=total_s)
