"""Modbus endpoints: TCP, TLS and RTU."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.files.trust import secret_exposure
from controller.common.modbus.mbap import MbapSession
from controller.common.modbus.rtu import RtuServer, SerialLine
from controller.hmi.modbus.session import HmiSession
from controller.hmi.serving.devices import AccessSource
from controller.hmi.serving.endpoints import EndpointNames, SerialEndpoint, ServerError, TcpEndpoint, TcpSettings

DEFAULT_PORT: Final = 5021
HMI_NAMES: Final = EndpointNames("HMI server", "Modbus", "--hmi-host", "--hmi-port", "--hmi-allow-remote", "--no-hmi")


@dataclass(frozen=True, slots=True)
class HmiOptions:
    """Network and serial settings of the Modbus server for panels.

    Attributes:
        host: Address to listen on.
        port: TCP port; 0 selects a free port, None no port at all.
        allow_remote: True to permit listening on an address that other computers can reach.
        certificate: Certificate file (PEM) for TLS; None selects plain TCP.
        key: Key file of the certificate.
        clients: File with the CA certificates that verify client certificates; None = client certificates not required.
        serial: Serial line for RTU in addition to TCP; None selects TCP only.
        max_connections: Number of slots of all clients but the operator panel.
        idle_timeout_s: Time without a request after which a connection is closed, s.
        reserved: Number of slots of the operator panel: its poll, its orders, a jog, and the jog before it.
    """

    host: str = "127.0.0.1"
    port: int | None = DEFAULT_PORT
    allow_remote: bool = False
    certificate: str | None = None
    key: str | None = None
    clients: str | None = None
    serial: SerialLine | None = None
    max_connections: int = 16
    idle_timeout_s: float = 60.0
    reserved: int = 4


def modbus_tcp(
    source: AccessSource,
    identity: Mapping[int, str],
    settings: TcpSettings,
    names: EndpointNames = HMI_NAMES,
    tls: ssl.SSLContext | None = None,
) -> TcpEndpoint:
    """Return a Modbus TCP port.

    Raises:
        ServerError: The address is invalid.
    """
    return TcpEndpoint(lambda peer: MbapSession(HmiSession(source.session(peer), identity)), settings, names, tls)


def modbus_rtu(source: AccessSource, identity: Mapping[int, str], line: SerialLine) -> SerialEndpoint:
    """Return a Modbus RTU line."""
    return SerialEndpoint(RtuServer(line, HmiSession(source.session(line.path), identity)), "--hmi-serial")


def tls_context(options: HmiOptions) -> ssl.SSLContext | None:
    """Return the TLS context of the server; None for plain TCP.

    Raises:
        ServerError: The files are invalid, or another user can read the key.
    """
    if options.certificate is None:
        if options.key is not None or options.clients is not None:
            raise ServerError("--hmi-key and --hmi-clients require a certificate; add --hmi-certificate")
        return None
    key = "key" if options.key is not None else "certificate"
    if problem := secret_exposure(Path(options.key or options.certificate)):
        raise ServerError(f"--hmi-{key} {problem}")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # without an explicit password, an encrypted key would prompt at the terminal and block
        context.load_cert_chain(options.certificate, options.key, password="")
        if options.clients is not None:
            context.load_verify_locations(options.clients)
            context.verify_mode = ssl.CERT_REQUIRED
    except (OSError, ssl.SSLError) as error:
        files = ", ".join(filter(None, (options.certificate, options.key, options.clients)))
        raise ServerError(f"HMI certificate ({files}): {error}; specify a matching set of PEM files") from error
    return context
