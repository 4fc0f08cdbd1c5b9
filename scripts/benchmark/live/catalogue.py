"""Catalogue of the parts that run processes in real time."""

from __future__ import annotations

from typing import Final

from scripts.benchmark.part import BenchmarkFigure, BenchmarkPart, lazily

_NO_CALM_SECOND: Final = "there was no second without steal time"


def _late(
    key: str, name: str, *, most_ms: float | None = None, most_missed: float | None = None, absent: str = ""
) -> dict[str, BenchmarkFigure]:
    """Return the three figures of the lateness of a loop."""
    return {
        f"{key}_p99": BenchmarkFigure(f"{name}, late in 99 % of cases", "ms", at_most=most_ms, absent=absent),
        f"{key}_latest": BenchmarkFigure(f"{name}, late at most", "ms", absent=absent),
        f"{key}_missed": BenchmarkFigure(f"{name}, missed", at_most=most_missed, absent=absent),
    }


_LATENESS: Final = BenchmarkPart(
    name="lateness",
    title="Lateness of the scans",
    explanation="Delay of the start of a scan, from the controller's histogram (the upper bound of the bucket: "
    "0.5 means at most 0.5 ms), with plant and controller as separate processes in real time and the machine in "
    "operation. *Missed* scans ended after the next one was due. *With clients*: two browser connections to the web "
    "panel, and eight Modbus clients that each read 64 coils and 64 registers 50 times a second, for 10 s. *Calm "
    "seconds* are those in which the host of the virtual machine took no processor time. A *bare loop* is Python code "
    "that only waits for deadlines 10 ms apart: it measures the computer, alone and then beside the scans.",
    repetitions=3,
    measure=lazily("scripts.benchmark.live.hmi:measure_punctuality"),
    figures={
        **_late("bare", "bare loop alone"),
        **_late("quiet", "scans without clients"),
        **_late("loaded", "scans with clients", most_ms=2, most_missed=0),
        **_late("calm", "scans with clients, calm seconds", absent=_NO_CALM_SECOND),
        **_late("beside", "bare loop beside them"),
        "calm_s": BenchmarkFigure("calm seconds", "s"),
        "stolen": BenchmarkFigure("steal time", "% of a processor"),
        "answers": BenchmarkFigure("answers to the clients", "1/s"),
        "views": BenchmarkFigure("views sent to the browsers", "1/s"),
    },
)
_LADDER_PAGE: Final = BenchmarkPart(
    name="ladder-page",
    title="Scans with a ladder page",
    explanation="Delay of the start of a scan as in *Lateness of the scans*, alternately without and with a ladder "
    "page that asks four times a second for the scan as executed, four pairs of 6 s each, with a bare loop beside each "
    "half.",
    repetitions=1,
    measure=lazily("scripts.benchmark.live.ladder_page:measure_ladder_page"),
    figures={
        **_late("closed", "scans without the page"),
        **_late("open", "scans with the page"),
        "closed_bare_p99": BenchmarkFigure("bare loop beside them without the page, late in 99 % of cases", "ms"),
        "open_bare_p99": BenchmarkFigure("bare loop beside them with the page, late in 99 % of cases", "ms"),
        "ratio": BenchmarkFigure("lateness of the scans with the page to that of the bare loop", at_most=1.2),
        "looks": BenchmarkFigure("scans shown", "1/s"),
    },
    by_default=False,
)
_MODBUS: Final = BenchmarkPart(
    name="modbus",
    title="Modbus",
    explanation="Reads per second, each of 64 registers, measured alternately with the pymodbus server over a plain "
    "datastore. With one connection, both servers mostly wait to be woken by the kernel.",
    repetitions=3,
    measure=lazily("scripts.benchmark.live.hmi:measure_rates"),
    figures={
        "one": BenchmarkFigure("one connection", "1/s"),
        "one_reference": BenchmarkFigure("one connection, pymodbus", "1/s"),
        "one_ratio": BenchmarkFigure("one connection, ratio", at_least=1),
        "many": BenchmarkFigure("eight connections", "1/s"),
        "many_reference": BenchmarkFigure("eight connections, pymodbus", "1/s"),
        "many_ratio": BenchmarkFigure("eight connections, ratio", at_least=1),
    },
)
_MALFORMED: Final = BenchmarkPart(
    name="malformed",
    title="Malformed frames",
    explanation="The server receives 20,000 mutated frames and 10,000 connections, half of which are reset, and must "
    "then answer a valid request. Every complete frame must be answered.",
    repetitions=3,
    measure=lazily("scripts.benchmark.live.hmi:measure_malformed"),
    figures={
        "answered": BenchmarkFigure("frames answered"),
        "memory_before": BenchmarkFigure("memory of the controller before", "MB"),
        "memory_after": BenchmarkFigure("memory of the controller after", "MB"),
    },
)


