"""PLCopen XML of a program, in the form in which CODESYS exports and imports it.

Schema: PLCopen TC6 XML 2.0; CODESYS 3.5 writes its namespace `tc6_0200`, with global variable lists and tasks in
`addData` elements of its own (observed in public exports of CODESYS 3.5 SP19 and Automation Builder 2.7).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final
from xml.sax.saxutils import escape, quoteattr

from controller.export.structured_text import ProgramText
from controller.export.structured_text_variables import Variable

_VENDOR: Final = "http://www.3s-software.com/plcopenxml"
_XHTML: Final = "http://www.w3.org/1999/xhtml"
_ELEMENTARY: Final = frozenset({"BOOL", "INT", "DINT", "LINT", "TIME"})
_CREATED: Final = "2026-01-01T00:00:00"
"""Constant, so that the same program always yields the same file."""


def plcopen_xml(
    text: ProgramText,
    local: Sequence[Variable],
    lists: Mapping[str, Sequence[Variable]],
    persistent: str,
    *,
    interval_ms: int,
    watchdog_ms: int,
) -> str:
    """Return a project with a program, its global variable lists and its task.

    Args:
        text: The program.
        local: Variables declared in the program.
        lists: Variables of the global variable lists, by name of the list.
        persistent: Name of the persistent variable list.
        interval_ms: Period of the task, ms.
        watchdog_ms: Time of the task's watchdog, ms.
    """
    lines = (
        '<?xml version="1.0" encoding="utf-8"?>',
        '<project xmlns="http://www.plcopen.org/xml/tc6_0200">',
        f'<fileHeader companyName="" productName="seedling-transplanter" productVersion="1" '
        f'creationDateTime="{_CREATED}"/>',
        f'<contentHeader name={quoteattr(text.name)} modificationDateTime="{_CREATED}">',
        '<coordinateInfo><fbd><scaling x="1" y="1"/></fbd><ld><scaling x="1" y="1"/></ld>'
        '<sfc><scaling x="1" y="1"/></sfc></coordinateInfo>',
        "</contentHeader>",
        "<types>",
        "<dataTypes/>",
        "<pous>",
        f'<pou name={quoteattr(text.name)} pouType="program">',
        "<interface>",
        "<localVars>",
        *_variables(local),
        "</localVars>",
        "</interface>",
        f'<body><ST><xhtml xmlns="{_XHTML}">{escape(text.body)}</xhtml></ST></body>',
        "</pou>",
        "</pous>",
        "</types>",
        "<instances><configurations/></instances>",
        "<addData>",
        *_lists(lists, persistent),
        *_task(text.name, interval_ms, watchdog_ms),
        "</addData>",
        "</project>",
    )
    return "\n".join(lines) + "\n"


def _lists(lists: Mapping[str, Sequence[Variable]], persistent: str) -> Iterator[str]:
    for name, variables in lists.items():
        kept = ' retain="true" persistent="true"' if name == persistent else ""
        yield f'<data name="{_VENDOR}/globalvars" handleUnknown="implementation">'
        yield f"<globalVars name={quoteattr(name)}{kept}>"
        yield from _variables(variables)
        yield "</globalVars>"
        yield "</data>"


def _task(program: str, interval_ms: int, watchdog_ms: int) -> Iterator[str]:
    yield f'<data name="{_VENDOR}/application" handleUnknown="implementation">'
    yield '<resource name="Application">'
    yield f'<task name="MainTask" interval="PT{interval_ms / 1_000}S" priority="1">'
    yield f'<pouInstance name={quoteattr(program)} typeName=""/>'
    yield "<addData>"
    yield f'<data name="{_VENDOR}/tasksettings" handleUnknown="implementation">'
    yield (
        f'<TaskSettings KindOfTask="Cyclic" Interval="t#{interval_ms}ms" IntervalUnit="ms" WithinSPSTimeSlicing="true">'
        f'<Watchdog Enabled="true" Time="t#{watchdog_ms}ms" TimeUnit="ms" Sensitivity="1"/></TaskSettings>'
    )
    yield "</data>"
    yield "</addData>"
    yield "</task>"
    yield "</resource>"
    yield "</data>"


def _variables(variables: Iterable[Variable]) -> Iterator[str]:
    for variable in variables:
        kind = f"<{variable.type}/>" if variable.type in _ELEMENTARY else f'<derived name="{variable.type}"/>'
        first = f'<initialValue><simpleValue value="{variable.first}"/></initialValue>' if variable.first else ""
        comment = escape(variable.comment)
        meaning = f'<documentation><xhtml xmlns="{_XHTML}">{comment}</xhtml></documentation>' if comment else ""
        yield f"<variable name={quoteattr(variable.name)}><type>{kind}</type>{first}{meaning}</variable>"
