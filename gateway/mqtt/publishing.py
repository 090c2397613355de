"""Keeps what happens in the queue and sends it, one after another, as often as the server comes back."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from gateway.mqtt.messages import KINDS, VERSION, kept_of, pared
from gateway.mqtt.spool import Spool, Waiting

BEAT_S = 60.0
LONGEST_PAUSE_S = 60.0
LEAVE_S = 0.3
MOST_UNKEPT = 10_000
_LOG = logging.getLogger("trueflank.mqtt")
Data = Mapping[str, Any] | Callable[[], Mapping[str, Any]]


class Publish(Protocol):
    """Publish one message; returns when the server has confirmed it. Raises LinkBroken (E-MQTT-AWAY)."""

    def __call__(self, topic: str, payload: bytes, *, stays: bool) -> Awaitable[None]: ...


Connect = Callable[[], AbstractAsyncContextManager[Publish]]


@dataclass(frozen=True, slots=True)
class Outgoing:
    """How it stands: whether the server answers, how many messages wait, were confirmed, were ever dropped."""

    connected: bool
    queued: int
    confirmed: int
    dropped: int


class Publisher:
    """One site's way out. ``connect`` opens a connection; ``prefix`` is what its topics begin with."""

    def __init__(self, site: str, prefix: str, spool: Spool, *, clock: Clock, connect: Connect) -> None:
        self._site, self._topic = site, f"{prefix}/v{VERSION}/{site}/"
        self._spool, self._clock, self._connect = spool, clock, connect
        self._unkept: deque[tuple[str, str, Data]] = deque()
        self._overrun = 0
        self._news, self._kept = asyncio.Event(), asyncio.Event()
        self._connected = False
        self._keeping = threading.Lock()

    @property
    def standing(self) -> Outgoing:
        """How it stands now."""
        waiting, overrun = len(self._unkept), self._overrun
        spool = self._spool
        return Outgoing(self._connected, spool.queued + waiting, spool.confirmed, spool.dropped + overrun)

    def take(self, kind: str, data: Data) -> None:
        """Something happened; returns at once. ``data`` that must be read first is a call, made in a thread."""
        if kind not in KINDS:
            return
        if len(self._unkept) >= MOST_UNKEPT:
            self._unkept.popleft()
            self._overrun += 1
        self._unkept.append((kind, self._clock.utc().isoformat(timespec="milliseconds"), data))
        self._news.set()

    async def work(self) -> None:
        """Keep and send, for ever; a fault of one ends both."""
        try:
            async with asyncio.TaskGroup() as both:
                both.create_task(self._keep())
                both.create_task(self._send())
        finally:
            with contextlib.suppress(TrueflankError):
                self._keep_now()  # the last words of a service that ends

    async def _keep(self) -> None:
        told = ""
        while True:
            self._news.clear()
            try:
                await asyncio.to_thread(self._keep_now)
                told = ""
            except TrueflankError as error:
                if str(error) != told:
                    _LOG.warning("%s", error)
                told = str(error)
                await self._clock.sleep(BEAT_S)
            self._kept.set()
            if not self._unkept:
                await self._news.wait()

    def _keep_now(self) -> None:
        if self._overrun:
            self._spool.lose(self._overrun)
            self._overrun = 0
        with self._keeping:  # a thread that was cancelled goes on to its end
            while self._unkept:
                first = self._unkept.popleft()
                try:
                    self._keep_one(*first)
                except TrueflankError:
                    self._unkept.appendleft(first)
                    raise

    def _keep_one(self, kind: str, utc: str, data: Data) -> None:
        told = {"version": VERSION, "site": self._site, "kind": kind, "utc": utc}
        told["data"] = pared(kind, data() if callable(data) else data)
        self._spool.put([(self._topic + kind, kept_of(kind), told)])

    async def _send(self) -> None:
        pause, told = 1.0, False
        while True:
            try:
                async with self._connect() as publish:
                    await self._say(publish, online=True)
                    if told:
                        _LOG.info("the MQTT broker accepts messages again, %d waited", self._spool.queued)
                    pause, told = 1.0, False
                    self._connected = True
                    try:
                        await self._send_all(publish)
                    except asyncio.CancelledError:
                        await self._leave(publish)
                        raise
            except TrueflankError as error:
                if not told:
                    _LOG.warning("%s", error)
                told = True
            finally:
                self._connected = False
            await self._clock.sleep(pause)
            pause = min(1.8 * pause, LONGEST_PAUSE_S)

    async def _send_all(self, publish: Publish) -> None:
        while True:
            self._kept.clear()
            for one in (batch := await asyncio.to_thread(self._spool.next)):
                await publish(one.topic, self._payload(one), stays=one.stays)
            if batch:
                await asyncio.to_thread(self._spool.confirm, batch[-1].number)
                continue
            try:
                async with self._clock.deadline(BEAT_S, "mqtt"):
                    await self._kept.wait()
            except DeadlineExceeded:
                await self._say(publish, online=True)

    async def _leave(self, publish: Publish) -> None:
        """Who goes in order leaves no will: say it ourselves, if it goes quickly."""
        with contextlib.suppress(TrueflankError):
            async with self._clock.deadline(LEAVE_S, "mqtt"):
                await self._say(publish, online=False)

    def _payload(self, one: Waiting) -> bytes:
        told = {**one.data, "number": one.number, "dropped": self._spool.dropped}
        return json.dumps(told).encode("utf-8")

    async def _say(self, publish: Publish, *, online: bool) -> None:
        await publish(self._topic + "online", self.online(online=online), stays=True)

    def online(self, *, online: bool) -> bytes:
        """The message about ourselves, which is never queued; ``online`` false is left with the server as our will."""
        return json.dumps({"version": VERSION, "site": self._site, "kind": "online", "online": online}).encode("utf-8")

    @property
    def will(self) -> tuple[str, bytes]:
        """What the server says when we are gone."""
        return self._topic + "online", self.online(online=False)
