"""The PLC mailbox as the person at the machine sees it: a lamp, a button, a release switch, the main switch."""

from __future__ import annotations

from simulators.modbus import PlcStation


class MailboxPanel:
    """Lamps and buttons of one PLC."""

    def __init__(self, station: PlcStation) -> None:
        self._station = station
        self._plc = station.plc

    @property
    def lamp(self) -> bool:
        """Whether the PLC waits for the local confirm."""
        return self._plc.waiting

    def confirm(self) -> bool:
        """The confirm button; False when nothing waited for it."""
        return self._plc.confirm()

    @property
    def release_wanted(self) -> bool | None:
        """True: a session is open and no release counts in it; False: the release stayed on after it; else None."""
        if self._plc.session:
            return None if self._plc.release.counts else True
        return False if self._plc.release.on else None

    def set_release(self, *, given: bool) -> None:
        """The release switch, off and on again where it was left on."""
        if given:
            self._plc.release.give()
        else:
            self._plc.release.set(False)

    @property
    def tables_loaded(self) -> int:
        """How many tables have gone into the control through the PLC so far."""
        return self._plc.loads_done

    @property
    def acts_from(self) -> str:
        """When changed tables act, as people know it of this control: newconf, nck_reset or power_on."""
        return self._plc.nck.spec.acts_from

    async def power_cycle(self) -> None:
        """The main switch, off and on: PLC and NCK."""
        await self._station.power_cycle()
