"""Modbus/TCP Security: the same frames inside TLS, both ends with certificates (MB-TCP-Security V3.6)."""

from __future__ import annotations

from pathlib import Path

from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.transport import TlsFiles


def certificates(settings: ModbusSettings) -> TlsFiles | None:
    """Whom we trust and who we are; None: plain Modbus."""
    if not settings.secured:
        return None
    own, key = Path(settings.client_certificate), Path(settings.client_key_file)
    return TlsFiles(Path(settings.server_certificate), own, key, settings.server_name)
