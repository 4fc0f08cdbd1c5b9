"""Session of one client with a recorded run: requests of the Debug Adapter Protocol and their answers.

Nothing here reaches a controller: the run is recorded, and a changed value is a branch of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.debug.adapter.arguments import Arguments
from controller.debug.adapter.breakpoint_table import BreakpointTable
from controller.debug.adapter.breakpoints import BreakpointSearch, ChangeBreakpoint, SearchEnd
from controller.debug.adapter.listed_program import ListedProgram
from controller.debug.adapter.stack import frames
from controller.debug.adapter.variables import ShownVariables, value_text
from controller.debug.adapter.wire import Request
from controller.debug.commands import Debugger
from controller.debug.condition import parse_condition
from controller.debug.machine import RunPosition
from controller.debug.stepping import StepUnit
from controller.debug.timeline import RunTimeline

THREAD: Final = 1
CAPABILITIES: Final = {
    f"supports{name}": True
    for name in (
        "ConfigurationDoneRequest",
        "FunctionBreakpoints",
        "ConditionalBreakpoints",
        "DataBreakpoints",
        "EvaluateForHovers",
        "StepBack",
        "SetVariable",
        "GotoTargetsRequest",
        "LoadedSourcesRequest",
        "SteppingGranularity",
        "TerminateRequest",
    )
}
_LIVE: Final = (
    "attach: refused, because nothing may stop a live controller or change it; look at its ladder page, or launch the "
    "recorded run of this adapter"
)
_ALWAYS: Final = frozenset({"pause", "threads", "disconnect", "terminate", "source", "loadedSources"})
"""Requests that are answered during a search, too."""

Message = dict[str, Any]
Answer = dict[str, Any] | None


class AdapterSession:
    """Session of one client."""

    def __init__(self, recorded: RunTimeline, send: Callable[[Message], None]) -> None:
        """Begin a session.

        Args:
            recorded: Recorded run.
            send: Function that sends a message to the client.
        """
        self._is_over = False
        self._debugger = Debugger(recorded)
        self._program = ListedProgram(recorded.machine.ladder)
        self._variables = ShownVariables(self._debugger)
        self._table = BreakpointTable(self._debugger, self._program)
        self._write, self._sent = send, 0
        self._is_initialized = self._is_launched = self._is_configured = False
        self._stops_on_entry = True
        self._line_offset = 0
        self._search: Iterator[SearchEnd | None] | None = None
        self._after: list[Callable[[], None]] = []
        self._requests: dict[str, Callable[[Arguments], Answer]] = {
            name.removeprefix("_on_"): getattr(self, name) for name in dir(self) if name.startswith("_on_")
        }

    @property
    def is_searching(self) -> bool:
        """True during a search, in which `advance` is to be called."""
        return self._search is not None

    def answer(self, request: Request) -> bool:
        """Execute a request, and send the answer and the events that follow it; return False at the end."""
        response = {"type": "response", "request_seq": request.seq, "command": request.command}
        try:
            body = self._execute(request)
        except InputError as error:
            text = str(error)
            body = {"error": {"id": 1, "format": text.replace("{", "(").replace("}", ")"), "showUser": True}}
            self._send({**response, "success": False, "message": text, "body": body})
        else:
            self._send({**response, "success": True, **({} if body is None else {"body": body})})
        actions, self._after = self._after, []
        for action in actions:
            action()
        return not self._is_over

    def advance(self) -> None:
        """Continue a search for a short time."""
        stop = next(self._search) if self._search is not None else None
        if stop is None:
            return
        self._search = None
        self._debugger.go(stop.position)
        if not stop.hit:
            end = "beginning" if stop.position.scan == self._debugger.line.first else "end"
            self._stopped("pause", f"{end} of the recorded run")
            return
        first = stop.hit[0]
        reason = first.reason if isinstance(first, ChangeBreakpoint) else "breakpoint"
        self._stopped(reason, hit=[each.number for each in stop.hit])

    def _execute(self, request: Request) -> Answer:
        name = request.command
        if name not in self._requests:
            raise InputError(f"{name[:40]}: no such request; {suggestion(name[:40], self._requests, 'see the guide')}")
        if self._is_initialized == (name == "initialize"):
            raise InputError("initialize: sent twice" if self._is_initialized else f"{name}: send initialize first")
        if self._search is not None and name not in _ALWAYS:
            raise InputError(f"{name}: the run is being searched; send pause first")
        return self._requests[name](Arguments(request.arguments, name))

    def _send(self, message: Message) -> None:
        self._sent += 1
        self._write({"seq": self._sent, **message})

    def _event(self, name: str, body: Answer = None) -> None:
        self._send({"type": "event", "event": name, **({} if body is None else {"body": body})})

    def _stopped(self, reason: str, text: str = "", hit: list[int] | None = None) -> None:
        body: dict[str, Any] = {"reason": reason, "threadId": THREAD, "allThreadsStopped": True}
        if text:
            body |= {"description": text, "text": text}
        if hit:
            body["hitBreakpointIds"] = hit
        self._event("stopped", body)

    def _on_initialize(self, arguments: Arguments) -> Answer:
        self._line_offset = 0 if arguments.flag("linesStartAt1", default=True) else 1
        self._table.line_offset = self._line_offset
        self._is_initialized = True
        self._after.append(lambda: self._event("initialized"))
        return CAPABILITIES

    def _on_launch(self, arguments: Arguments) -> Answer:
        if self._is_launched:
            raise InputError("launch: sent twice")
        line = self._debugger.recorded
        self._debugger.go(RunPosition(arguments.integer("scan", line.first)))
        self._stops_on_entry = arguments.flag("stopOnEntry", default=True)
        self._is_launched = True
        self._after.append(self._start)
        return None

    def _on_attach(self, _: Arguments) -> Answer:
        raise InputError(_LIVE)

    def _on_configurationDone(self, _: Arguments) -> Answer:  # noqa: N802 - name of the protocol
        self._is_configured = True
        self._after.append(self._start)
        return None

    def _start(self) -> None:
        if not (self._is_launched and self._is_configured):
            return
        if self._stops_on_entry:
            self._stopped("entry")
        else:
            self._run_on(back=False)

    def _on_disconnect(self, _: Arguments) -> Answer:
        self._is_over, self._search = True, None
        return None

    def _on_terminate(self, _: Arguments) -> Answer:
        self._search = None
        self._after.append(lambda: self._event("terminated"))
        return None

    def _on_threads(self, _: Arguments) -> Answer:
        return {"threads": [{"id": THREAD, "name": "recorded run"}]}

    def _on_loadedSources(self, _: Arguments) -> Answer:  # noqa: N802
        return {"sources": [self._program.source]}

    def _on_source(self, arguments: Arguments) -> Answer:
        arguments.integer("sourceReference", 0)
        return {"content": self._program.text}

    def _on_stackTrace(self, arguments: Arguments) -> Answer:  # noqa: N802
        every = [
            {**frame, "line": frame["line"] - self._line_offset} for frame in frames(self._debugger, self._program)
        ]
        first, count = arguments.integer("startFrame", 0), arguments.integer("levels", 0)
        return {"stackFrames": every[first : first + count] if count else every[first:], "totalFrames": len(every)}

    def _on_scopes(self, arguments: Arguments) -> Answer:
        arguments.integer("frameId")
        return {"scopes": self._variables.scopes()}

    def _on_variables(self, arguments: Arguments) -> Answer:
        reference = arguments.integer("variablesReference")
        found = self._variables.of_scope(reference)
        if found is None:
            raise InputError(f"variables.variablesReference {reference}: no such scope; ask for the scopes")
        first, count = arguments.integer("start", 0), arguments.integer("count", 0)
        return {"variables": found[first : first + count] if count else found[first:]}

    def _on_setBreakpoints(self, arguments: Arguments) -> Answer:  # noqa: N802
        return {"breakpoints": self._table.set_lines(arguments)}

    def _on_setFunctionBreakpoints(self, arguments: Arguments) -> Answer:  # noqa: N802
        return {"breakpoints": self._table.set_functions(arguments)}

    def _on_setDataBreakpoints(self, arguments: Arguments) -> Answer:  # noqa: N802
        return {"breakpoints": self._table.set_data(arguments)}

    def _on_setExceptionBreakpoints(self, _: Arguments) -> Answer:  # noqa: N802
        return {"breakpoints": []}

    def _on_dataBreakpointInfo(self, arguments: Arguments) -> Answer:  # noqa: N802
        return self._table.data_info(arguments)

    def _on_continue(self, _: Arguments) -> Answer:
        self._after.append(lambda: self._run_on(back=False))
        return {"allThreadsContinued": True}

    def _on_reverseContinue(self, _: Arguments) -> Answer:  # noqa: N802
        self._after.append(lambda: self._run_on(back=True))
        return None

    def _run_on(self, *, back: bool) -> None:
        debugger = self._debugger
        search = BreakpointSearch(debugger, self._table.breakpoints())
        self._search = (search.back if back else search.forward)(debugger.position)

    def _on_pause(self, _: Arguments) -> Answer:
        if self._search is not None:
            self._search = None
            self._after.append(lambda: self._stopped("pause"))
        return None

    def _on_next(self, arguments: Arguments) -> Answer:
        return self._step(arguments, StepUnit.RUNG)

    def _on_stepIn(self, arguments: Arguments) -> Answer:  # noqa: N802
        return self._step(arguments, StepUnit.INSTRUCTION)

    def _on_stepOut(self, arguments: Arguments) -> Answer:  # noqa: N802
        return self._step(arguments, StepUnit.SCAN)

    def _on_stepBack(self, arguments: Arguments) -> Answer:  # noqa: N802
        return self._step(arguments, StepUnit.RUNG, back=True)

    def _step(self, arguments: Arguments, unit: StepUnit, *, back: bool = False) -> Answer:
        if arguments.text("granularity", "") == "instruction" and unit is StepUnit.RUNG:
            unit = StepUnit.INSTRUCTION
        debugger = self._debugger
        step = debugger.stepper.back if back else debugger.stepper.forward
        self._go(step(debugger.line, debugger.position, unit), "step")
        return None

    def _go(self, position: RunPosition, reason: str) -> None:
        self._debugger.go(position)
        self._after.append(lambda: self._stopped(reason))

    def _on_gotoTargets(self, arguments: Arguments) -> Answer:  # noqa: N802
        at = self._program.instruction(arguments.integer("line") + self._line_offset)
        debugger = self._debugger
        if debugger.scan == debugger.line.last or at not in self._stops():
            return {"targets": []}
        line = self._program.line(at) - self._line_offset
        return {"targets": [{"id": at, "label": f"scan {debugger.scan + 1}", "line": line}]}

    def _on_goto(self, arguments: Arguments) -> Answer:
        at = arguments.integer("targetId")
        if self._debugger.scan == self._debugger.line.last or at not in self._stops():
            raise InputError(f"goto.targetId {at}: not executed in the next scan; ask for the targets of a line")
        self._go(RunPosition(self._debugger.scan, at), "goto")
        return None

    def _stops(self) -> tuple[int, ...]:
        debugger = self._debugger
        return debugger.stepper.observer.observe(debugger.line, debugger.scan + 1).stops

    def _on_evaluate(self, arguments: Arguments) -> Answer:
        text = arguments.text("expression").strip()
        if arguments.text("context", "") != "repl":
            return {"result": self._value(text), "variablesReference": 0}
        debugger = self._debugger
        before = debugger.line, debugger.position
        is_command = text.partition(" ")[0] in debugger.names
        result = "\n".join(debugger.execute(text)) if is_command else self._value(text)
        if (debugger.line, debugger.position) != before:
            self._after.append(lambda: self._stopped("goto"))
        return {"result": result, "variablesReference": 0}

    def _value(self, text: str) -> str:
        debugger = self._debugger
        debugger.line.seek(debugger.scan)
        machine = debugger.line.machine
        if not set(text) & set(" <>=&|~!()"):
            return value_text(machine.signal(text))
        return "true" if parse_condition(text, machine.signal).holds() else "false"

    def _on_setVariable(self, arguments: Arguments) -> Answer:  # noqa: N802
        if not self._variables.is_devices(arguments.integer("variablesReference")):
            raise InputError("setVariable: choose a device; a fault is a branch: write it in the debug console")
        name, value = arguments.text("name").partition(" ")[0], arguments.text("value").strip()
        debugger = self._debugger
        if debugger.line is not debugger.recorded:
            raise InputError("setVariable: a branch is shown, which is not branched again; write use recorded first")
        scan = debugger.scan + 1
        end = ".." if name.startswith("X") else ""
        answer = [*debugger.execute(f"branch {name}={value}@{scan}{end}"), *debugger.execute("use branch")]
        answer.append(f"The recorded run is unchanged: this is a branch with {name}={value} from scan {scan} on.")
        self._event("output", {"category": "important", "output": "".join(f"{line}\n" for line in answer)})
        self._go(RunPosition(scan), "goto")
        return {"value": value_text(debugger.line.machine.signal(name))}
