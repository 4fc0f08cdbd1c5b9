"""Command line of the plant: ``python -m plant_sim`` serves it; trials and benchmarks have commands of their own."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from controller.command_line import Parser, while_read
from controller.io_map import DEFAULT_IO_MAP, IoMapError, load_io_map
from controller.modbus.address import listening_remedy
from plant_sim.bench.air import add_air_arguments, air_command
from plant_sim.bench.ladder_trial import LadderError, load_ladder, run_ladder_trial
from plant_sim.bench.live import ChildError, LiveError, LiveOptions, live_trial
from plant_sim.bench.matrix_cli import add_matrix_arguments, matrix_command
from plant_sim.bench.measure import measure
from plant_sim.bench.progress import ProgressView
from plant_sim.bench.recording import recorded
from plant_sim.bench.repeats import Repeats
from plant_sim.bench.report import TrialReport
from plant_sim.bench.scenario import run_scenario
from plant_sim.bench.scenario_cli import add_fault_arguments, add_scenario_arguments, faults_of, scenario_of
from plant_sim.bench.scenario_section import ScenarioError
from plant_sim.bench.study.cli import add_study_arguments, study_command
from plant_sim.bench.trial import run_trial, show_progress
from plant_sim.bench.twin import Twin
from plant_sim.faults import FaultError
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import DEFAULT_PORT, PlantServer
from plant_sim.links.reference import write_reference
from plant_sim.links.serve import serve
from plant_sim.parameters import DEFAULT_MACHINE, Machine, MachineError, load_machine
from plant_sim.plant import Plant
from plant_sim.scope.cli import add_plot_arguments, add_record_argument, plot_command
from plant_sim.scope.recorder import LIVE_ROWS_A_GROUP, Recorder
from plant_sim.scope.store import RecordingError

COMMANDS = ("serve", "run", "trial", "scenario", "faults", "plot", "air", "study", "bench", "docs")
INTERRUPTED = 130
MAX_PLANTING_FREQUENCY_PER_MIN = 300.0


class UsageError(ValueError):
    """A wrong option; one line that names it and the remedy."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or given[0] not in (*COMMANDS, "-h", "--help"):
        given.insert(0, "serve")
    return while_read(lambda: _command(given))


def _command(given: Sequence[str]) -> int:
    options = _parser().parse_args(given)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it ends everything as Ctrl-C does
    try:
        _check(options)
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except (UsageError, IoMapError, MachineError, FaultError, LadderError, ScenarioError, RecordingError) as error:
        print(error, file=sys.stderr)
        return 2
    except BrokenPipeError:
        raise  # a connection error, too, but of whoever reads what is printed
    except (LiveError, ConnectionError) as error:
        print(error, file=sys.stderr)
        return 1
    except ChildError as error:
        return error.exit_code or 1
    except KeyboardInterrupt:
        return INTERRUPTED


