"""Objects of the device identification (function 43) in which an I/O module reports who owns its outputs.

An exception response contains no text. A module that lends its outputs to one client at a time therefore reports the
address of the owner, and the writes that it has refused, in two private objects. Source of the object numbers: Modbus
Application Protocol V1.1b3, 6.21 (128 to 255 depend on the product).
"""

from __future__ import annotations

from typing import Final

VENDOR: Final = "seedling-transplanter"
PRODUCT: Final = "plant"
OWNER_OBJECT: Final = 0x80
"""Address of the client that owns the outputs; empty = none."""
REFUSED_OBJECT: Final = 0x81
"""Number of refused writes, a space, and the address of the client refused last."""
