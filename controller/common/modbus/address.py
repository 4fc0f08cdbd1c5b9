"""Listening address of a server without password: the loopback interface unless remote access is permitted."""

from __future__ import annotations

import errno
import ipaddress


def checked_host(host: str, *, allow_remote: bool, option: str, protocol: str = "Modbus") -> str:
    """Return the IP address to listen on.

    Args:
        host: IP address, or localhost for 127.0.0.1.
        allow_remote: True to permit an address that other computers can reach.
        option: Command-line option that permits remote access, named in the error message.
        protocol: Name of the protocol, which has no password, for the error message.

    Raises:
        ValueError: The address is invalid, or remote access is not permitted; the message is one line with the remedy.
    """
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise ValueError(f"host {host!r}: must be an IP address or localhost") from error
    if not address.is_loopback and not allow_remote:
        raise ValueError(
            f"host {host}: {protocol} has no password, so only connections from this computer (127.0.0.1) are "
            f"permitted; use {option} to permit others"
        )
    return str(address)


def listening_remedy(error: OSError, *, host: str = "--host", port: str = "--port") -> str:
    """Return the remedy for a listening address or port that cannot be opened.

    Args:
        error: Operating system error.
        host: Command-line option for the address.
        port: Command-line option for the port.
    """
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{host} must be an address of this computer"
    return f"choose another {port}"
