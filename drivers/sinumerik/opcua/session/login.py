"""What an OPC UA server shows before anybody logs in: end points and certificate, and whether it is the pinned one."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto.security_policies import SecurityPolicyAes256Sha256RsaPss, SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import CertProperties
from asyncua.ua.ua_binary import struct_from_binary
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.errors import ConfigError, DeviceRefused, RemoteProtocolError
from drivers.sinumerik.opcua.session.certificates import fingerprint, load
from drivers.sinumerik.opcua.session.secrets import APPLICATION_URI, Secrets
from drivers.sinumerik.opcua.settings import POLICIES

SESSION_S = 60.0
CHANNEL_S = 3600.0
EARLIEST_YEAR = 1990  # a time before that is the zero of OPC UA: the server gives none
LIBRARY_TIMEOUT_S = 86400.0  # the caller's deadline rules, never the library's own


_CLASSES = dict(zip(POLICIES, (SecurityPolicyAes256Sha256RsaPss, SecurityPolicyBasic256Sha256), strict=True))


@dataclass(frozen=True, slots=True)
class Offer:
    """Security a server offers, as "policy/mode", and the certificate it shows (None: none at all).

    ``policies`` are those of ours that it offers with sign and encrypt, best first. ``server_utc`` is its clock.
    """

    security: tuple[str, ...]
    policies: tuple[str, ...]
    certificate: x509.Certificate | None
    server_utc: datetime | None = None

    def best(self, wanted: tuple[str, ...]) -> str:
        """The best policy that is wanted and offered; "" where there is none."""
        return next((name for name in self.policies if name in wanted), "")


async def ask(url: str, where: str) -> Offer:
    """Get the end points without logging in. Raises the library's errors, ValueError for a broken certificate.

    Raises RemoteProtocolError (E-UA-NO-OFFER) for a server that greets and then opens no channel without security.
    """
    probe = Client(url, timeout=LIBRARY_TIMEOUT_S)
    try:
        await probe.connect_socket()
        await probe.send_hello()
        endpoints, server_utc = await _shown(probe, url, where)
    finally:
        probe.disconnect_socket()
    ours = [end for end in endpoints if _policy(end) in _CLASSES and _encrypts(end)]
    shown = [bytes(end.ServerCertificate) for end in (ours or endpoints) if end.ServerCertificate]
    names = sorted({f"{_policy(end)}/{end.SecurityMode.name.rstrip('_')}" for end in endpoints})
    offered = {_policy(end) for end in ours}
    policies = tuple(name for name in POLICIES if name in offered)
    return Offer(tuple(names), policies, load(shown[0]) if shown else None, server_utc)


async def _shown(probe: Any, url: str, where: str) -> tuple[list[Any], datetime | None]:
    """End points over a channel without security, and the time of that answer by the server's clock.

    A server without policy None refuses the channel or hangs up.
    """
    request = ua.GetEndpointsRequest()
    request.Parameters.EndpointUrl = url
    try:
        await probe.open_secure_channel()
        data = await probe.uaclient.protocol.send_request(request)
        response = struct_from_binary(ua.GetEndpointsResponse, data)
        response.ResponseHeader.ServiceResult.check()
        await probe.close_secure_channel()
    except (ua.UaStatusCodeError, ConnectionError, AssertionError) as error:
        raise RemoteProtocolError("E-UA-NO-OFFER", where, url=url) from error
    given = response.ResponseHeader.Timestamp
    known = isinstance(given, datetime) and given.year >= EARLIEST_YEAR
    return list(response.Endpoints or []), given.replace(tzinfo=UTC) if known else None


def _policy(end: Any) -> str:
    return str(end.SecurityPolicyUri or "").removeprefix("http://opcfoundation.org/UA/SecurityPolicy#")


def _encrypts(end: Any) -> bool:
    return bool(end.SecurityMode == ua.MessageSecurityMode.SignAndEncrypt)


def check(offer: Offer, pinned: x509.Certificate, wanted: tuple[str, ...], where: str) -> str:
    """Refuse a server that is not the pinned one; returns the policy to use.

    Raises DeviceRefused (E-UA-POLICY, E-UA-TRUST).
    """
    policy = offer.best(wanted)
    if not policy or offer.certificate is None:
        raise no_policy(offer, wanted, where)
    if offer.certificate != pinned:
        found, known = fingerprint(offer.certificate), fingerprint(pinned)
        raise DeviceRefused("E-UA-TRUST", where, found=found, pinned=known)
    return policy


def no_policy(offer: Offer, wanted: tuple[str, ...], where: str) -> DeviceRefused:
    """The error for a server with none of the wanted policies."""
    offered = ", ".join(offer.security) or "nothing"
    return DeviceRefused("E-UA-POLICY", where, wanted=" or ".join(wanted), offered=offered)


def holds(certificate: x509.Certificate, now: datetime) -> bool:
    """Whether a certificate is valid at a time."""
    return certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc


def apart(ahead_s: float | None) -> str:
    """How far the server's clock is ahead of ours as an error names it; "?" where it gave no time."""
    return "?" if ahead_s is None else f"{ahead_s:+.0f}"


def out_of_time(certificate: x509.Certificate, ahead_s: float | None, where: str) -> DeviceRefused:
    """The error for a server's certificate that is not valid now, with the difference of the clocks."""
    since, until = certificate.not_valid_before_utc.isoformat(), certificate.not_valid_after_utc.isoformat()
    return DeviceRefused("E-UA-EXPIRED", where, since=since, until=until, ahead_s=apart(ahead_s))


async def check_trust(
    secrets: Secrets, ask_: Callable[[], Awaitable[Offer]], now: Callable[[], datetime], where: str
) -> tuple[str, ...]:
    """Compare certificates before anything is entrusted to a server; policies to try in order, "" without security.

    Our own must be valid before anything is sent. The pinned one must be valid now, unless a person accepted it with
    a reason although it is not; that is judged after the server's first answer, which tells its clock. A server that
    answers nobody without a login cannot be asked; then the channel itself must prove the pinned certificate, first
    by the policy that every control has.
    Raises as `check` and `check_own`, DeviceRefused (E-UA-EXPIRED), and what ``ask_`` raises.
    """
    if secrets.pinned is None or secrets.own is None:
        return ("",)
    path = secrets.own.certificate
    try:
        own = load(await asyncio.to_thread(path.read_bytes))
    except (OSError, ValueError) as error:
        given = {"key": "client_folder", "path": path, "why": str(error)}
        raise ConfigError("E-UA-SECRET", where, **given) from error  # type: ignore[arg-type]
    check_own(own, str(path), now(), where)
    offer = None
    with contextlib.suppress(RemoteProtocolError):
        offer = await ask_()
    if not (holds(secrets.pinned, now()) or secrets.excuse):
        theirs = offer.server_utc if offer is not None else None
        raise out_of_time(secrets.pinned, None if theirs is None else (theirs - now()).total_seconds(), where)
    if offer is None:
        return tuple(reversed(secrets.policies))
    return (check(offer, secrets.pinned, secrets.policies, where),)


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


async def log_in(client: Any, secrets: Secrets, policy: str) -> None:
    """Open channel and session, secured by a policy; with a pinned certificate only its holder can answer.

    Raises the library's errors.
    Files are read here: the library's own reading uses threads that the loop's clock does not know of.
    """
    if secrets.pinned is not None and secrets.own is not None:
        await client.set_security(
            _CLASSES[policy],
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
