"""One conversation with one device: questions and answers in order, news beside them, broken means broken."""

from __future__ import annotations

from drivers.link.conversation import Codec, Link, Trace
from drivers.link.feed import Feed

__all__ = ["Codec", "Feed", "Link", "Trace"]