def _reaction(name: str, link: str, *, late_goal: float | None, **options: int) -> BenchmarkPart:
    """Return the part that measures the reaction over a link."""
    return BenchmarkPart(
        name=name,
        title=f"Reaction, {link}, scan of {options['scan_ms']} ms",
        explanation="Time from an input edge to the output edge at the plant, with real processes for 15 s: the "
        "controller runs the complete program without input filter, and two lamps follow the cup counters. A bare loop "
        "of the same period runs beside it. A *missed* edge has no answer; there may be one after the last scan.",
        repetitions=3,
        measure=lazily("scripts.benchmark.live.reaction:measure_reaction", **options),
        figures={
            "median": BenchmarkFigure("median", "ms"),
            "median_scans": BenchmarkFigure("median in scans", at_most=2),
            "p99": BenchmarkFigure("99th percentile", "ms"),
            "p99_scans": BenchmarkFigure("99th percentile in scans", at_most=3),
            "longest": BenchmarkFigure("longest", "ms"),
            "edges": BenchmarkFigure("edges"),
            "missed": BenchmarkFigure("missed edges"),
            "late_p99": BenchmarkFigure("lateness of the scans, 99th percentile", "ms"),
            "bare_p99": BenchmarkFigure("lateness of the bare loop, 99th percentile", "ms"),
            "late_ratio": BenchmarkFigure("lateness of the scans to that of the bare loop", at_most=late_goal),
            "overruns": BenchmarkFigure("overruns"),
        },
    )


_REACTIONS: Final = (
    _reaction("reaction-10", "Modbus TCP", scan_ms=10, late_goal=1.2),
    _reaction("reaction-5", "Modbus TCP", scan_ms=5, late_goal=1.2),
    _reaction("reaction-serial", "Modbus RTU at 115200 baud", scan_ms=20, baud=115_200, late_goal=None),
)


def _busy(key: str, name: str) -> dict[str, BenchmarkFigure]:
    return {
        f"{key}_scans": BenchmarkFigure(f"{name}, scans"),
        **_late(key, name),
        f"{key}_aborted": BenchmarkFigure(f"{name}, field link lost after", "s", absent="the field link held"),
    }


_BUSY_HOST: Final = BenchmarkPart(
    name="busy-host",
    title="Scans on a busy computer",
    explanation="Plant and controller as processes, with a machine at work, beside eight computing processes per "
    "processor, for 60 s each: with normal and with real-time priority (of both processes), and without and with four "
    "Modbus clients of the controller. The real-time priority must be permitted ([industrial PC](industrial-pc.md)).",
    repetitions=1,
    measure=lazily("scripts.benchmark.live.busy_host:measure_busy_host"),
    figures={
        **_busy("normal_alone", "normal priority"),
        **_busy("real_time_alone", "real-time priority"),
        **_busy("normal_clients", "normal priority, clients"),
        **_busy("real_time_clients", "real-time priority, clients"),
    },
    by_default=False,
)


def _grown(key: str) -> dict[str, BenchmarkFigure]:
    return {
        f"{key}_memory": BenchmarkFigure(f"{key}, memory at the end", "MB"),
        f"{key}_slope": BenchmarkFigure(f"{key}, growth", "MB/h", at_most=1),
        f"{key}_slope_lowest": BenchmarkFigure(f"{key}, growth, lower limit of the 95 % interval", "MB/h"),
        f"{key}_slope_highest": BenchmarkFigure(f"{key}, growth, upper limit of the 95 % interval", "MB/h"),
        f"{key}_files": BenchmarkFigure(f"{key}, more open files", at_most=0),
    }


_GROWTH: Final = BenchmarkPart(
    name="growth",
    title="Growth of memory",
    explanation="Plant, controller and panel as processes in real time with a machine at work, beside four Modbus "
    "clients that each read 64 coils and 64 registers 50 times a second, a browser with the live view, and one that "
    "opens all pages of data every 5 s. Memory is what a process has written itself (heap and stacks), sampled once a "
    "second. After 20 minutes, in which the panel fills its buffer of samples, *growth* is the slope of a straight "
    "line through the lowest values of the next 30 minutes, with an interval for correlated errors. *More open files* "
    "compares the medians of the last and the first third.",
    repetitions=1,
    measure=lazily("scripts.benchmark.live.growth:measure_growth"),
    figures={
        **_grown("plant"),
        **_grown("controller"),
        **_grown("panel"),
        "at_work": BenchmarkFigure("machine at work", "% of the time"),
    },
    by_default=False,
)

LIVE_PARTS: Final = (_LATENESS, _LADDER_PAGE, _MODBUS, _MALFORMED, *_REACTIONS, _GROWTH, _BUSY_HOST)
