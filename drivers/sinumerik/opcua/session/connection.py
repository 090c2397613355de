"""The secure channel and the session on it: logging in, one request at a time, and what ends them.

With `login` and `requests` the one place that knows asyncua.
asyncua's own reconnecting, watching and trusting are not used: a request that failed or was interrupted
leaves the session broken and the next call says so, because what the server did meanwhile is unknown; the
server's certificate must be the pinned one.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, TypeVar

from asyncua import ua

from drivers.clock import Clock
from drivers.errors import LinkBroken, TrueflankError
from drivers.sinumerik.opcua.session import login, requests
from drivers.sinumerik.opcua.session import values as typed_values
from drivers.sinumerik.opcua.session.login import SESSION_S, Offer, apart
from drivers.sinumerik.opcua.session.secrets import APPLICATION_URI, Secrets
from drivers.sinumerik.opcua.session.status import Stage, foreign, is_lost, refusal

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
        self._why = "it was never opened"
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
        offer = await self._translated("read", "the end points", login.ask(self._url, self._where))
        given = offer.server_utc
        self._ahead_s = None if given is None else (given - self._clock.utc()).total_seconds()
        return offer

    def _told(self, error: TrueflankError) -> TrueflankError:
        """What two clocks or two names differ by belongs to a refusal that speaks of them."""
        if error.code == "E-UA-CLOCK":
            if self._ahead_s is None:
                error.code = "E-UA-CLOCK-UNKNOWN"
            error.fields |= {"ahead_s": apart(self._ahead_s)}
        if error.fields.get("status") in ("BadCertificateUriInvalid", "BadServerUriInvalid"):
            error.code = "E-UA-URI"
            error.fields |= {"sent": APPLICATION_URI, "certificate": self._own_uri or "none", "url": self._url}
        return error

    async def _logged_in(self, secrets: Secrets, policies: Sequence[str]) -> tuple[Any, float]:
        """A client that is logged in, and since when; another policy is tried only where the first got no channel."""
        for place, policy in enumerate(policies, start=1):
            self._policy = policy
            self._client = client = login.new_client(self._url, secrets)
            opened_at = self._clock.now()
            try:
                await self._translated("login", secrets.user, login.log_in(client, secrets, policy))
            except TrueflankError as error:
                if place == len(policies) or error.code not in _NO_CHANNEL:
                    raise
            else:
                return client, opened_at
        raise LinkBroken("E-UA-BROKEN", self._where, why="no policy to log in with")

    def _note_lifetimes(self, client: Any, since: float) -> None:
        channel_s = typed_values.lasting_s(client.secure_channel_timeout, "the secure channel's lifetime", self._where)
        session_s = typed_values.lasting_s(client.session_timeout, "the session's timeout", self._where)
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
                        await self._translated("call", "the log-out", login.log_out(client))
        finally:
            self._why = "it was closed"
            if client is not None:
                client.disconnect_socket()
        await self._clock.sleep(0)
        await self._clock.sleep(0)

    def _break(self, why: str) -> None:
        client, self._client, self._why = self._client, None, why
        if client is not None:
            client.disconnect_socket()

    async def _keep_alive(self) -> None:
        """Ask for a sign of life often enough that the server keeps the session; ends with the session."""
        with contextlib.suppress(TrueflankError):
            while self.is_open:
                await self._clock.sleep(self._sign_s)
                await self._request(self._sign_s, "read", "the server's state", requests.sign_of_life)

    # ---- requests -----------------------------------------------------------------------------------

    async def _request(self, timeout_s: float, stage: Stage, what: str, act: Callable[[Any], Awaitable[T]]) -> T:
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            client = self._client
            if client is None:
                raise LinkBroken("E-UA-BROKEN", self._where, why=self._why)
            if self._clock.now() >= self._renew_at:
                await self._translated(stage, "the secure channel", self._renew(client))
            return await self._translated(stage, what, act(client))

    async def _renew(self, client: Any) -> None:
        await client.open_secure_channel(renew=True)
        client.uaclient.revolve_security_token()
        self._note_lifetimes(client, self._clock.now())

    async def _translated(self, stage: Stage, what: str, work: Awaitable[T]) -> T:
        """Await the library; turn its errors into ours; break the session where its state became unknown."""
        task = asyncio.current_task()
        before = task.cancelling() if task else 0
        try:
            result = await work
        except ua.UaStatusCodeError as error:
            name = requests.code_name(error.code)
            if stage == "login" or is_lost(name):
                self._break(name)
            raise self._told(refusal(name, self._where, stage, what)) from error
        except TrueflankError:
            self._break("login was refused" if stage == "login" else "the server is not as expected")
            raise
        except asyncio.CancelledError:
            self._break("a request was interrupted")
            raise
        except Exception as error:  # what the library makes of a peer's bytes is no list of types
            self._break(str(error) or type(error).__name__)
            raise foreign(error, stage, self._where, self._url) from error
        if task is not None and task.cancelling() > before:  # 3.11's wait_for can swallow a cancel
            self._break("a request was interrupted")
            raise asyncio.CancelledError
        return result
