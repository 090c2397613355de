"""A PLC that runs the text of docs/plc, and a plant for it: the jobs of TF_Control at a control of its own.

Knows docs/plc-mailbox-reference.md and the control, nothing of the simulated PLC.
"""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path
from typing import Any

from simulators.nck import Nck, NckRefusal
from tests.unit.mailbox.structured import Library, Record

FOLDER = Path(__file__).parents[3] / "docs" / "plc"
ORDER = ("tf_types", "tf_constants", "tf_control", "tf_words", "tf_checks", "tf_mailbox")
SCAN_MS = 20
AXES_EVERY = 5  # cycles between two looks at the axes
BLOCK = "TF_Mailbox"
_EEC, _CEC, _BACKLASH, _TEMPERATURE = 1, 2, 3, 4
_LEVEL = 0  # the plant's PLC writes with all rights
_TEMPERATURES = ("$SA_TEMP_COMP_ABS_VALUE", "$SA_TEMP_COMP_SLOPE", "$SA_TEMP_COMP_REF_POSITION")
_LIMIT = (1 << 31) - 1


@cache
def library() -> Library:
    """The files of docs/plc, read in their order."""
    return Library(*(FOLDER / f"{name}.st" for name in ORDER))


def text(words: str, count: int) -> list[int]:
    """ASCII, two characters in a word."""
    return list(struct.unpack(f">{count}H", words.encode("ascii").ljust(2 * count, b"\0")[: 2 * count]))


class OutOfRange(Exception):
    """A value does not fit a DINT of its unit."""


