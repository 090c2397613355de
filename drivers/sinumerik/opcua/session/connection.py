"""Login, secure channel and session: secrets, the pinned certificate, one request at a time, and what ends them.

::

    read secrets -> ask the end points without login -> compare the server's certificate with the pinned one
                 -> channel and session with the strongest policy that both know -> requests -> close

With `requests` the one place that knows asyncua. asyncua's own reconnecting, watching and trusting are not used: a
request that failed or was interrupted leaves the session broken and the next call raises, because what the server did
meanwhile is unknown. The server's certificate must be the pinned one.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto.security_policies import SecurityPolicyAes256Sha256RsaPss, SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import CertProperties
from asyncua.ua.ua_binary import struct_from_binary
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceRefused, LinkBroken, RemoteProtocolError, TrueflankError
from drivers.local.names import shown
from drivers.message import Message
from drivers.sinumerik.opcua.session import certificates, requests
from drivers.sinumerik.opcua.session import nodes as typed_values
from drivers.sinumerik.opcua.session.certificates import KeyPair, fingerprint, load_certificate
from drivers.sinumerik.opcua.session.status import Stage, is_lost, status_error, translate_error
from drivers.sinumerik.opcua.settings import POLICIES, UaSettings

# Password and certificates of a login, read from where the settings of a control point.

APPLICATION_URI = "urn:trueflank:gateway"


@dataclass(frozen=True, slots=True)
class Secrets:
    """What a login needs, read from where the settings point: ``pinned`` and ``own`` are None without security.

    ``policies`` may be used, best first. ``excuse`` is why a person accepted the pinned certificate although it was
    not valid; "" where nobody did.
    """

    user: str
    password: str
    pinned: x509.Certificate | None = None
    own: KeyPair | None = None
    policies: tuple[str, ...] = POLICIES
    excuse: str = ""


def read_secrets(settings: UaSettings, where: str) -> Secrets:
    """Read password and certificates; blocking.

    Raises ConfigError (E-UA-SECRET, E-UA-SECRET-ENV, E-UA-UNPINNED) naming key, file and why.
    """
    told = _read_password(settings.password_env, settings.password_file, "password_file", where)
    password = settings.password if told is None else told
    if not settings.secured:
        return Secrets(settings.user, password)
    path = settings.server_certificate
    if not Path(path).is_file():
        raise ConfigError("E-UA-UNPINNED", where, path=path)
    try:
        pinned = certificates.load_certificate(_read_content("server_certificate", path, where))
    except ValueError as error:
        raise ConfigError("E-UA-SECRET", where, key="server_certificate", path=path, why=str(error)) from error
    folder = client_folder(settings)
    try:
        own = certificates.own_key_pair(folder, "trueflank", APPLICATION_URI, "localhost")
    except OSError as error:
        raise ConfigError("E-UA-SECRET", where, key="client_folder", path=str(folder), why=str(error)) from error
    given = {"user": settings.user, "password": password, "policies": settings.policies}
    return Secrets(**given, pinned=pinned, own=own, excuse=certificates.acceptance_reason(Path(path)))  # type: ignore[arg-type]


def read_writing_secrets(settings: UaSettings, secrets: Secrets, where: str) -> Secrets | None:
    """The same login of the account that writes; None where one account does all. Raises as `read_secrets`."""
    if not settings.writing_user:
        return None
    key = "writing_password_file"
    told = _read_password(settings.writing_password_env, settings.writing_password_file, key, where)
    return replace(secrets, user=settings.writing_user, password=told or "")


def _read_password(variable: str, path: str, key: str, where: str) -> str | None:
    """From a file or the environment; None where neither is named."""
    if path:
        return _read_content(key, path, where).decode("utf-8", errors="replace").strip("\r\n")
    if not variable:
        return None
    found = os.environ.get(variable, "")
    if not found:
        raise ConfigError("E-UA-SECRET-ENV", where, name=shown(variable))
    return found


def client_folder(settings: UaSettings) -> Path:
    """Where this gateway's own certificate and key lie: beside the pinned one unless the settings name a folder."""
    beside = Path(settings.server_certificate).parent / "trueflank-client"
    return Path(settings.client_folder) if settings.client_folder else beside


