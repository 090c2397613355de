"""Raw averages or a result file -> a Capture: sense, air, expansion and dead path applied once; pure."""

from __future__ import annotations
