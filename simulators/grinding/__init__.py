"""The cell grinds its part: the wheel's body along the machine's true poses, and the flanks it leaves."""

from simulators.grinding.grinder import Grinder
from simulators.grinding.lobes import Lobes, Rays
from simulators.grinding.work import WorkPiece, clamped

__all__ = ["Grinder", "Lobes", "Rays", "WorkPiece", "clamped"]
