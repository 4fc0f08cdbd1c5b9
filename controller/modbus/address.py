"""Where a Modbus server listens: on this computer, unless somebody says otherwise."""

from __future__ import annotations

import errno
import ipaddress


def checked_host(host: str, *, allow_remote: bool, option: str) -> str:
    """Return an address to listen on.

    Args:
        host: An IP address, or localhost for 127.0.0.1.
        allow_remote: Permit an address that other computers can reach.
        option: The option that permits it, for the message.

    Raises:
        ValueError: It is no address, or one that others can reach; one line with the remedy.
    """
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise ValueError(f"host {host!r}: give an IP address or localhost") from error
    if not address.is_loopback and not allow_remote:
        raise ValueError(
            f"host {host}: Modbus has no password, so only this computer is listened to, on 127.0.0.1; {option} "
            "permits others"
        )
    return str(address)


def listening_remedy(error: OSError, *, host: str = "--host", port: str = "--port") -> str:
    """Return what to do when it cannot be listened there.

    Args:
        error: What the system said.
        host: The option that names the address.
        port: The option that names the port.
    """
    if error.errno == errno.EADDRNOTAVAIL:
        return f"give an address of this computer as {host}"
    return f"choose another {port}"
