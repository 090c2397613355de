"""Whether a double stood in for the machine or an instrument, by the words of a result file."""

from __future__ import annotations

from drivers.types.results import MeasuredSet

DOUBLE = "simulated"
SAID = "SIMULATED: a simulated device took part; this is no measurement of a real machine"


def simulated_set(measured: MeasuredSet) -> bool:
    """Whether a result file's own words name a double, as every file that is exported from such a run does."""
    return any(DOUBLE in text.lower() for text in measured.header.values())
