"""One axis: base setpoint, additional setpoint, actual-value compensations, and the encoder position that results.

    act = lag(base + additional + temperature)       the ideal machine's position plus CEC
    enc = act - K_EEC(act) + backlash take-up        what the mechanism does

Backlash (MD32450, positive when the encoder leads the machine part) is taken up by half the value in each direction, so
the mean of both directions stays where it was: MD32450 x MD32452 at once on reversal (spread where it is more than
MD36500 in one cycle), MD32456 slowly while the PLC asks for it. ``enc`` is the place in terms of encoder 1; while
encoder 2 is active K_EEC is its table plus what it shows more than encoder 1.

Sources: K3 p. 234; texts of MD32450 to MD32457, MD36500.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.nck.machine.compensation import Curve, Stretch
from simulators.nck.machine.motion import DirectionLog, LaggedPath
from simulators.nck.spec import AxisSpec


@dataclass(frozen=True, slots=True)
class TakeUp:
    """Backlash data of an axis: the encoder's lead after + and - travel, and how fast it gets there.

    Up to ``step`` at once, more at ``rate`` per s; ``dynamic`` that much more in the direction of travel, at
    ``dynamic_rate`` per s.
    """

    plus: float = 0.0
    minus: float = 0.0
    step: float = math.inf
    rate: float = math.inf
    dynamic: float = 0.0
    dynamic_rate: float = math.inf

    def at_once(self, direction: int) -> float:
        """The lead without the dynamic part."""
        return self.plus if direction > 0 else self.minus

    def total(self, direction: int) -> float:
        """The lead when all is taken up."""
        return self.at_once(direction) + self.dynamic * direction


class ReversalLead:
    """The lead over time; ``path`` is its demand and the response of the drive."""

    def __init__(self, lag_s: float, start_s: float) -> None:
        self.path = LaggedPath(lag_s, start_s, 0.0)
        self.dynamic_on = False
        self._direction = 1
        self._steady = 0.0

    def take_up(self, sign: int, how: TakeUp, time_s: float) -> None:
        """The drive turns that way at a time; sign 0: its backlash data changed."""
        self._direction = sign or self._direction
        goal = how.total(self._direction)
        if self.path.final()[1] == goal:
            return
        if self.path.final()[0] > time_s:
            self.path.halt(time_s)
        jump = how.at_once(self._direction) - self._steady
        self._steady += jump
        here = self.path.demand(time_s)
        if abs(jump) > how.step:
            self._ramp(time_s, here, goal, how.rate)
        elif how.dynamic != 0.0 or abs(goal - here - jump) > 0.0:
            self._ramp(time_s, here + jump, goal, how.dynamic_rate)
        else:
            self.path.add(time_s, goal)

    def _ramp(self, time_s: float, here: float, goal: float, rate: float) -> None:
        seconds = abs(goal - here) / rate
        if seconds > 0.0:
            self.path.add(time_s, here, math.copysign(rate, goal - here))
        self.path.add(time_s + seconds, goal)

    def forget_plans(self, how: TakeUp, now_s: float) -> None:
        """Drop reversals planned for later."""
        self.path.halt(now_s)
        value = self.path.demand(now_s)
        self._direction = 1 if abs(value - how.total(1)) <= abs(value - how.total(-1)) else -1
        self._steady = how.at_once(self._direction)

    def forget_direction(self) -> None:
        """Power on without MD32454 bit 0: as if the last travel had been positive."""
        self._direction = 1


Array = NDArray[np.float64]

COARSE = 0.02
FINE = 0.002
_STILL_MOVING = 0.0002
_WORN_OFF = 1e-9


@dataclass(frozen=True, slots=True)
class AxisView:
    """An axis at one moment, in the basic system of units or deg (modulo axes 0..360); signs: see the module.

    ``set_position`` and ``actual_position`` are those of the ideal machine (compensations corrected out),
    ``encoder_position`` is what the measuring system shows. ``aa_stat``: 0 none, 1 moving, 2 interpolation
    end, 3 in position coarse, 4 fine. ``index`` counts from 1.
    """

    name: str
    letter: str
    index: int
    set_position: float
    actual_position: float
    encoder_position: float
    aa_stat: int
    referenced: bool
    eec_value: float
    cec_value: float
    backlash_value: float
    temperature_value: float


@dataclass(frozen=True, slots=True)
class _Share:
    """What is left of an earlier state of the table while the axis travels to a new one."""

    curve: Curve | None
    weight: float


@dataclass(frozen=True, slots=True)
class _Epoch:
    """From ``start_s`` on this curve acts; ``rest`` is what dies away."""

    start_s: float
    curve: Curve | None
    rest: tuple[_Share, ...]


class MachineAxis:
    """The signal path of one axis over time."""

    def __init__(self, spec: AxisSpec, index: int, start_s: float) -> None:
        self.spec = spec
        self.index = index
        lag = spec.servo_time_s
        self.base = LaggedPath(lag, start_s, spec.reference)
        self.additional = LaggedPath(lag, start_s, 0.0)
        self.temperature = LaggedPath(lag, start_s, 0.0)
        self.backlash = ReversalLead(lag, start_s)
        self.travel = DirectionLog(start_s)
        self.encoders_referenced = [False, False]
        self.active_encoder = spec.encoder
        self.curve_offset = 0.0
        self.moved = False
        self._epochs = [_Epoch(start_s, None, ())]
        self._moved_until_s = start_s

    @property
    def referenced(self) -> bool:
        """Whether the active encoder is referenced (DB31.DBX60.4 or 60.5)."""
        return self.encoders_referenced[self.active_encoder]

    @referenced.setter
    def referenced(self, state: bool) -> None:
        self.encoders_referenced[self.active_encoder] = state

    @property
    def end_point(self) -> float:
        """Where the base setpoint stands, or will when the move under way has ended."""
        return self.base.final()[1]

    @property
    def curve(self) -> Curve | None:
        """The EEC curve acting now."""
        return self._epochs[-1].curve

    def compensate(self, curve: Curve | None, now_s: float) -> None:
        """Let another EEC curve (or none) act: the axis moves at once, with its lag."""
        last = self._epochs[-1]
        if curve is last.curve:
            return
        fade = math.exp(-(now_s - last.start_s) / self.base.lag_s)
        shares = [_Share(share.curve, share.weight * fade) for share in last.rest]
        shares.append(_Share(last.curve, 1.0 - fade if last.rest else 1.0))
        rest = tuple(share for share in shares if share.curve is not None and share.weight > _WORN_OFF)
        # A rest without curve weighs too: it keeps the new curve from acting before its time.
        self._epochs.append(_Epoch(now_s, curve, rest or (_Share(None, 1.0),)))
        self._epochs = self._epochs[-64:]

    def travel_to(self, target: float, seconds: float, now_s: float) -> None:
        """Plan a straight move of the base setpoint, from where its demand is now."""
        begin = max(now_s, self.base.final()[0])
        here = self.end_point
        if seconds <= 0.0 or target == here:
            self.base.add(begin, target)
            return
        self.base.add(begin, here, (target - here) / seconds)
        self.base.add(begin + seconds, target)
        self._moved_until_s = begin + seconds

    def halt(self, now_s: float) -> None:
        """Stop the base setpoint where it is."""
        self.base.halt(now_s)
        self._moved_until_s = min(self._moved_until_s, now_s)

    def way(self, now_s: float, first: int = 1, *, kept: bool = True) -> list[Stretch]:
        """What the base setpoint will do from now on.

        ``first``: the direction before the axis has moved at all; ``kept``: the last one holds at standstill.
        """
        direction = self.travel.latest if self.moved else first
        found = []
        for start, value, slope in self.base.upcoming(now_s):
            direction = direction if slope == 0.0 else (1 if slope > 0.0 else -1)
            found.append(Stretch(start, value, slope, direction if kept or slope != 0.0 else 0))
        return found

    def wrapped(self, position: float) -> float:
        """Position as shown: modulo axes in 0..360."""
        if not self.spec.modulo:
            return position
        turned = position % 360.0
        return 0.0 if turned >= 360.0 else turned

    def actuals(self, times: Array) -> Array:
        """Actual position including the additional setpoints: the input of the EEC table."""
        first = float(times.min()) if times.size else None
        total: Array = self.base.responses(times, first) + self.additional.responses(times, first)
        return total + self.temperature.responses(times, first)

    def encoders(self, times: Array) -> Array:
        """Encoder position at many times, turns unlimited."""
        act = self.actuals(times)
        return self._encoders_at(act, times)

    def _encoders_at(self, act: Array, times: Array) -> Array:
        result: Array = act - self._eec(act, times) + self.backlash.path.responses(times)
        return result

    def directions(self, times: Array) -> Array:
        """Sign of the last travel of the base setpoint at many times."""
        return self.travel.at(times)

    def _eec(self, act: Array, times: Array) -> Array:
        last = self._epochs[-1]
        if times.size and times.min() >= last.start_s:
            return self._epoch_value(last, act, times)
        result = np.zeros_like(act)
        ends = [epoch.start_s for epoch in self._epochs[1:]] + [math.inf]
        for place, (epoch, end) in enumerate(zip(self._epochs, ends, strict=True)):
            inside = (times < end) & ((times >= epoch.start_s) | (place == 0))
            if inside.any():
                result[inside] = self._epoch_value(epoch, act[inside], times[inside])
        return result

    def _epoch_value(self, epoch: _Epoch, act: Array, times: Array) -> Array:
        fresh = epoch.curve.at(act) if epoch.curve is not None else np.zeros_like(act)
        if not epoch.rest:
            return fresh
        fade = np.exp(-np.maximum(times - epoch.start_s, 0.0) / self.base.lag_s)
        result = fresh * (1.0 - fade)
        for share in epoch.rest:
            if share.curve is not None:
                result = result + share.weight * fade * share.curve.at(act)
        return result

    def table_value(self, now_s: float) -> float:
        """What the acting EEC table gives where the axis is, in mm or deg."""
        if self.curve is None:
            return 0.0
        return self.curve.one(float(self.actuals(np.array([now_s]))[0])) - self.curve_offset

    def view(self, now_s: float, cec_value: float, unit: float = 1.0) -> AxisView:
        """The axis now; ``cec_value`` is the table sum that acts, in the table's own sign.

        ``unit``: mm (or deg) in one unit of the view.
        """
        at = np.array([now_s])
        act = self.actuals(at)
        encoder = float(self._encoders_at(act, at)[0])
        return AxisView(
            name=self.spec.name,
            letter=self.spec.letter,
            index=self.index + 1,
            set_position=self.wrapped(self.base.demand(now_s)) / unit,
            actual_position=self.wrapped(self.base.response(now_s)) / unit,
            encoder_position=self.wrapped(encoder + self.curve_offset) / unit,
            aa_stat=self._state(now_s, float(act[0]), encoder),
            referenced=self.referenced,
            eec_value=self.table_value(now_s) / unit,
            cec_value=cec_value / unit,
            backlash_value=self.backlash.path.demand(now_s) / unit,
            temperature_value=-self.temperature.demand(now_s) / unit,
        )

    def state(self, now_s: float) -> int:
        """``$AA_STAT`` now: 1 travelling, 2 not there yet, 3 and 4 in position coarse and fine."""
        if now_s < self._moved_until_s:
            return 1
        epoch = self._epochs[-1]
        if epoch.rest or now_s < epoch.start_s:
            at = np.array([now_s])
            places = self.actuals(at)
            return self._state(now_s, float(places[0]), float(self._encoders_at(places, at)[0]))
        # Asked at every look of every peer, mostly at rest: one number needs no arrays.
        act = sum(path.response(now_s) for path in (self.base, self.additional, self.temperature))
        table = epoch.curve.one(act) if epoch.curve is not None else 0.0
        return self._state(now_s, act, act - table + self.backlash.path.response(now_s))

    def _state(self, now_s: float, act: float, encoder: float) -> int:
        if now_s < self._moved_until_s:
            return 1
        wanted = act - (self.curve.one(act) if self.curve is not None else 0.0)
        wanted += self.backlash.path.demand(now_s)
        travelling = abs(wanted - encoder) + abs(self._additional_error(now_s))
        if travelling > _STILL_MOVING:
            return 1
        lagging = abs(self.base.demand(now_s) - self.base.response(now_s))
        if lagging > COARSE:
            return 2
        return 3 if lagging > FINE else 4

    def _additional_error(self, now_s: float) -> float:
        paths = (self.additional, self.temperature)
        return sum(path.demand(now_s) - path.response(now_s) for path in paths)

    def settling_s(self, now_s: float, window: float) -> float:
        """Time until the base is inside the window, standing."""
        lagging = abs(self.base.demand(now_s) - self.base.response(now_s))
        return self.base.lag_s * math.log(lagging / (0.98 * window)) if lagging > window else 0.0