def _parser() -> Parser:
    parser = Parser(prog="python -m plant_sim", description="The seedling transplanter in software.",
                    formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    serve_ = _add(commands, "serve", _serve, "serve the plant as a Modbus TCP device (default)")
    _network(serve_)
    serve_.add_argument("--watchdog-ms", type=int, default=100, help="outputs go safe after this time without a write")
    serve_.add_argument("--lock-step-ms", type=int, default=None,
                        help="plant time per write of the outputs, instead of real time")  # fmt: skip
    serve_.add_argument("--allow-remote", action="store_true",
                        help="permit a --host that other computers reach; Modbus has no password")  # fmt: skip
    serve_.add_argument(
        "--planting-frequency", type=float, default=None, help="cups a minute and row; 0 = tractor stands"
    )
    run = _add(
        commands, "run", _run, "plant and controller in two processes: the paper's trial, with progress and report"
    )
    _network(run)
    run.add_argument("--fast", action="store_true", help="in lock step in simulated time, without Modbus")
    run.add_argument(
        "--real-time",
        action="store_true",
        help="plant and controller follow the clock, as a machine does; no pause, no other speed",
    )
    run.add_argument(
        "--pace",
        type=int,
        default=100,
        metavar="PERCENT",
        help="speed of simulated time at the start; a panel changes it (65535 = as fast as it can)",
    )
    run.add_argument("--by-hand", action="store_true", help="press nothing: start and stop with the panel's buttons")
    run.add_argument("--hmi-port", type=int, default=5021, help="port for operator panels; 0 = a free one")
    run.add_argument("--panel-port", type=int, default=8080, help="port of the web panel; 0 = a free one")
    run.add_argument("--no-panel", action="store_true", help="start no web panel")
    run.add_argument("--keep", action="store_true", help="go on serving after the report, until Ctrl-C")
    run.add_argument("--language", choices=("en", "zh"), default="en", help="language of the controller's texts")
    trial = _add(commands, "trial", _trial, "the paper's trial in lock step")
    form = trial.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one JSON object")
    form.add_argument("--csv", action="store_true", help="print a heading and one line a trial")
    trial.add_argument("--seedlings", type=int, default=None, metavar="N",
                       help="this many seedlings, in as many trays as they need; --trays is not looked at")  # fmt: skip
    trial.add_argument("--repeat", type=int, default=1, metavar="K",
                       help="this many trials, with one seed after the other")  # fmt: skip
    trial.add_argument("--ladder", type=Path, default=None, metavar="FILE",
                       help="an FX program, instruction list or GX Works2 CSV, in the controller's place")  # fmt: skip
    for breakable in (serve_, run, trial):
        add_fault_arguments(breakable)
        add_record_argument(breakable)
    scenario = _bare(commands, "scenario", _scenario, "run a scenario file and check what comes of it")
    add_scenario_arguments(scenario)
    add_record_argument(scenario)
    faults = _add(commands, "faults", _faults, "break everything in turn, and tabulate what tells it")
    add_matrix_arguments(faults)
    add_plot_arguments(_bare(commands, "plot", plot_command, "turn a recording into timing diagram and curves"))
    add_air_arguments(_bare(commands, "air", _air, "air consumption: Table 1 of the paper beside a run's own"))
    add_study_arguments(_bare(commands, "study", study_command, "the papers' experiments, or one's own, on the twin"))
    bench = _add(commands, "bench", _bench, "measure the speeds the project promises, as ratios in one run")
    bench.add_argument("--json", action="store_true", help="print one JSON object")
    docs = _add(commands, "docs", _docs, "write the reference tables made from the plant")
    docs.add_argument("--out", type=Path, required=True, help="folder for the tables")
    parser.epilog = f"Without a command:\n\n{serve_.format_help()}"
    return parser


def _add(
    commands: argparse._SubParsersAction[Parser],
    name: str,
    command: Callable[[argparse.Namespace], int],
    text: str,
) -> Parser:
    parser = _bare(commands, name, command, text)
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="the machine's parameters")
    parser.add_argument("--seed", type=int, default=1, help="seed of everything random")
    parser.add_argument("--trays", type=int, default=2, help="full trays of 72 in the magazine")
    return parser


