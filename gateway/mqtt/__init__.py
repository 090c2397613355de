"""What the service tells other systems by MQTT: it publishes and subscribes to nothing, so nothing comes in this way.

Messages lie in a bounded queue on the disk until the server of messages has confirmed them. What the queue ever dropped
is counted, and each message carries the count.
"""

from __future__ import annotations

from gateway.mqtt.messages import KINDS, kept_of, pared
from gateway.mqtt.publishing import Outgoing, Publish, Publisher
from gateway.mqtt.spool import Spool

__all__ = ["KINDS", "Outgoing", "Publish", "Publisher", "Spool", "kept_of", "pared"]
