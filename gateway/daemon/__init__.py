"""The gateway as a service: devices opened and watched, the page served, one run at a time on command."""

from __future__ import annotations

from gateway.daemon.daily import Daily
from gateway.daemon.desk import Devices, RunStarter
from gateway.daemon.serving import serve
from gateway.daemon.token import token_path

__all__ = ["Daily", "Devices", "RunStarter", "serve", "token_path"]
