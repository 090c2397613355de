"""The release at the panel: the PLC counts it only if a person gave it after our session began."""

from __future__ import annotations

from typing import Any

from drivers.clock import Clock
from drivers.errors import DeviceRefused
from drivers.sinumerik.mailbox.codec.readings import Status
from drivers.sinumerik.mailbox.codec.registers import StatusBit
from drivers.sinumerik.mailbox.conversation import Talk
from drivers.sinumerik.mailbox.settings import ModbusSettings


class Consent:
    """Enters a session and waits for its release; knows whether one was given in the session that is open."""

    def __init__(self, talk: Talk, settings: ModbusSettings, clock: Clock, where: str) -> None:
        self._talk = talk
        self._settings = settings
        self._clock = clock
        self._where = where
        self._given_in = 0

    @property
    def given(self) -> bool:
        """Whether a release was seen in the session that is open, however long ago."""
        return bool(self._talk.session) and self._given_in == self._talk.session

    def permits_off(self, status: Status) -> bool:
        """Whether command 6 would be taken: given in this session and not taken back, however long ago."""
        return status.has(StatusBit.RELEASED) or (self.given and status.has(StatusBit.RELEASE_STALE))

    async def enter(self) -> None:
        """A session of ours in which a release counts; a person has `ModbusSettings.release_s` for it.

        Raises as `Talk.enter`, DeviceRefused (E-MBX-NO-RELEASE, E-MBX-RELEASE-STALE); a session that was opened for it
        is closed then.
        """
        ours = self._talk.session
        await self._talk.enter()
        try:
            await self._wait()
        except BaseException:
            if not ours:
                await self._talk.leave()
            raise

    async def _wait(self) -> None:
        end = self._clock.now() + self._settings.release_s
        while not (status := await self._talk.status()).has(StatusBit.RELEASED):
            if self._clock.now() >= end:
                told: dict[str, Any] = {"limit_s": round(self._settings.release_s)}
                stale = status.has(StatusBit.RELEASE_STALE)
                raise DeviceRefused("E-MBX-RELEASE-STALE" if stale else "E-MBX-NO-RELEASE", self._where, **told)
            await self._clock.sleep(self._settings.poll_s)
        self._given_in = self._talk.session
