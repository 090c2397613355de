"""What the service tells other systems by MQTT: it publishes and subscribes to nothing, so nothing comes in this way.

Messages lie in a bounded queue on the disk until the server of messages has confirmed them. What the queue ever dropped
is counted, and each message carries the count.
"""

from __future__ import annotations

from gateway.mqtt.connecting import connected
from gateway.mqtt.messages import KINDS, kept_of, pared
from gateway.mqtt.publishing import Outgoing, Publisher
from gateway.mqtt.spool import Spool

__all__ = ["KINDS", "Outgoing", "Publisher", "Spool", "connected", "kept_of", "pared"]
