"""What an OPC UA server shows before anybody logs in: end points and certificate, and whether it is the pinned one."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import CertProperties
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.errors import ConfigError, DeviceRefused, RemoteProtocolError
from drivers.sinumerik.certificates import fingerprint, load
from drivers.sinumerik.uasettings import APPLICATION_URI, Secrets

SESSION_S = 60.0
CHANNEL_S = 3600.0
LIBRARY_TIMEOUT_S = 86400.0  # the caller's deadline rules, never the library's own


@dataclass(frozen=True, slots=True)
class Offer:
    """Security a server offers, as "policy/mode", and the certificate it shows (None: none at all)."""

    security: tuple[str, ...]
    secured: bool
    certificate: x509.Certificate | None


async def ask(url: str) -> Offer:
    """Get the end points without logging in. Raises the library's errors, ValueError for a broken certificate."""
    probe = Client(url, timeout=LIBRARY_TIMEOUT_S)
    try:
        endpoints = await probe.connect_and_get_server_endpoints()
    finally:
        probe.disconnect_socket()
    ours = [end for end in endpoints if _is_ours(end)]
    shown = [bytes(end.ServerCertificate) for end in (ours or endpoints) if end.ServerCertificate]
    names = sorted(
        {f"{end.SecurityPolicyUri.rpartition('#')[2]}/{end.SecurityMode.name.rstrip('_')}" for end in endpoints}
    )
    return Offer(tuple(names), bool(ours), load(shown[0]) if shown else None)


def _is_ours(end: Any) -> bool:
    signed = end.SecurityMode == ua.MessageSecurityMode.SignAndEncrypt
    return signed and end.SecurityPolicyUri == SecurityPolicyBasic256Sha256.URI


def check(offer: Offer, pinned: x509.Certificate, now: datetime, where: str) -> None:
    """Refuse a server that is not the pinned one. Raises DeviceRefused (E-UA-POLICY, E-UA-TRUST, E-UA-EXPIRED)."""
    if not offer.secured or offer.certificate is None:
        raise DeviceRefused("E-UA-POLICY", where)
    if offer.certificate != pinned:
        found, known = fingerprint(offer.certificate), fingerprint(pinned)
        raise DeviceRefused("E-UA-TRUST", where, found=found, pinned=known)
    if not pinned.not_valid_before_utc <= now <= pinned.not_valid_after_utc:
        since, until = pinned.not_valid_before_utc.isoformat(), pinned.not_valid_after_utc.isoformat()
        raise DeviceRefused("E-UA-EXPIRED", where, since=since, until=until)


async def check_trust(secrets: Secrets, ask_: Callable[[], Awaitable[Offer]], now: datetime, where: str) -> None:
    """Compare certificates before anything is entrusted to a server; nothing to do without security.

    A server that answers nobody without a login cannot be asked; then the channel itself must prove the pinned
    certificate. Raises as `check` and `check_own`, and what ``ask_`` raises.
    """
    if secrets.pinned is None or secrets.own is None:
        return
    path = secrets.own.certificate
    try:
        own = load(await asyncio.to_thread(path.read_bytes))
    except (OSError, ValueError) as error:
        given = {"key": "client_folder", "path": path, "why": str(error)}
        raise ConfigError("E-UA-SECRET", where, **given) from error  # type: ignore[arg-type]
    check_own(own, str(path), now, where)
    try:
        offer = await ask_()
    except RemoteProtocolError:
        return
    check(offer, secrets.pinned, now, where)


def check_own(own: x509.Certificate, path: str, now: datetime, where: str) -> None:
    """Refuse to log in with a certificate of ours that is not valid. Raises DeviceRefused (E-UA-OWN-EXPIRED)."""
    if not own.not_valid_before_utc <= now <= own.not_valid_after_utc:
        raise DeviceRefused("E-UA-OWN-EXPIRED", where, path=path, until=own.not_valid_after_utc.isoformat())


def new_client(url: str, secrets: Secrets) -> Any:
    """A fresh client: one request at a time, no reconnecting of its own."""
    client = Client(url, timeout=LIBRARY_TIMEOUT_S)
    client.name = client.description = "trueflank"
    client.application_uri = APPLICATION_URI
    client.session_timeout = SESSION_S * 1000.0
    client.secure_channel_timeout = int(CHANNEL_S * 1000)
    client.set_max_concurrent_requests(1)
    if secrets.user:
        client.set_user(secrets.user)
        client.set_password(secrets.password)
    return client


async def log_out(client: Any) -> None:
    """Close session and channel. Raises the library's errors."""
    await client.close_session()
    await client.close_secure_channel()


async def log_in(client: Any, secrets: Secrets) -> None:
    """Open channel and session. With a pinned certificate only its holder can answer. Raises the library's errors.

    Files are read here: the library's own reading uses threads that the loop's clock does not know of.
    """
    if secrets.pinned is not None and secrets.own is not None:
        await client.set_security(
            SecurityPolicyBasic256Sha256,
            certificate=CertProperties(await asyncio.to_thread(secrets.own.certificate.read_bytes), "der"),
            private_key=CertProperties(await asyncio.to_thread(secrets.own.key.read_bytes), "pem"),
            server_certificate=secrets.pinned.public_bytes(Encoding.DER),
            mode=ua.MessageSecurityMode.SignAndEncrypt,
        )
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    await client.create_session()
    await client.activate_session(username=secrets.user or None, password=secrets.password or None)
