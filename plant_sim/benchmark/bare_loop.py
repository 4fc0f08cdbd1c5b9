"""Process that only waits for the deadlines of a loop, and prints its lateness as one JSON object."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time


def main() -> None:
    """Wait for every deadline, as `controller.io.loop.run_real_time` does, for some seconds."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scan-ms", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    options = parser.parse_args()
    stop = threading.Event()
    late_us: list[int] = []
    overruns = 0
    due_ns = time.perf_counter_ns()
    for _ in range(round(options.seconds * 1_000 / options.scan_ms)):
        now_ns = time.perf_counter_ns()
        late_us.append(max(0, now_ns - due_ns) // 1_000)
        overruns += now_ns - due_ns > options.scan_ms * 1_000_000
        due_ns += options.scan_ms * 1_000_000
        stop.wait(max(0, due_ns - time.perf_counter_ns()) / 1e9)
    sys.stdout.write(json.dumps({"late_us": late_us, "overruns": overruns}))


if __name__ == "__main__":
    main()
