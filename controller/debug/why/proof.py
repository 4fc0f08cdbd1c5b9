"""Proof of a cause by replay: the run branches with the cause removed, and the device takes its other value."""

from __future__ import annotations

from dataclasses import replace

from controller.common.errors import InputError
from controller.debug.comparison import branch, parse_change
from controller.debug.search import device_changes, following, last
from controller.debug.timeline import RunTimeline
from controller.debug.why.answer import CauseKind, WhyAnswer, WhyCause, WhyProof
from controller.debug.why.history import RunHistory
from controller.debug.why.inquiry import Inquiry
from controller.debug.why.program import ExplainedProgram
from controller.debug.why.texts import level, sentence
from controller.fx.language.operand_rules import Key
from controller.fx.observation.cross_reference import device_key
from controller.program.texts.operator import Text

_SCANS_AFTER = 200
"""Scans for which a branch runs on after an input that is changed at the end."""
_MOST_REPLAYS = 3
"""Number of causes that are tried."""
_FORBIDDEN = frozenset({CauseKind.SAFEGUARD, CauseKind.INTERLOCK})


def answer(line: RunTimeline, program: ExplainedProgram, key: Key, scan: int) -> WhyAnswer:
    """Return why a device has its value after a scan, with the proof by replay if a cause can be removed.

    Args:
        line: The recorded run, which does not change.
        program: Its program.
        key: The device.
        scan: The scan.

    Raises:
        InputError: The scan is not recorded, or no scan is recorded before it.
    """
    if not line.first < scan <= line.last:
        raise InputError(f"scan {scan}: no scan to look into; choose one from {line.first + 1} to {line.last}")
    found = Inquiry(RunHistory(line), program).ask(key, scan)
    first = found.cause
    candidates = [cause for cause in found.causes if cause.change][:_MOST_REPLAYS]
    if first is not None and first.kind in _FORBIDDEN:
        proof = _unproved("", sentence("no change", reason=sentence("is safeguard")))
    elif not candidates:
        proof = _unproved("", sentence("no change", reason=sentence("no input")))
    else:
        proofs = [_proof(line, program, key, found, candidates[0].change)]
        while not proofs[-1].proved and len(proofs) < len(candidates):
            proofs.append(_proof(line, program, key, found, candidates[len(proofs)].change))
        found, proof = _named(found, candidates, proofs)
    line.seek(scan)
    return replace(found, proof=proof)


def _named(found: WhyAnswer, tried: list[WhyCause], proofs: list[WhyProof]) -> tuple[WhyAnswer, WhyProof]:
    """Return the answer with the cause first that a replay has shown, and without other suspects; and its proof."""
    shown = tried[len(proofs) - 1] if proofs[-1].proved else None
    others = [each for each in found.causes if each is not shown and each.kind is not CauseKind.SUSPECT]
    if shown is not None:
        return replace(found, causes=(shown, *others)), proofs[-1]
    kept = [proof for cause, proof in zip(tried, proofs, strict=False) if cause.kind is not CauseKind.SUSPECT]
    none = _unproved("", sentence("no change", reason=sentence("no input")))
    return replace(found, causes=tuple(others)), (kept or [none])[0]


def _proof(line: RunTimeline, program: ExplainedProgram, key: Key, found: WhyAnswer, text: str) -> WhyProof:
    change = parse_change(text)
    if change.start - 1 < line.first:
        return _unproved(text, sentence("no change", reason=sentence("too early")))
    try:
        branched = branch(line, change, to=min(line.last, max(found.scan, change.start + _SCANS_AFTER)))
    except InputError as error:
        return _unproved(text, sentence("no change", reason=sentence("no replay", reason=str(error))))
    line.seek(found.scan)
    signal = line.machine.signal(found.device)
    value = signal.read()
    changes = device_changes(line, [signal])
    changed, own = last(line, changes, found.scan + 1), following(line, changes, found.scan)
    since = max(change.start, change.start if changed is None else changed)
    scan = _first_other(branched, found.device, value, since)
    values: dict[str, Text | str | int] = {"change": text, "name": program.name(key)}
    if scan is not None and (own is None or scan < own):
        branched.seek(scan)
        state = _state(key, signal.read())
        return WhyProof(proved=True, change=text, scan=scan, text=sentence("proved", scan=scan, state=state, **values))
    reason = _still(branched, program, key)
    still = _state(key, value)
    return _unproved(text, sentence("not proved", scan=branched.last, state=still, reason=reason, **values))


def _state(key: Key, value: object) -> Text:
    return sentence("equals", level=str(value)) if key[0] in "DVZ" else sentence("is", level=level(value))


def _first_other(branched: RunTimeline, device: str, value: object, since: int) -> int | None:
    """Return the first scan from `since` on in which a device of a branch has another value; None if there is none."""
    if since > branched.last:
        return None
    branched.seek(since)
    signal = branched.machine.signal(device)
    return since if signal.read() != value else following(branched, device_changes(branched, [signal]), since)


def _still(branched: RunTimeline, program: ExplainedProgram, key: Key) -> Text:
    """Return the cause for which a device still has its value at the end of a branch."""
    if branched.last <= branched.first:
        return sentence("same")
    cause = Inquiry(RunHistory(branched), program).ask(key, branched.last).cause
    return sentence("same") if cause is None else cause.text


def _unproved(change: str, text: Text) -> WhyProof:
    return WhyProof(proved=False, change=change, scan=None, text=text)


def device_asked(name: str, device: str) -> Key:
    """Return the key of a device that was asked for.

    Raises:
        InputError: It is no device of the program.
    """
    key = device_key(device)
    if key is None:
        raise InputError(f"why {name}: not a device; write for example why Y2, why S24, or a tag of the program")
    return key
