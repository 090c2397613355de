"""One conversation with one device: questions and answers in order, news beside them, broken means broken."""

from __future__ import annotations

from drivers.link.conversation import Codec, Link, Trace
from drivers.link.feed import Feed
from drivers.link.settings import read_settings, wrong_setting

__all__ = ["Codec", "Feed", "Link", "Trace", "read_settings", "wrong_setting"]
