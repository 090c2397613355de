"""What the PLC shows of the machine: status word and the registers that follow the NCK and the selected table."""

from __future__ import annotations

from collections.abc import Callable

from simulators.modbus import registers as r
from simulators.modbus.access import NckAccess
from simulators.modbus.target import BACKLASH_KIND, CEC, EEC, Target

READY, BUSY, DONE, FAILED, IN_RESET, STANDSTILL, REFERENCED, RELEASED = (1 << bit for bit in range(8))
ALARM, EEC_ON, CEC_ON, MAY_WRITE, WAITING, STALE = (1 << bit for bit in range(8, 14))
_MODES = {"JOG": 0, "MDA": 1, "AUTO": 2}
_NEEDED = READY | IN_RESET | STANDSTILL | RELEASED


class PlcPicture:
    """Fills registers from the NCK. ``switches`` and ``is_off`` speak of a table as the PLC wants it seen."""

    def __init__(self, access: NckAccess, switches: Callable[[Target], int], is_off: Callable[[Target], bool]) -> None:
        self._access = access
        self._switches = switches
        self._is_off = is_off

    def machine_bits(self, released: bool) -> int:
        """Bits 0 and 4..8 of the status word."""
        access = self._access
        facts = (
            (access.ready, READY),
            (access.in_reset, IN_RESET),
            (access.standstill, STANDSTILL),
            (access.referenced, REFERENCED),
            (released, RELEASED),
            (bool(access.first_alarm), ALARM),
        )
        return sum(bit for holds, bit in facts if holds)

    def table_bits(self, target: Target | None, bits: int) -> int:
        """Bits 9..11; ``bits`` are the machine's."""
        if target is None:
            return 0
        switches = self._switches(target)
        found = EEC_ON if switches & 1 else 0
        if target.kind == CEC and switches & 2 and switches & 4:
            found |= CEC_ON
        may = target.kind in (EEC, CEC, BACKLASH_KIND) and bits & _NEEDED == _NEEDED and self._is_off(target)
        return found | (MAY_WRITE if may else 0)

    def show_machine(self, image: r.Image) -> None:
        """Registers that need no selection."""
        access, nck = self._access, self._access.nck
        image.words[r.UNITS] = int(bool(nck.get("$MN_SCALING_SYSTEM_IS_METRIC")))
        image.words[r.LEVEL] = nck.access_level
        image.put(r.SERIAL, r.text_words(nck.spec.told[0], 16))
        image.put(r.NCK_VERSION, r.text_words(nck.spec.told[1], 8))
        image.put(r.AXES, (max(access.axes), access.tables))
        image.put_dint(r.ALARM, access.first_alarm)
        image.words[r.MODE] = _MODES.get(nck.mode, 255)
        image.put_dint(r.AXIS_MAP, sum(1 << (number - 1) for number in access.axes))

    def show_selection(self, image: r.Image, target: Target | None) -> None:
        """Registers of the selected axis and table; all 0 while nothing is selected."""
        for first, behind in (
            (r.POSITION, r.UNITS),
            (r.AXIS_NAME, r.MARKER),
            (r.SELECTED, r.ALARM),
            (r.ENCODERS, r.SIZE),
        ):
            image.put(first, [0] * (behind - first))
        if target is None:
            return
        self._show_axis(image, target)
        if target.kind in (EEC, CEC):
            self._show_table(image, target)

    def _show_axis(self, image: r.Image, target: Target) -> None:
        access, axis = self._access, target.axis
        spec, view = access.axis(axis), access.nck.axis_state(access.axis(axis).name)
        eec = access.value(f"$VA_ENC{target.encoder + 1}_COMP_VAL[", axis)
        cec = access.value("$VA_CEC_COMP_VAL[", axis)
        image.put_dint(r.POSITION, access.value("$VA_IM[", axis, position=True))
        image.put_dint(r.ACTING, {EEC: eec, CEC: cec}.get(target.kind, 0))
        image.put(r.AXIS_NAME, r.text_words(spec.name, 8))
        image.put(r.SELECTED, (target.kind, target.index, target.encoder, axis))
        referenced = access.referenced_by(axis, target.encoder)
        acting = (access.acts_by(axis, encoder) for encoder in (0, 1))
        facts = (spec.rotary, spec.modulo, referenced, view.aa_stat == 4, access.stands(axis), *acting)
        image.words[r.AXIS_BITS] = sum(1 << bit for bit, holds in enumerate(facts) if holds)
        image.words[r.SWITCHES] = self._switches(target)
        image.put_dint(r.EEC_ACTING, eec)
        image.put_dint(r.CEC_ACTING, cec)
        image.put_dint(r.BACKLASH, access.backlash(target))
        image.words[r.ENCODERS] = access.encoders(axis)
        image.put_dint(r.BACKLASH_FACTOR, access.backlash_factor(axis))

    def _show_table(self, image: r.Image, target: Target) -> None:
        found = self._access.parameters(target)
        image.words[r.TABLE_FLAGS] = found.flags
        for place, value in enumerate((found.minimum, found.step, found.maximum)):
            image.put_dint(r.TABLE_FLAGS + 1 + 2 * place, value)
        image.put(r.SWITCHES - 3, (found.input_axis, found.output_axis, found.factor))
        image.put_dint(r.WEIGHT, self._access.weight(target))
