"""Which server certificate is trusted: shown, and pinned by a person who typed its thumbprint, never otherwise."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.checks import CertificateView, TrustView
from drivers.clock import Clock
from drivers.errors import ConfigError, DeviceRefused
from drivers.local.ownfiles import made_parents, opened
from drivers.sinumerik.opcua.session import certificates
from drivers.sinumerik.opcua.session.certificates import load
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.login import Offer, no_policy
from drivers.sinumerik.opcua.session.secrets import APPLICATION_URI, client_folder
from drivers.sinumerik.opcua.settings import UaSettings


class UaTrust:
    """Trust of one site's server; settings as the controller's, the pinned file is ``server_certificate``."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._url = url
        self._clock = clock
        self._settings = UaSettings.read(settings, name)
        if not self._settings.secured:
            raise ConfigError("E-TRUST-NO-SECURITY", name, security=self._settings.security)

    async def show(self, timeout_s: float) -> TrustView:
        """What the server shows now beside what is pinned. Nothing changes.

        Raises TransportError (E-UA-CONNECT), DeadlineExceeded, DeviceRefused (E-UA-POLICY), RemoteProtocolError.
        """
        return await asyncio.to_thread(self._view, await self._shown(timeout_s))

    async def accept(self, thumbprint: str, who: str, timeout_s: float) -> TrustView:
        """Pin the certificate that the server shows now, if it is the one whose thumbprint was typed.

        The old one is kept beside it; who accepted which and when is added to a record in the same folder.
        Raises as `show`, DeviceRefused (E-TRUST-OTHER, E-UA-EXPIRED), ConfigError (E-UA-SECRET).
        """
        certificate = await self._shown(timeout_s)
        shown = view(certificate)
        if not shown.is_called(thumbprint):
            raise DeviceRefused("E-TRUST-OTHER", self.name, typed=thumbprint or "nothing", shown=shown.sha256)
        if not shown.valid_from <= self._clock.utc() <= shown.valid_until:
            since, until = shown.valid_from.isoformat(), shown.valid_until.isoformat()
            raise DeviceRefused("E-UA-EXPIRED", self.name, since=since, until=until)
        try:
            await asyncio.to_thread(self._pin, certificate, who, self._clock.utc())
        except OSError as error:
            key, path = "server_certificate", self._settings.server_certificate
            raise ConfigError("E-UA-SECRET", self.name, key=key, path=path, why=str(error)) from error
        return await asyncio.to_thread(self._view, certificate)

    async def _shown(self, timeout_s: float) -> x509.Certificate:
        offer: Offer = await UaSession(self._url, self._clock, self.name).offer(timeout_s)
        if not offer.best(self._settings.policies) or offer.certificate is None:
            raise no_policy(offer, self._settings.policies, self.name)
        return offer.certificate

    def _view(self, shown: x509.Certificate) -> TrustView:
        place = Path(self._settings.server_certificate)
        folder = client_folder(self._settings)
        own = certificates.own_key_pair(folder, "trueflank", APPLICATION_URI, "localhost").certificate
        last = last_record(place)
        return TrustView(
            url=self._url,
            shown=view(shown),
            pinned=view(load(place.read_bytes())) if place.is_file() else None,
            place=str(place),
            own=view(load(own.read_bytes())),
            accepted_by=str(last.get("who", "")),
            accepted_utc=str(last.get("utc", "")),
        )

    def _pin(self, certificate: x509.Certificate, who: str, now: datetime) -> None:
        place = Path(self._settings.server_certificate)
        made_parents(place)
        before = view(load(place.read_bytes())).sha256 if place.is_file() else ""
        if before:
            place.replace(place.with_name(f"{place.name}.old-{before.replace(':', '')[:16]}"))
        fresh = place.with_name(f".{place.name}.new")
        _store(fresh, certificate.public_bytes(Encoding.DER), "wb")
        fresh.replace(place)
        record = {"utc": now.isoformat(), "who": who, "url": self._url}
        record |= {"accepted": view(certificate).sha256, "before": before}
        _store(record_of(place), (json.dumps(record) + "\n").encode(), "ab")


def view(certificate: x509.Certificate) -> CertificateView:
    """A certificate as people compare it."""
    return CertificateView(
        subject=certificate.subject.rfc4514_string(),
        sha256=certificates.fingerprint(certificate),
        sha1=certificates.short_fingerprint(certificate),
        valid_from=certificate.not_valid_before_utc,
        valid_until=certificate.not_valid_after_utc,
    )


def record_of(place: Path) -> Path:
    """Where it is written down who accepted what, one JSON object a line."""
    return place.with_name(f"{place.name}.accepted.jsonl")


def last_record(place: Path) -> dict[str, Any]:
    """Of the certificate pinned now; empty when it was put there by other means."""
    path = record_of(place)
    if not path.is_file() or not place.is_file():
        return {}
    pinned = view(load(place.read_bytes())).sha256
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    return next((record for record in reversed(records) if record.get("accepted") == pinned), {})


def _store(path: Path, content: bytes, mode: str) -> None:
    with opened(path, mode) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
