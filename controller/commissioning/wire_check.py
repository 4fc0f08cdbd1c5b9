"""Dialogue of a check: inputs operated by hand, then outputs by hold-to-run, in an order that their axes permit."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Final

from controller.commissioning.axes import AXIS_OF, Change, refusal
from controller.commissioning.checked_field import CheckedField, FieldLostError, StoppedError
from controller.commissioning.judge import (
    WireFinding,
    WireResult,
    is_decided,
    is_sensed,
    judge_input,
    judge_output,
    motions,
    outputs_of,
)
from controller.commissioning.report import CheckReport, note_text, result_text
from controller.commissioning.terminal import TerminalLostError
from controller.commissioning.texts import PROMPTS, REASONS, label, said
from controller.common.modbus.io_map import Point
from controller.program.texts.operator import Language

SETTLE_MS: Final = 500
"""Time with all outputs safe in which nothing may move, ms (assumed)."""
ORDER: Final = ("lift_retract", "spread", "converge", "lift_extend", "slide_inward", "slide_outward")
"""Order of the motions of an arm that permits each of them in turn, from its initial state: down at feed, converged."""


class QuitError(Exception):
    """Raised when the person ends the check."""


class WireCheck:
    """Check of the points of a report."""

    def __init__(
        self, field: CheckedField, report: CheckReport, language: Language, now_utc_ms: Callable[[], int]
    ) -> None:
        """Create a check.

        Args:
            field: Field I/O and keyboard.
            report: Report to fill in.
            language: Language of the texts.
            now_utc_ms: Function that returns the wall-clock time, ms since 1970 UTC.
        """
        self._field = field
        self._report = report
        self._language = language
        self._now_utc_ms = now_utc_ms

    def run(self) -> None:
        """Check all points; the outputs are safe at every end, and the report states how the check ended."""
        report = self._report
        lost = ""
        try:
            self._check_inputs([point for point in report.points if point.device == "X"])
            self._check_outputs([point for point in report.points if point.device == "Y"])
            report.end = "complete"
        except QuitError:
            report.end = "quit"
        except (StoppedError, TerminalLostError):
            report.end = "stopped"
        except FieldLostError as error:
            lost = str(error)
        finally:
            self._field.make_safe()
            report.ended_ms = self._now_utc_ms()
        if lost:
            with contextlib.suppress(TerminalLostError):
                self._report_loss(lost)

    def _report_loss(self, error: str) -> None:
        """Report a lost device, or a trip, which is known after the safe outputs have been written."""
        devices = self._field.tripped
        self._report.end = "tripped" if devices else "lost"
        if devices:
            self._say("tripped", devices=devices)
        else:
            self._field.keyboard.show(said(REASONS["link"], self._language, error=error))

    def _check_inputs(self, points: Sequence[Point]) -> None:
        if points:
            self._say("inputs")
        for point in points:
            while self._check_input(point) == "r":
                pass

    def _check_input(self, point: Point) -> str:
        """Check one input and return the answer to its result: Enter, r = repeat, s = skipped."""
        levels = []
        for prompt in ("release", "operate"):
            if self._ask(prompt, "\ns", point) == "s":
                return "s"
            levels.append(dict(self._field.levels))
        finding = judge_input(point, *levels)
        self._record(point, finding)
        return "\n" if finding.result is WireResult.OK else self._ask("again", "\nr")

    def _check_outputs(self, points: Sequence[Point]) -> None:
        if not points:
            return
        self._say("outputs")
        self._report.watchdog_confirmed = self._ask("watchdog", "yn\n") == "y"
        if not self._report.watchdog_confirmed:
            return
        devices = self._field.drive()
        if devices:
            self._say("reset", devices=devices)
        before, changes = self._field.watch(SETTLE_MS)
        for tag in outputs_of(motions(before, changes)):
            self._record(self._field.io_map[tag], WireFinding(WireResult.UNCOMMANDED))
        pending = [point for point in points if self._report.finding(point.tag).result is not WireResult.UNCOMMANDED]
        retried: set[Point] = set()
        while pending:
            point = self._next(pending)
            pending.remove(point)
            moved = self._check_output(point)
            others = [each for each in points if each is not point and each not in retried]
            again = [each for each in others if self._was_at_end(each, moved)]
            retried.update(again)
            pending += again

    def _was_at_end(self, point: Point, moved: set[str]) -> bool:
        """Return True if an output had no reaction, perhaps because its axis was at the end, and the axis has moved."""
        if self._report.finding(point.tag).result is not WireResult.DEAD or point.tag not in AXIS_OF:
            return False
        return AXIS_OF[point.tag][0].name in moved

    def _next(self, pending: Sequence[Point]) -> Point:
        """Return the next output: first those that may move and whose axis is not at its end."""

        def rank(point: Point) -> tuple[int, int]:
            motion = point.tag.rpartition(".")[2]
            place = ORDER.index(motion) if motion in ORDER else len(ORDER)
            if refusal(point.tag, self._field.levels) is not None:
                return 2, place
            axis, direction = AXIS_OF.get(point.tag, (None, 0))
            return int(axis is not None and axis.is_at_end(direction, self._field.levels)), place

        return min(pending, key=rank)

    def _check_output(self, point: Point) -> set[str]:
        """Check one output and return the names of the axes that it moved."""
        while True:
            answer = self._ask("clear", "ys", point)
            if answer == "s":
                return set()
            reason = refusal(point.tag, self._field.levels)
            if reason is None:
                break
            self._say("refused", point, reason=said(REASONS[reason], self._language))
            if self._ask("again", "\nr") == "\n":
                self._record(point, WireFinding(WireResult.NOT_TESTED, note=reason))
                return set()
        return self._hold(point)

    def _hold(self, point: Point) -> set[str]:
        sensed = is_sensed(point.tag, self._report.findings)
        before = dict(self._field.levels)
        seen: list[Change] = []
        was_on = False

        def decided(changes: list[Change]) -> bool:
            return sensed and is_decided(point.tag, before, [*seen, *changes], self._field.levels)

        while True:
            self._say("hold", point)
            held = self._field.hold(point, lambda: refusal(point.tag, self._field.levels), decided)
            seen += held.changes
            was_on |= held.was_on
            if held.end in REASONS:
                self._say("ended", reason=said(REASONS[held.end], self._language))
            if held.end == "q":
                raise QuitError
            if held.end == "s":
                return set()
            if held.end in ("\n", "reacted") and was_on:  # Enter alone is no verdict on an output that was never on
                break
        _, coasting = self._field.watch(SETTLE_MS)
        seen += coasting
        finding = judge_output(point.tag, before, seen) if sensed else None
        self._record(point, self._by_eye(point) if finding is None else finding)
        return set(motions(before, seen))

    def _by_eye(self, point: Point) -> WireFinding:
        """Return the verdict of the person on an output whose reaction is not sensed."""
        answer = self._ask("seen", "yno", point)
        if answer != "o":
            return WireFinding(WireResult.OK if answer == "y" else WireResult.DEAD, note="by_eye")
        typed = self._field.line(said(PROMPTS["which"], self._language)).upper()
        other = next((each for each in self._field.io_map.outputs if each.address == typed), None)
        if other is None or other.tag == point.tag:
            return WireFinding(WireResult.WRONG, note="by_eye")
        return WireFinding(WireResult.SWAPPED, (other.tag,), note="by_eye")

    def _record(self, point: Point, finding: WireFinding) -> None:
        self._report.add(point.tag, finding, self._now_utc_ms())
        text = result_text(self._field.io_map, finding, self._language)
        note = note_text(finding, self._language)
        self._say("result", point, result=f"{text} ({note})" if note else text)

    def _ask(self, prompt: str, answers: str, point: Point | None = None) -> str:
        """Ask for a key; q ends the check."""
        answer = self._field.ask(self._text(prompt, point), f"{answers}q")
        if answer == "q":
            raise QuitError
        return answer

    def _say(self, prompt: str, point: Point | None = None, **values: str) -> None:
        self._field.keyboard.show(self._text(prompt, point, **values))

    def _text(self, prompt: str, point: Point | None = None, **values: str) -> str:
        name = "" if point is None else label(point, self._language)
        return said(PROMPTS[prompt], self._language, point=name, **values)
