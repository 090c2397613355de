"""The cell grinds its part: the wheel's body along the machine's true poses, and the flanks it leaves."""

from simulators.grinding.grinder import Grinder
from simulators.grinding.workpiece import CycloidDisc, Rays, WorkPiece, draw_clamping

__all__ = ["CycloidDisc", "Grinder", "Rays", "WorkPiece", "draw_clamping"]
