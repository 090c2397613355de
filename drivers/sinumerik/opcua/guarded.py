"""Programs that know where axes may stand: guards from how the axes stand now, and what the last one moves."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.sinumerik.ncprogram.grinding import placed
from drivers.sinumerik.ncprogram.guarding import Guard, going, guards_of
from drivers.sinumerik.opcua.dialogue import Dialogue
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.sinumerik.standing import KeepsPlaces
from drivers.units import AxisUnit
from drivers.workpiece import GrindPlan


class GuardsPrograms(KeepsPlaces):
    """The part of the driver that does this; it shares dialogue and transfer with the others."""

    _dialogue: Dialogue
    _transfer: Transfer

    async def _guards(self, *moved: str) -> tuple[Guard, ...]:
        """Of every axis that is not ``moved`` and stands in its safe place now. Raises as `state`."""
        if not self.places.ranges:
            return ()
        stands = (await self.motion()).stands
        return guards_of(self.places, self._dialogue.names, {one.axis for one in stands if one.safe} - set(moved))

    def _all_guards(self) -> tuple[Guard, ...]:
        """Of every axis that has a safe place."""
        return guards_of(self.places, self._dialogue.names, self.places.ranges)

    def _grinds(self, plan: GrindPlan, units: Mapping[str, AxisUnit]) -> None:
        """As `_goes`, of the program of a plan with its set-up values."""
        self._goes({one.letter: (one.name, units.get(one.name, "mm")) for one in plan.axes}, placed(plan))

    def _goes(self, axes: Mapping[str, tuple[str, AxisUnit]], values: Mapping[str, float] | None = None) -> None:
        """What the program that was sent just now moves; arguments as of `going`."""
        self.going = going(self._transfer.text, axes, values)
