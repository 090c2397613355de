"""One broker of devices: while a gateway serves a site, a command asks it for the devices and gives them back.

The command works itself, as it does without a service: its output and its exit codes are the same. What it says is
heard by the broker, so that everybody sees one truth. Only who opens devices for a command calls this package.
"""

from __future__ import annotations

from gateway.broker.borrowing import borrow_devices, devices_are_own, take_from_hung_gateway
from gateway.broker.lending import Broker, BrokerNotice, Lease, notice_of
from gateway.broker.state_folder import hold_folder_lock, token_of, token_path

__all__ = [
    "Broker",
    "BrokerNotice",
    "Lease",
    "borrow_devices",
    "devices_are_own",
    "hold_folder_lock",
    "notice_of",
    "take_from_hung_gateway",
    "token_of",
    "token_path",
]
