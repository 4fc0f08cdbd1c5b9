"""Settings that several commands make of their options: machine, faults, end of a trial."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from typing import Any

from controller.cli.machine import assigned
from controller.common.errors import InputError
from controller.fx.language.cpu_model import FX2N
from controller.program.set_points import SetPoints
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.faults import Fault, parse_fault
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.machine.stored_air import parse_share
from plant_sim.study.report.origin import changed_keys, changed_parts
from plant_sim.twin.ending.rule import EndingRule, default_max_ms


def machine_of(options: argparse.Namespace) -> Machine:
    """Return the parameters of the machine; print a warning for each that is outside the ratings of its component.

    The options for the air and for the planting frequency replace a parameter, if the command has them.

    Raises:
        InputError: The file is invalid, or ``--air`` is.
    """
    machine = load_machine(options.machine)
    per_min: float | None = getattr(options, "planting_frequency", None)
    if per_min is not None:
        machine = machine.with_values({"cups.planting_frequency_per_min": per_min})
    air: str | None = getattr(options, "air", None)
    if air is not None:
        try:
            machine = machine.with_values({"start.chamber_share": parse_share(air)})
        except ValueError as error:
            raise InputError(f"--air {error}") from None
    return warn_of_ratings(machine)


def changed_machine(options: argparse.Namespace) -> list[str]:
    """Return the paragraph that names the changed parameters of the machine file, for the top of a report.

    It is empty for the delivered machine. Other options, such as ``--air``, are not changes of the machine.
    """
    return changed_parts(load_machine(options.machine), options.machine) if _is_changed(options) else []


def with_changes(options: argparse.Namespace, record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of a result, with the changed parameters of the machine file if there are any."""
    changed = changed_keys(load_machine(options.machine)) if _is_changed(options) else []
    return {"changed_parameters": changed, **record} if changed else dict(record)


def _is_changed(options: argparse.Namespace) -> bool:
    """Return True if the machine file may differ from the delivered one."""
    return bool(options.machine != DEFAULT_MACHINE)


def warn_of_ratings(machine: Machine) -> Machine:
    """Print a warning for each parameter outside the ratings; return the machine."""
    for warning in machine.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return machine


def faults_of(options: argparse.Namespace) -> list[Fault]:
    """Return the faults to inject.

    Raises:
        FaultError: A fault is malformed or impossible.
    """
    return [parse_fault(text) for text in options.fault]


def check_program(options: argparse.Namespace) -> None:
    """Check the options for an FX program in place of the controller.

    Raises:
        InputError: An option belongs to the program or to the controller, and the other one runs.
    """
    if options.ladder is not None and options.set_points:
        raise InputError("--ladder: the program has its own initial values; omit --set")
    if options.ladder is None and (options.modules is not None or options.cpu != FX2N.key):
        raise InputError("--cpu and --modules: belong to an FX program; specify it with --ladder")


def start_values_of(options: argparse.Namespace) -> dict[str, int]:
    """Return the initial values of set-points, by name.

    Raises:
        InputError: A value is invalid, or is that of another option.
    """
    values = assigned(SetPoints(), options.set_points)
    if "trays_target" in values:
        raise InputError("--set trays_target: is the number of trays; use --trays")
    return values


def max_ms_of(options: argparse.Namespace) -> int | None:
    """Return the longest machine time of a trial, ms; None = the default."""
    max_s: int | None = options.max_s
    return None if max_s is None else 1_000 * max_s


def rule_of(options: argparse.Namespace, trays: int) -> EndingRule:
    """Return the rule by which a trial in one process ends; nobody can answer there."""
    max_ms = max_ms_of(options)
    waits: bool = options.wait
    return EndingRule(default_max_ms(trays) if max_ms is None else max_ms, lambda: waits)