def _read_content(key: str, path: str, where: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ConfigError("E-UA-SECRET", where, key=key, path=path, why=str(error)) from error


# What an OPC UA server shows before anybody logs in: end points and certificate, and whether it is the pinned one.

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


async def query_offer(url: str, where: str) -> Offer:
    """Get the end points without logging in. Raises the library's errors, ValueError for a broken certificate.

    Raises RemoteProtocolError (E-UA-NO-OFFER) for a server that greets and then opens no channel without security.
    """
    probe = Client(url, timeout=LIBRARY_TIMEOUT_S)
    try:
        await probe.connect_socket()
        await probe.send_hello()
        endpoints, server_utc = await _probe(probe, url, where)
    finally:
        probe.disconnect_socket()
    ours = [end for end in endpoints if _policy(end) in _CLASSES and _encrypts(end)]
    shown = [bytes(end.ServerCertificate) for end in (ours or endpoints) if end.ServerCertificate]
    names = sorted({f"{_policy(end)}/{end.SecurityMode.name.rstrip('_')}" for end in endpoints})
    offered = {_policy(end) for end in ours}
    policies = tuple(name for name in POLICIES if name in offered)
    return Offer(tuple(names), policies, load_certificate(shown[0]) if shown else None, server_utc)


async def _probe(probe: Any, url: str, where: str) -> tuple[list[Any], datetime | None]:
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
        raise no_policy_error(offer, wanted, where)
    if offer.certificate != pinned:
        found, known = fingerprint(offer.certificate), fingerprint(pinned)
        raise DeviceRefused("E-UA-TRUST", where, found=found, pinned=known)
    return policy


def no_policy_error(offer: Offer, wanted: tuple[str, ...], where: str) -> DeviceRefused:
    """The error for a server with none of the wanted policies."""
    offered = ", ".join(offer.security) or "nothing"
    return DeviceRefused("E-UA-POLICY", where, wanted=" or ".join(wanted), offered=offered)


def is_valid_at(certificate: x509.Certificate, now: datetime) -> bool:
    """Whether a certificate is valid at a time."""
    return certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc


def clock_difference(ahead_s: float | None) -> str:
    """How far the server's clock is ahead of ours as an error names it; "?" where it gave no time."""
    return "?" if ahead_s is None else f"{ahead_s:+.0f}"


def expired_error(certificate: x509.Certificate, ahead_s: float | None, where: str) -> DeviceRefused:
    """The error for a server's certificate that is not valid now, with the difference of the clocks."""
    since, until = certificate.not_valid_before_utc.isoformat(), certificate.not_valid_after_utc.isoformat()
    return DeviceRefused("E-UA-EXPIRED", where, since=since, until=until, ahead_s=clock_difference(ahead_s))


async def check_trust(
    secrets: Secrets, ask_: Callable[[], Awaitable[Offer]], now: Callable[[], datetime], where: str
) -> tuple[str, ...]:
    """Compare certificates before anything is entrusted to a server; policies to try in order, "" without security.

    Our own must be valid before anything is sent. The pinned one must be valid now, unless a person accepted it with
    a reason although it is not; that is judged after the server's first answer, which tells its clock. A server that
    answers nobody without a login cannot be asked; then the channel itself must prove the pinned certificate, first
    by the policy that every control has.
    Raises as `check_encoder` and `check_own_certificate`, DeviceRefused (E-UA-EXPIRED), and what ``ask_`` raises.
    """
    if secrets.pinned is None or secrets.own is None:
        return ("",)
    path = secrets.own.certificate
    try:
        own = load_certificate(await asyncio.to_thread(path.read_bytes))
    except (OSError, ValueError) as error:
        given = {"key": "client_folder", "path": path, "why": str(error)}
        raise ConfigError("E-UA-SECRET", where, **given) from error  # type: ignore[arg-type]
    check_own_certificate(own, str(path), now(), where)
    offer = None
    with contextlib.suppress(RemoteProtocolError):
        offer = await ask_()
    if not (is_valid_at(secrets.pinned, now()) or secrets.excuse):
        theirs = offer.server_utc if offer is not None else None
        raise expired_error(secrets.pinned, None if theirs is None else (theirs - now()).total_seconds(), where)
    if offer is None:
        return tuple(reversed(secrets.policies))
    return (check(offer, secrets.pinned, secrets.policies, where),)


def check_own_certificate(own: x509.Certificate, path: str, now: datetime, where: str) -> None:
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


# Channel and session.

T = TypeVar("T")

CLOSE_S = 2.0
SHORTEST_S = 0.5  # how often a server may make us show a sign of life, or renew its channel
_NO_CHANNEL = ("E-UA-TRUST-US", "E-UA-CONNECT")

logging.getLogger("asyncua").addHandler(logging.NullHandler())
# A peer knows our certificate by itself, not by a name of this computer in it: no word of that at each connection.
logging.getLogger("asyncua.crypto.uacrypto").addFilter(lambda record: "in DNSNames" not in str(record.msg))


def node_id(path: str, index: int) -> Any:
    """A node by its identifier in a name space."""
    return ua.NodeId(path, index)


class UaConnection:
    """A login at one server, kept alive, and its requests one at a time."""

    def __init__(self, url: str, clock: Clock, where: str) -> None:
        self._url = url
        self._clock = clock
        self._where = where
        self._lock = asyncio.Lock()
        self._client: Any = None
        self._secrets: Secrets | None = None
        self._alive: asyncio.Task[None] | None = None
        self._renew_at, self._sign_s = 0.0, SESSION_S
        self._why: str | Message = Message.of("W-UA-NEVER-OPEN")
        self._policy = ""
        self._ahead_s: float | None = None
        self._own_uri = ""

    @property
    def ahead_s(self) -> float | None:
        """How far the server's clock was ahead of ours at its first answer, s; None where it gave no time."""
        return self._ahead_s

    @property
    def is_open(self) -> bool:
        """Whether requests can be made."""
        return self._client is not None

    @property
    def policy(self) -> str:
        """The security policy of an open session; "" without."""
        return self._policy if self.is_open else ""

    # ---- opening and closing ------------------------------------------------------------------------

    async def offer(self, timeout_s: float) -> Offer:
        """What the server shows before a login. Raises TransportError (E-UA-CONNECT), RemoteProtocolError."""
        async with self._clock.deadline(timeout_s, self._where):
            return await self._asked()

    async def _asked(self) -> Offer:
        offer = await self._translated("read", Message.of("W-UA-ENDPOINTS"), query_offer(self._url, self._where))
        given = offer.server_utc
        self._ahead_s = None if given is None else (given - self._clock.utc()).total_seconds()
        return offer

    def _told(self, error: TrueflankError) -> TrueflankError:
        """What two clocks or two names differ by belongs to a refusal that speaks of them."""
        if error.code == "E-UA-CLOCK":
            if self._ahead_s is None:
                error.code = "E-UA-CLOCK-UNKNOWN"
            error.fields |= {"ahead_s": clock_difference(self._ahead_s)}
        if error.fields.get("status") in ("BadCertificateUriInvalid", "BadServerUriInvalid"):
            error.code = "E-UA-URI"
            error.fields |= {"sent": APPLICATION_URI, "certificate": self._own_uri or "none", "url": self._url}
        return error

    async def _logged_in(self, secrets: Secrets, policies: Sequence[str]) -> tuple[Any, float]:
        """A client that is logged in, and since when; another policy is tried only where the first got no channel."""
        for place, policy in enumerate(policies, start=1):
            self._policy = policy
            self._client = client = new_client(self._url, secrets)
            opened_at = self._clock.now()
            try:
                await self._translated("login", secrets.user, log_in(client, secrets, policy))
            except TrueflankError as error:
                if place == len(policies) or error.code not in _NO_CHANNEL:
                    raise
            else:
                return client, opened_at
        raise LinkBroken("E-UA-BROKEN", self._where, why=Message.of("W-UA-NO-POLICY"))

    def _note_lifetimes(self, client: Any, since: float) -> None:
        channel_s = typed_values.check_duration(
            client.secure_channel_timeout, Message.of("W-UA-CHANNEL-LIFE"), self._where
        )
        session_s = typed_values.check_duration(client.session_timeout, Message.of("W-UA-SESSION-TIME"), self._where)
        self._renew_at = since + max(0.6 * channel_s, SHORTEST_S)
        self._sign_s = max(0.25 * session_s, SHORTEST_S)

    async def close(self) -> None:
        """Log out if the server still listens, and let go of the wire. Never raises, may be called twice."""
        client, self._client = self._client, None
        alive, self._alive = self._alive, None
        try:
            if alive is not None:
                alive.cancel()
                await asyncio.gather(alive, return_exceptions=True)
            if client is not None:
                with contextlib.suppress(TrueflankError):
                    async with self._clock.deadline(CLOSE_S, self._where):
                        await self._translated("call", "the log-out", log_out(client))
        finally:
            self._why = Message.of("W-UA-WAS-CLOSED")
            if client is not None:
                client.disconnect_socket()
        await self._clock.sleep(0)
        await self._clock.sleep(0)

    def _break(self, why: str | Message) -> None:
        client, self._client, self._why = self._client, None, why
        if client is not None:
            client.disconnect_socket()

    async def _keep_alive(self) -> None:
        """Ask for a sign of life often enough that the server keeps the session; ends with the session."""
        with contextlib.suppress(TrueflankError):
            while self.is_open:
                await self._clock.sleep(self._sign_s)
                await self._request(self._sign_s, "read", Message.of("W-UA-SERVER-STATE"), requests.keep_alive)

    # ---- requests -----------------------------------------------------------------------------------

    async def _request(
        self, timeout_s: float, stage: Stage, what: str | Message, act: Callable[[Any], Awaitable[T]]
    ) -> T:
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            client = self._client
            if client is None:
                raise LinkBroken("E-UA-BROKEN", self._where, why=self._why)
            if self._clock.now() >= self._renew_at:
                await self._translated(stage, Message.of("W-UA-CHANNEL"), self._renew(client))
            return await self._translated(stage, what, act(client))

    async def _renew(self, client: Any) -> None:
        await client.open_secure_channel(renew=True)
        client.uaclient.revolve_security_token()
        self._note_lifetimes(client, self._clock.now())

    async def _translated(self, stage: Stage, what: str | Message, work: Awaitable[T]) -> T:
        """Await the library; turn its errors into ours; break the session where its state became unknown."""
        task = asyncio.current_task()
        before = task.cancelling() if task else 0
        try:
            result = await work
        except ua.UaStatusCodeError as error:
            name = requests.code_name(error.code)
            if stage == "login" or is_lost(name):
                self._break(name)
            raise self._told(status_error(name, self._where, stage, what)) from error
        except TrueflankError:
            self._break("login was refused" if stage == "login" else Message.of("W-UA-SERVER-OTHER"))
            raise
        except asyncio.CancelledError:
            self._break("a request was interrupted")
            raise
        except Exception as error:  # what the library makes of a peer's bytes is no list of types
            self._break(str(error) or type(error).__name__)
            raise translate_error(error, stage, self._where, self._url) from error
        if task is not None and task.cancelling() > before:  # 3.11's wait_for can swallow a cancel
            self._break("a request was interrupted")
            raise asyncio.CancelledError
        return result
