"""The doctor of the OPC UA road: from the control's name to the login, then the examination; changes nothing."""

from __future__ import annotations

import asyncio
import os
import stat
from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from drivers.checks import CheckLine, Wanted, failed, fine, unknown, wrong
from drivers.clock import Clock
from drivers.errors import DeviceRefused, TrueflankError
from drivers.sinumerik.opcua.bedside.bed import Bedside
from drivers.sinumerik.opcua.bedside.examination import at_the_bed
from drivers.sinumerik.opcua.bedside.server import CLOCK_LIMIT_S, reads_alone
from drivers.sinumerik.opcua.machine import MachineReader
from drivers.sinumerik.opcua.session.certificates import KeyPair, last_record, load
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.login import Offer, no_policy
from drivers.sinumerik.opcua.session.secrets import secrets_of, writing_of
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.trust import view
from drivers.sinumerik.reach import host_and_port, reach

DEFAULT_PORT = 4840
SOON = timedelta(days=60)


class UaDoctor:
    """Settings as the controller's; every question is a read, a browse, or a call that only tells."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._url = url
        self._clock = clock
        self._settings = UaSettings.first(settings, name)
        self._session = UaSession(url, clock, name)

    async def examine(self, wanted: Wanted, timeout_s: float) -> tuple[CheckLine, ...]:
        """Every line in the order of the road. Where the road ends, the last line says what could not be asked."""
        lines = await self._road(timeout_s)
        if lines[-1].outcome != "ok":
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        lines += await self._trust(timeout_s)
        if self._settings.secured and not self._settings.server_certificate:
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        lines += await self._login(timeout_s)
        if not self._session.is_open:
            return (*lines, unknown("W-DOC-NOT-REACHED", "rest"))
        reader = MachineReader(self._session, self._settings, self.name)
        reader.timeout_s = timeout_s
        try:
            lines += await at_the_bed(
                Bedside(
                    session=self._session,
                    reader=reader,
                    settings=self._settings,
                    wanted=wanted,
                    clock=self._clock,
                    timeout_s=timeout_s,
                    where=self.name,
                )
            )
            if (most := self._session.found_limit) is not None:
                lines.append(fine("W-DOC-REQUEST-SIZE", "variables", most=most))
        finally:
            await self._session.close()
        return tuple(lines)

    async def _road(self, timeout_s: float) -> list[CheckLine]:
        try:
            host, port = host_and_port(self._url, DEFAULT_PORT)
        except ValueError as error:
            return [wrong("E-DOC-NAME", "name", host=self._url, why=str(error))]
        return await reach(host, port, self._clock, timeout_s)

    # ---- before the login ----------------------------------------------------------------------------

    async def _trust(self, timeout_s: float) -> list[CheckLine]:
        try:
            offer = await self._session.offer(timeout_s)
        except TrueflankError as error:
            return [failed(error, "endpoint", "unknown")]
        lines = [fine("W-DOC-ENDPOINT", "endpoint", offered=", ".join(offer.security)), self._policy(offer)]
        lines += self._clocks()
        if self._settings.secured:
            lines += await asyncio.to_thread(self._certificates, offer, self._clock.utc())
        return lines

    def _clocks(self) -> list[CheckLine]:
        """By the first answer, before a login that may fail for it; equal clocks are told after the login."""
        ahead_s = self._session.ahead_s
        if ahead_s is None or abs(ahead_s) <= CLOCK_LIMIT_S:
            return []
        return [wrong("E-DOC-CLOCK", "clock", apart_s=round(ahead_s), limit_s=CLOCK_LIMIT_S)]

    def _policy(self, offer: Offer) -> CheckLine:
        if not self._settings.secured:
            return wrong("E-DOC-NO-SECURITY", "policy", security=self._settings.security)
        policy = offer.best(self._settings.policies)
        if not policy:
            return failed(no_policy(offer, self._settings.policies, self.name), "policy")
        return fine("W-DOC-POLICY", "policy", policy=policy)

    def _certificates(self, offer: Offer, now: datetime) -> list[CheckLine]:
        place = Path(self._settings.server_certificate)
        if offer.certificate is None:
            return [unknown("W-DOC-NO-CERTIFICATE", "certificate")]
        if not self._settings.server_certificate:
            shown = view(offer.certificate)
            return [wrong("E-DOC-NO-CERTIFICATE", "certificate", sha256=shown.sha256, sha1=shown.sha1)]
        if not place.is_file():
            return [wrong("E-UA-UNPINNED", "certificate", path=place)]
        try:
            pinned = load(place.read_bytes())
        except (OSError, ValueError) as error:
            given = {"key": "server_certificate", "path": place, "why": error}
            return [wrong("E-UA-SECRET", "certificate", **given)]
        shown = view(offer.certificate)
        if offer.certificate != pinned:
            return [wrong("E-UA-TRUST", "certificate", found=shown.sha256, pinned=view(pinned).sha256)]
        accepted = last_record(place)
        who = f"{accepted['who']} at {str(accepted['utc'])[:19]} UTC" if accepted else "a person not recorded"
        line = fine(
            "W-DOC-CERTIFICATE", "certificate", thumbprint=shown.sha256, until=shown.valid_until.date(), who=who
        )
        judged = _valid(line, now, shown.valid_from, shown.valid_until)
        if accepted.get("reason"):
            told = fine("W-DOC-EXCUSED", "certificate", who=who, reason=accepted["reason"])
            return [line if judged.code == "E-DOC-EXPIRED" else judged, told]
        return [judged]

    # ---- the login ------------------------------------------------------------------------------------

    async def _login(self, timeout_s: float) -> list[CheckLine]:
        """Our own certificate, then the login; the session is open afterwards if all of it went well."""
        lines: list[CheckLine] = []
        try:
            secrets = await asyncio.to_thread(secrets_of, self._settings, self.name)
            if secrets.own is not None:
                lines += await asyncio.to_thread(_own, secrets.own, self._clock.utc())
            await self._session.open(secrets, timeout_s)
            lines.append(self._logged_in(self._settings.user))
            writing = await asyncio.to_thread(writing_of, self._settings, secrets, self.name)
            if writing is not None:
                lines += await reads_alone(self._session, timeout_s)
                await self._session.open(writing, timeout_s)
                lines.append(self._logged_in(writing.user))
        except TrueflankError as error:
            return [*lines, failed(error, _part_of_login(error))]
        return lines

    def _logged_in(self, user: str) -> CheckLine:
        return fine("W-DOC-LOGIN", "login", user=user or "(anonymous)", policy=self._session.policy or "None")


def _own(pair: KeyPair, now: datetime) -> list[CheckLine]:
    own = view(load(pair.certificate.read_bytes()))
    line = fine("W-DOC-OWN", "own certificate", thumbprint=own.sha1, until=own.valid_until.date())
    lines = [_valid(line, now, own.valid_from, own.valid_until)]
    return [*lines, wrong("E-DOC-KEY-OPEN", "own certificate", path=pair.key)] if _is_open(pair) else lines


def _valid(line: CheckLine, now: datetime, since: datetime, until: datetime) -> CheckLine:
    """The line itself while the certificate holds for long enough."""
    if not since <= now <= until:
        given = {"since": since.isoformat(), "until": until.isoformat(), "now": now.isoformat(timespec="seconds")}
        return wrong("E-DOC-EXPIRED", line.check, **given)
    return line if until - now > SOON else wrong("E-DOC-EXPIRES", line.check, days=(until - now).days)


def _is_open(pair: KeyPair) -> bool:
    """Whether others may read the private key, where the system can tell."""
    return os.name == "posix" and bool(stat.S_IMODE(pair.key.stat().st_mode) & 0o077)


def _part_of_login(error: TrueflankError) -> str:
    if error.code == "E-UA-NAMESPACE":
        return "namespace"
    if isinstance(error, DeviceRefused) and error.code in ("E-UA-TRUST", "E-UA-POLICY", "E-UA-EXPIRED"):
        return "certificate"
    return "own certificate" if error.code in ("E-UA-TRUST-US", "E-UA-OWN-EXPIRED") else "login"
