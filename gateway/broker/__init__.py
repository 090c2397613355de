"""One broker of devices: while a gateway serves a site, a command asks it for the devices and gives them back.

The command works itself, as it does without a service: its output and its exit codes are the same. What it says is
heard by the broker, so that everybody sees one truth. Only who opens devices for a command calls this room.
"""

from __future__ import annotations

from gateway.broker.borrowing import borrowed, taking
from gateway.broker.lending import Broker, Lease
from gateway.broker.lock import locked
from gateway.broker.notice import BrokerNotice, notice_of
from gateway.broker.token import token_of, token_path

__all__ = ["Broker", "BrokerNotice", "Lease", "borrowed", "locked", "notice_of", "taking", "token_of", "token_path"]
