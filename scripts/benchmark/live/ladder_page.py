"""Lateness of the scans with and without an open ladder page; and the page: ``python -m ... URL SECONDS``."""

from __future__ import annotations

import http.client
import json
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from plant_sim.twin.process import LiveError, Process
from scripts.benchmark.live.hmi import START_LIMIT_S, bare_loop, line_of, running_machine, waited
from scripts.benchmark.live.hmi_load import connect
from scripts.benchmark.live.punctuality import Punctuality, Second, measured_seconds, total

ROUNDS: Final = 4
ROUND_S: Final = 6
PERIOD_S: Final = 0.25
"""Period of the requests of a page, as in its main.js."""
LOOK: Final = "/api/look?view=executed&first=0&count=30"
"""Request of a page with the view that needs three scans; 30 rungs are more than a screen shows."""


def measure_ladder_page(_seed: int, *, rounds: int = ROUNDS, round_s: int = ROUND_S) -> dict[str, float]:
    """Measure the lateness of scans alternately without and with a page, each beside a bare loop.

    Args:
        rounds: Number of pairs.
        round_s: Duration of each half of a pair, s.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
    """
    scans: dict[str, list[Second]] = {"closed": [], "open": []}
    beside: dict[str, list[Punctuality]] = {"closed": [], "open": []}
    looks = 0
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        port = stack.enter_context(running_machine(folder, at_work=True)).hmi_port
        command = ["controller", "ladder", "page", "--machine", "--connect", f"127.0.0.1:{port}", "--port", "0"]
        page = stack.enter_context(Process("ladder page", command))
        url = line_of(page, START_LIMIT_S).removeprefix("ladder page at ")
        looks_of(url, for_s=0)  # until the program is prepared
        line = stack.enter_context(connect(port))
        for _ in range(rounds):
            for state in scans:
                with ExitStack() as half, bare_loop(round_s) as waiting:
                    watching = None
                    if state == "open":
                        module = "scripts.benchmark.live.ladder_page"
                        watching = half.enter_context(Process("browser", [module, url, str(round_s)]))
                    scans[state] += measured_seconds(line, round_s)
                    beside[state].append(waited(waiting))
                    if watching is not None:
                        looks += int(line_of(watching, START_LIMIT_S))
    figures = {f"{state}_{name}": value for state in scans for name, value in total(scans[state]).figures().items()}
    bare_ms = {state: max(each.p99_ms for each in halves) for state, halves in beside.items()}
    return figures | {
        "closed_bare_p99": bare_ms["closed"],
        "open_bare_p99": bare_ms["open"],
        "ratio": figures["open_p99"] / bare_ms["open"],
        "looks": looks / (rounds * round_s),
    }


def looks_of(url: str, for_s: float) -> int:
    """Ask for scans as a page does, at least until the first answer with a scan; return their number.

    Raises:
        LiveError: The page does not answer with scans.
    """
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=START_LIMIT_S)
    begun_s = time.perf_counter()
    looks = 0
    try:
        while looks == 0 or time.perf_counter() - begun_s < for_s:
            status, text = _answer(connection)
            looks += status == http.client.OK
            if looks == 0 and time.perf_counter() - begun_s > START_LIMIT_S:
                raise LiveError(f"{url}: no scan; {json.loads(text)}")
            threading.Event().wait(PERIOD_S)
    finally:
        connection.close()
    return looks


def _answer(connection: http.client.HTTPConnection) -> tuple[int, bytes]:
    """Return status and content of the answer to one request.

    A server may close a kept connection while the next request is on its way. A browser then repeats the request on a
    new connection (RFC 9112, 9.3.1), and so does this client, once.
    """
    try:
        return _asked(connection)
    except ConnectionError:
        connection.close()
        return _asked(connection)


def _asked(connection: http.client.HTTPConnection) -> tuple[int, bytes]:
    connection.request("GET", LOOK)
    answer = connection.getresponse()
    return answer.status, answer.read()


if __name__ == "__main__":
    sys.stdout.write(f"{looks_of(sys.argv[1], float(sys.argv[2]))}\n")
