"""What ran while a part was ground, said of the part: wear and heat, which no table takes."""

from __future__ import annotations

from drivers.message import Message, Quantity, fixed
from gateway.evaluate.uncertainty.budget import coverage_factor
from gateway.gear.cycloid import CycloidGear
from gateway.gear.process_drift import ProcessDrift, depth_running, index_running
from gateway.tooth import FlankMap

# Two figures of each of three parts are looked at: one false word in fifty runs or so.
CONFIDENCE = 0.997
LEAST_UM = 0.1  # on the flank; what is smaller is nobody's business


def running_words(flank: FlankMap, gear: CycloidGear) -> tuple[Message, ...]:
    """What of a flank ran on from the first space ground (0) to the last; nothing where that is not sure."""
    depth, index = depth_running(flank, gear), index_running(flank, gear)
    found = (("S-INSPECT-DEPTH-RUNS", depth, 2), ("S-INSPECT-INDEX-RUNS", index, 1))
    return tuple(Message.of(code, **_figures(one, digits)) for code, one, digits in found if sure(one))


def expanded(one: ProcessDrift) -> float:
    """Its expanded uncertainty, at least as sure as `CONFIDENCE` says; infinite where nobody can tell."""
    return coverage_factor(CONFIDENCE, one.freedom) * one.u if one.freedom else float("inf")


def sure(one: ProcessDrift) -> bool:
    """Beyond its uncertainty, and of a size that matters."""
    return abs(one.value) > expanded(one) and one.flank_um > LEAST_UM


def _figures(one: ProcessDrift, digits: int) -> dict[str, Quantity | str]:
    return {
        "value": fixed(one.value, digits, signed=True),
        "U": fixed(expanded(one), digits),
        "flank": fixed(one.flank_um),
    }
