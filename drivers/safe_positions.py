"""The site's safe places as a driver keeps them, and what it says of the program that waits for NC START."""

from __future__ import annotations

from abc import ABC, abstractmethod

from drivers.types.machine import MachineState
from drivers.types.moves import Going, Movement, SafePlaces, movement_of


class SafePositionMixin(ABC):
    """A controller that knows where axes may stand. ``going`` is what the program that was sent last will move."""

    places: SafePlaces = SafePlaces()
    going: tuple[Going, ...] = ()

    @abstractmethod
    async def state(self) -> MachineState:
        """As `Controller.state`."""

    def keep_to(self, places: SafePlaces) -> None:
        """From now on programs are guarded by these places and compensation moves go at these feeds."""
        self.places = places

    async def motion(self) -> Movement:
        """What the selected program will move, and where all axes stand now. Raises as `state`."""
        return movement_of(self.going, await self.state(), self.places)