class Plant:
    """What somebody would write behind TF_Job and TF_Answer."""

    def __init__(self, nck: Nck) -> None:
        self.nck = nck
        self.release = False
        self.button = False
        self._cycles = 0
        self._names = {number: axis.name for number, axis in zip(nck.spec.numbers, nck.spec.axes, strict=True)}
        self._rotary = {number: axis.rotary for number, axis in zip(nck.spec.numbers, nck.spec.axes, strict=True)}
        self._modulo = {number: axis.modulo for number, axis in zip(nck.spec.numbers, nck.spec.axes, strict=True)}

    def start_anew(self) -> None:
        """The PLC starts: nothing is known of the axes yet."""
        self._cycles = 0

    def step(self, job: Any, answer: Any, kinds: tuple[str, ...]) -> None:
        """One cycle: the machine's state, then the job if there is one."""
        self._machine(answer)
        if not job.Start:
            answer.Done = answer.Failed = False
        elif not answer.Done and not answer.Failed:
            answer.OutOfRange, answer.AccessResult = False, 0
            try:
                getattr(self, "_" + kinds[job.Kind].removeprefix("TF_").lower())(job, answer)
                answer.Done = True
            except NckRefusal as refusal:
                answer.Failed, answer.AccessResult = True, refusal.number
            except OutOfRange:
                answer.Failed = answer.OutOfRange = True

    # ---- the machine ------------------------------------------------------------------------------

    def _machine(self, answer: Any) -> None:
        nck = self.nck
        if self._cycles % AXES_EVERY == 0:
            states = [nck.axis_state(name) for name in self._names.values()]
            answer.Standstill = all(state.aa_stat in (3, 4) for state in states)
            answer.AllReferenced = all(state.referenced for state in states)
        self._cycles += 1
        answer.Ready = not nck.booting
        answer.InReset = answer.Ready and nck.channel_status == 0
        answer.Release = self.release
        answer.AlarmActive = bool(nck.alarms)
        answer.FirstAlarm = nck.alarms[0].number if nck.alarms else 0
        answer.Confirm = self.button
        answer.Metric = bool(nck.get("$MN_SCALING_SYSTEM_IS_METRIC"))
        answer.AccessLevel = nck.access_level
        answer.Mode = {"JOG": 0, "MDA": 1, "AUTO": 2}[nck.mode]
        answer.AxisCount, answer.TableCount = max(self._names), len(nck.spec.cec_points)
        answer.AxisMap = sum(1 << (number - 1) for number in self._names)
        answer.Serial, answer.NckVersion = text(nck.spec.serial, 16), text(nck.spec.nck_version, 8)

    # ---- jobs -------------------------------------------------------------------------------------

    def _real(self, name: str) -> float:
        return float(self.nck.get(name))

    def _dint(self, value: float) -> int:
        whole = round(value)
        if not -_LIMIT - 1 <= whole <= _LIMIT:
            raise OutOfRange
        return whole

    def _shown(self, value: float) -> int:
        """A live value: what does not fit shows the end of the range."""
        return max(-_LIMIT - 1, min(_LIMIT, round(value)))

    def _value_unit(self, axis: int) -> float:
        return 1e7 if self._rotary[axis] else 1e6

    def _position_unit(self, axis: int) -> float:
        return 1e6 if self._rotary[axis] else 1e4

    def _point(self, job: Any, place: int) -> tuple[str, float]:
        """The variable of a point, and its units in one of the control's."""
        axis = self._names[job.Axis]
        if job.TableKind == _EEC:
            return f"$AA_ENC_COMP[{job.Encoder},{place},{axis}]", self._value_unit(job.Axis)
        if job.TableKind == _CEC:
            return f"$AN_CEC[{job.Index},{place}]", self._value_unit(job.Axis)
        if job.TableKind == _BACKLASH:
            return f"$MA_BACKLASH[{job.Encoder},{axis}]", self._value_unit(job.Axis)
        unit = (self._value_unit(job.Axis), 1e9, self._position_unit(job.Axis))[place]
        return f"{_TEMPERATURES[place]}[{axis}]", unit

    def _read_points(self, job: Any, answer: Any) -> None:
        for place in range(job.Count):
            name, unit = self._point(job, job.First + place)
            answer.Points[place] = self._dint(self._real(name) * unit)

    def _write_points(self, job: Any, _answer: Any) -> None:
        for place in range(job.Count):
            name, unit = self._point(job, job.First + place)
            self.nck.set(name, job.Points[place] / unit, _LEVEL)

    def _grid(self, job: Any, part: str) -> str:
        if job.TableKind == _EEC:
            return f"$AA_ENC_COMP_{part}[{job.Encoder},{self._names[job.Axis]}]"
        return f"$AN_CEC_{part}[{job.Index}]"

    def _write_grid(self, job: Any, _answer: Any) -> None:
        cross = job.TableKind == _CEC
        unit = self._position_unit(job.InputAxis if cross else job.Axis)
        values: dict[str, Any] = {"MIN": job.Minimum / unit, "STEP": job.Width / unit, "MAX": job.Maximum / unit}
        values["IS_MODULO"] = job.Flags & 1
        if cross:
            values["INPUT_AXIS"], values["OUTPUT_AXIS"] = self._names[job.InputAxis], self._names[job.OutputAxis]
            values["DIRECTION"] = {0: 0, 1: 1, 2: -1}[job.Flags >> 1 & 3]
            values["TYPE"], values["MULT_BY_TABLE"] = job.Flags >> 3 & 1, job.MultiplyBy
        for part, value in values.items():
            self.nck.set(self._grid(job, part), value, _LEVEL)

    def _switch_on(self, job: Any, _answer: Any) -> None:
        self._switch(job, True)

    def _switch_off(self, job: Any, _answer: Any) -> None:
        self._switch(job, False)

    def _switch(self, job: Any, on: bool) -> None:
        axis = self._names[job.Axis]
        if job.TableKind == _EEC:
            self.nck.set(f"$MA_ENC_COMP_ENABLE[{job.Encoder},{axis}]", on, _LEVEL)
        elif job.TableKind == _BACKLASH:
            self.nck.set(f"$MA_BACKLASH[{job.Encoder},{axis}]", job.Points[0] / self._value_unit(job.Axis), _LEVEL)
        else:
            if on and not job.AxisOnly:
                self.nck.set(f"$SN_CEC_TABLE_WEIGHT[{job.Index}]", 1.0, _LEVEL)
            if not job.AxisOnly:
                self.nck.set(f"$SN_CEC_TABLE_ENABLE[{job.Index}]", on, _LEVEL)
            if not job.TableOnly:
                self.nck.set(f"$MA_CEC_ENABLE[{axis}]", on, _LEVEL)

    def _let_act(self, _job: Any, _answer: Any) -> None:
        self.nck.core.newconf()

    # ---- the picture of a selection ---------------------------------------------------------------

    def _refresh(self, job: Any, answer: Any) -> None:
        axis = self._names[job.Axis]
        state = self.nck.axis_state(axis)
        value, cross = self._value_unit(job.Axis), job.TableKind == _CEC
        answer.AxisName = text(axis, 8)
        referenced = self.nck.core.axis(axis).encoders_referenced[job.Encoder]
        facts = (
            self._rotary[job.Axis],
            self._modulo[job.Axis],
            referenced,
            state.aa_stat == 4,
            state.aa_stat in (3, 4),
            self.nck.core.axis(axis).active_encoder == 0,
            self.nck.core.axis(axis).active_encoder == 1,
        )
        answer.AxisFlags = sum(1 << bit for bit, holds in enumerate(facts) if holds)
        eec, cec = self._switch_names(job.Encoder, axis)
        table = cross and bool(self.nck.get(f"$SN_CEC_TABLE_ENABLE[{job.Index}]"))
        answer.Switches = bool(self.nck.get(eec)) | bool(self.nck.get(cec)) << 1 | table << 2
        answer.Position = self._shown(self._real(f"$VA_IM[{axis}]") * self._position_unit(job.Axis))
        answer.ActingEec = self._shown(self._real(f"$VA_ENC{job.Encoder + 1}_COMP_VAL[{axis}]") * value)
        answer.ActingCec = self._shown(self._real(f"$VA_CEC_COMP_VAL[{axis}]") * value)
        answer.Backlash = self._shown(self._real(f"$MA_BACKLASH[{job.Encoder},{axis}]") * value)
        weight = self._real(f"$SN_CEC_TABLE_WEIGHT[{job.Index}]") if cross else 0.0
        answer.Weight = self._shown(weight * 1e6)
        answer.BacklashFactor = self._shown(self._real(f"$MA_BACKLASH_FACTOR[0,{axis}]") * 1e6)
        answer.Encoders = round(self._real(f"$MA_NUM_ENCS[{axis}]"))
        answer.Reserved = self._reserved(job)
        self._table(job, answer)

    def _switch_names(self, encoder: int, axis: str) -> tuple[str, str]:
        return f"$MA_ENC_COMP_ENABLE[{encoder},{axis}]", f"$MA_CEC_ENABLE[{axis}]"

    def _reserved(self, job: Any) -> int:
        if job.TableKind == _EEC:
            return round(self._real(f"$MA_MM_ENC_COMP_MAX_POINTS[{job.Encoder},{self._names[job.Axis]}]"))
        if job.TableKind == _CEC:
            return round(self._real(f"$MN_MM_CEC_MAX_POINTS[{job.Index}]"))
        return 1 if job.TableKind == _BACKLASH else 3

    def _table(self, job: Any, answer: Any) -> None:
        answer.LiveMinimum = answer.LiveStep = answer.LiveMaximum = answer.LiveFlags = answer.LiveMultiplyBy = 0
        answer.LiveInputAxis = answer.LiveOutputAxis = job.Axis if job.TableKind == _EEC else 0
        answer.LiveOutputOn = False
        if job.TableKind not in (_EEC, _CEC):
            return
        numbers = {name: number for number, name in self._names.items()}
        flags = int(bool(self.nck.get(self._grid(job, "IS_MODULO"))))
        if job.TableKind == _CEC:
            answer.LiveInputAxis = numbers.get(str(self.nck.get(self._grid(job, "INPUT_AXIS"))), 0)
            answer.LiveOutputAxis = output = numbers.get(str(self.nck.get(self._grid(job, "OUTPUT_AXIS"))), 0)
            answer.LiveOutputOn = bool(output) and bool(self.nck.get(f"$MA_CEC_ENABLE[{self._names[output]}]"))
            answer.LiveMultiplyBy = round(self._real(self._grid(job, "MULT_BY_TABLE")))
            direction = round(self._real(self._grid(job, "DIRECTION")))
            flags |= {0: 0, 1: 1, -1: 2}[direction] << 1 | round(self._real(self._grid(job, "TYPE"))) << 3
        unit = self._position_unit(answer.LiveInputAxis) if answer.LiveInputAxis else 1e4
        places = [self._real(self._grid(job, part)) * unit for part in ("MIN", "STEP", "MAX")]
        if any(abs(place - round(place)) > 1e-6 or abs(place) > _LIMIT for place in places):
            places, flags = [0.0, 0.0, 0.0], flags | 0x8000
        answer.LiveMinimum, answer.LiveStep, answer.LiveMaximum = (round(place) for place in places)
        answer.LiveFlags = flags


class TextPlc:
    """The function block, its registers and its plant."""

    def __init__(self, read: Library, nck: Nck, *, low_first: bool = False) -> None:
        self._library = read
        self._low_first = low_first
        self.plant = Plant(nck)
        self.now_ms = 0
        self._memory: Record = read.block(BLOCK)
        self._begin()

    def _begin(self) -> None:
        self.registers: list[int] = self._library.made("TF_Registers")
        self._job: Any = self._library.made("TF_Job")
        self._answer: Any = self._library.made("TF_Answer")

    def power_cycle(self) -> None:
        """As after a power cut: what is retentive is there again."""
        kept = self._library.retained(BLOCK, self._memory)
        self._memory = self._library.block(BLOCK, kept)
        self._begin()
        self.plant.start_anew()

    def cycle(self) -> None:
        """One cycle of the PLC."""
        given = {"LowFirst": self._low_first, "R": self.registers, "Job": self._job, "Answer": self._answer}
        self.plant.step(self._job, self._answer, self._library.types["TF_JobKind"].values)
        self._library.cycle(BLOCK, self._memory, self.now_ms, given)
        self.now_ms += SCAN_MS
