"""What the person at the machine sees and can press or touch: the control, the PLC's panel, the table."""

from __future__ import annotations

from typing import Any, Protocol


class ShownControl(Protocol):
    """What an operator sees on the control's screen and can press on its panel."""

    @property
    def channel_status(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        ...

    @property
    def message(self) -> str:
        """The MSG line."""
        ...

    @property
    def selections(self) -> int:
        """How many programs have been selected so far."""
        ...

    @property
    def selected(self) -> str:
        """The program that is selected."""
        ...

    @property
    def in_alarm(self) -> bool:
        """Whether an alarm stands that RESET clears."""
        ...

    def nc_start(self) -> Any:
        """The green button."""
        ...

    def channel_reset(self) -> Any:
        """The reset button."""
        ...

    def nck_reset(self) -> Any:
        """Restart the NCK."""
        ...

    @property
    def ready(self) -> bool:
        """False while the NCK starts."""
        ...

    def referenced(self, name: str) -> bool:
        """Whether the screen shows the axis as referenced."""
        ...

    def reference_axis(self, name: str) -> Any:
        """Reference run of one axis."""
        ...

    def set_mode(self, mode: str) -> Any:
        """AUTO, JOG or MDA."""
        ...

    def jog(self, name: str, position: float) -> float:
        """Move one axis by hand; seconds it takes."""
        ...


class OperatorPanel(Protocol):
    """The PLC mailbox's lamps and buttons."""

    @property
    def lamp(self) -> bool:
        """Whether the PLC waits for the confirm button."""
        ...

    def confirm(self) -> bool:
        """The confirm button."""
        ...

    @property
    def release_wanted(self) -> bool | None:
        """True: on, please; False: off, please; None: as it is."""
        ...

    def set_release(self, *, given: bool) -> Any:
        """The local release switch."""
        ...

    @property
    def tables_loaded(self) -> int:
        """Tables that came through the PLC so far."""
        ...

    @property
    def acts_from(self) -> str:
        """When changed tables act: newconf, nck_reset or power_on."""
        ...

    async def power_cycle(self) -> None:
        """The main switch off and on."""
        ...


class WorkPlace(Protocol):
    """The table of the machine, where parts are clamped."""

    def load(self) -> bool:
        """Clamp a new blank; False when there is none."""
        ...

    def unload(self) -> bool:
        """Take the part off; False when nothing was there."""
        ...