def _bare(
    commands: argparse._SubParsersAction[Parser],
    name: str,
    command: Callable[[argparse.Namespace], int],
    text: str,
) -> Parser:
    parser = commands.add_parser(name, help=text, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.set_defaults(command=command)
    return parser


def _network(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", default="127.0.0.1", help="address of the Modbus TCP server")
    parser.add_argument("--port", type=int, default=DEFAULT_PORT, help="port of the Modbus TCP server; 0 = a free one")


def _check(options: argparse.Namespace) -> None:
    if not 1 <= getattr(options, "trays", 1) <= 1000:
        raise UsageError(f"--trays {options.trays}: give 1 to 1000")
    if not 1 <= (1 if getattr(options, "seedlings", None) is None else options.seedlings) <= 72_000:
        raise UsageError(f"--seedlings {options.seedlings}: give 1 to 72000")
    if not 1 <= getattr(options, "repeat", 1) <= 10_000:
        raise UsageError(f"--repeat {options.repeat}: give 1 to 10000")
    if getattr(options, "repeat", 1) > 1 and options.record is not None:
        raise UsageError("--record: holds one trial; leave --repeat out")
    if (getattr(options, "seed", None) or 0) < 0:
        raise UsageError(f"--seed {options.seed}: give 0 or more")
    if not 0 <= getattr(options, "port", 0) <= 65535:
        raise UsageError(f"--port {options.port}: give 0 to 65535")
    if not 0 <= (getattr(options, "planting_frequency", None) or 0) <= MAX_PLANTING_FREQUENCY_PER_MIN:
        raise UsageError(
            f"--planting-frequency {options.planting_frequency}: give 0 to {MAX_PLANTING_FREQUENCY_PER_MIN:g}"
        )


def _serve(options: argparse.Namespace) -> int:
    io_map = load_io_map(options.io_map)
    machine = _machine(options)
    plant = Plant(io_map, machine, seed=options.seed, trays=options.trays, faults=faults_of(options))
    if options.planting_frequency is not None:
        plant.planting_frequency_per_min = options.planting_frequency
    try:
        module = IoModule(plant, io_map, watchdog_ms=options.watchdog_ms)
        server = PlantServer(module, host=options.host, port=options.port, lock_step_ms=options.lock_step_ms,
                             allow_remote=options.allow_remote)  # fmt: skip
    except ValueError as error:
        raise UsageError(str(error)) from error

    def listening(port: int) -> None:
        print(f"plant listening on {options.host}:{port}", flush=True)

    with contextlib.ExitStack() as stack:
        if options.record is not None:
            recorder = Recorder(plant, options.record, io_map=io_map, machine=machine, seed=options.seed,
                                outputs=lambda: module.outputs, rows_a_group=LIVE_ROWS_A_GROUP)  # fmt: skip
            module.observers.append(stack.enter_context(recorder).sample)
        try:
            asyncio.run(serve(server, listening=listening))
        except OSError as error:
            reason = error.strerror or str(error)
            text = f"cannot listen on {options.host}:{options.port}: {reason}; {listening_remedy(error)}"
            raise UsageError(text) from error
    return 0


def _machine(options: argparse.Namespace) -> Machine:
    """Return the machine; what lies outside its makers' ratings is warned about."""
    return _warned(load_machine(options.machine))


def _warned(machine: Machine) -> Machine:
    for warning in machine.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return machine


def _run(options: argparse.Namespace) -> int:
    # whatever is wrong is told before anything is started
    Plant(load_io_map(options.io_map), load_machine(options.machine), seed=options.seed, trays=options.trays,
          faults=faults_of(options))  # fmt: skip
    if options.fast and options.keep:
        raise UsageError("--keep: there is nothing to keep serving with --fast; leave one of them out")
    if options.fast:
        return _fast(options)
    if options.port == 0:
        raise UsageError("--port 0: the controller must know the port; name one")
    live = LiveOptions(options.seed, options.trays, options.host, options.port, options.io_map, options.machine,
                       options.language, tuple(options.fault), options.record, options.hmi_port,
                       None if options.no_panel else options.panel_port, options.real_time, options.pace,
                       options.by_hand)  # fmt: skip
    with ProgressView() as view, live_trial(live, view) as trial:
        print(trial.panel, file=sys.stderr, flush=True)
        report = trial.run()
        print(report.text(), flush=True)
        if options.keep:
            print("serving until Ctrl-C", file=sys.stderr, flush=True)
            with contextlib.suppress(KeyboardInterrupt):
                trial.keep()
    return _exit_code(report)


def _fast(options: argparse.Namespace) -> int:
    with ProgressView() as view:
        (report,) = _trials(options, 1, show_progress(view, options.trays, options.language))
    print(report.text())
    return _exit_code(report)


def _trial(options: argparse.Namespace) -> int:
    if options.ladder is not None:
        return _ladder_trial(options)
    reports = _trials(options, options.repeat)
    repeats = Repeats(reports)
    if options.csv:
        print(repeats.csv(), end="")
    else:
        shown = repeats if options.repeat > 1 else reports[0]
        print(json.dumps(shown.record()) if options.json else shown.text())
    return 0 if repeats.completed and repeats.accounted else 1


def _ladder_trial(options: argparse.Namespace) -> int:
    if options.fault or options.record is not None:
        raise UsageError("--ladder: there are no faults and no recording with it; leave --fault and --record out")
    if options.csv or options.seedlings is not None or options.repeat > 1:
        raise UsageError("--ladder: runs full trays once; leave --csv, --seedlings and --repeat out")
    report = run_ladder_trial(load_ladder(options.ladder), seed=options.seed, trays=options.trays,
                              io_map=load_io_map(options.io_map), parameters=_machine(options))  # fmt: skip
    print(json.dumps(report.record()) if options.json else report.text())
    return 0 if report.completed else 1


def _trials(
    options: argparse.Namespace, count: int, progress: Callable[[Twin], None] | None = None
) -> list[TrialReport]:
    """Run trials with one seed after the other."""
    io_map, machine, faults = load_io_map(options.io_map), _machine(options), faults_of(options)
    return [
        run_trial(
            seed=seed,
            trays=options.trays,
            seedlings=getattr(options, "seedlings", None),
            io_map=io_map,
            parameters=machine,
            faults=faults,
            record=options.record,
            progress=progress,
        )
        for seed in range(options.seed, options.seed + count)
    ]


def _air(options: argparse.Namespace) -> int:
    if options.recording is None:
        _machine(options)
    return air_command(options)


def _scenario(options: argparse.Namespace) -> int:
    scenario = scenario_of(options)
    _warned(scenario.machine)
    with contextlib.ExitStack() as stack:
        report = run_scenario(
            scenario,
            prepare=lambda twin: stack.enter_context(recorded(twin, options.record, seed=scenario.seed)),
        )
    print(json.dumps(report.record(), default=str) if options.json else report.text())
    return 0 if report.passed else 1


def _faults(options: argparse.Namespace) -> int:
    _machine(options)
    return matrix_command(options)


def _exit_code(report: TrialReport) -> int:
    return 0 if report.completed and report.accounted else 1


def _bench(options: argparse.Namespace) -> int:
    figures = measure(seed=options.seed)
    print(json.dumps(figures.record()) if options.json else figures.text())
    return 0


def _docs(options: argparse.Namespace) -> int:
    for path in write_reference(options.out):
        print(path)
    return 0
