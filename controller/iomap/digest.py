"""Digest of an I/O map, by which files that depend on its wires are recognised."""

from __future__ import annotations

import hashlib

from controller.common.modbus.io_map import IoMap


def map_digest(io_map: IoMap) -> str:
    """Return the SHA-256 of the wires of an I/O map, regardless of comments and order of the file."""
    points = [
        (p.tag, p.address, str(p.polarity), p.safe, str(p.table), p.offset) for p in (*io_map.inputs, *io_map.outputs)
    ]
    registers = [(r.tag, r.address, r.safe, str(r.table), r.offset) for r in io_map.registers]
    return hashlib.sha256(repr((sorted(points), sorted(registers))).encode()).hexdigest()
