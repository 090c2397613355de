"""The gateway as a service: devices opened and watched, pages and stream served, one command at a time a site."""

from __future__ import annotations

from gateway.daemon.beginning import begin
from gateway.daemon.daily import Daily
from gateway.daemon.desk import Devices
from gateway.daemon.jobs import RunStarter
from gateway.daemon.late import LateDevices
from gateway.daemon.served import ServedPlace, Serving
from gateway.daemon.serving import serve, service_of

__all__ = ["Daily", "Devices", "LateDevices", "RunStarter", "ServedPlace", "Serving", "begin", "serve", "service_of"]
