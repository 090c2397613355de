"""Grinding: the wheel's body moves along the machine's true poses, and what it leaves is the part's surface."""

from simulators.grinding.grinder import Grinder
from simulators.grinding.workpiece import CycloidDisc, Rays, WorkPiece, draw_clamping

__all__ = ["CycloidDisc", "Grinder", "Rays", "WorkPiece", "draw_clamping"]
