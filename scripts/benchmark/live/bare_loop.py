"""Loop that only waits for its deadlines: a measure of the timing of the computer.

As a process, it prints its lateness as one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections.abc import Iterator

NS_PER_MS = 1_000_000


def lateness_ns(period_ns: int, count: int) -> Iterator[int]:
    """Wait for periodic deadlines, as `controller.io.loop.run_real_time` does, and yield the lateness at each, ns.

    Deadlines that are missed completely are skipped, but counted.
    """
    never = threading.Event()
    due_ns = time.perf_counter_ns()
    for _ in range(count):
        due_ns += period_ns
        never.wait(max(0, due_ns - time.perf_counter_ns()) / 1e9)
        late_ns = max(0, time.perf_counter_ns() - due_ns)
        yield late_ns
        due_ns += late_ns // period_ns * period_ns


def main() -> None:
    """Wait for some seconds and print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scan-ms", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    options = parser.parse_args()
    count = round(options.seconds * 1_000 / options.scan_ms)
    sys.stdout.write(
        json.dumps({"late_us": [each // 1_000 for each in lateness_ns(options.scan_ms * NS_PER_MS, count)]})
    )


if __name__ == "__main__":
    main()
