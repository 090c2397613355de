"""The bench: turns a reducer and twists it, and writes what its encoders and its torque transducer read.

Two tests. *Running*: the input turns evenly through a whole turn of the output and a little more, one way and back,
under a constant torque on the output. *Hysteresis*: the input is locked, the torque goes up to the rated one, down to
its negative and up again, in steps that are finer about zero.

Friction sits at the output. While it turns, the drive carries the torque less friction against the motion: dry, dry
by share of the torque, and viscous. While it is twisted the output sticks until the torque differs from what the drive
carries by more than the friction: a play operator, the rate of which does not matter. So a drive without friction
has no loop, and the loop of one without play is as wide as twice its friction over its stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from simulators.reducer.benchfile import BenchFile, EncoderSection
from simulators.reducer.energy import ARCSEC, Mechanism
from simulators.reducer.parts import FloatArray, Reducer
from simulators.truth import generator

DEG = np.pi / 180.0
RUN_IN = 0.02
STAND_S = 2.0
STEP_S = 0.5
READ = ("time_s", "input_deg", "output_deg", "torque_nm", "temperature_degc")
NEAR_ZERO = 0.06
LEAST = 5e-4
"""Of the rated torque: a drive that carries less is taken to carry so much in that sense, for it leans on a flank."""


@dataclass(frozen=True, slots=True)
class BenchRecord:
    """What was read, row by row (n,), and what the bench knows of the reducer, as its file states it."""

    time_s: FloatArray
    input_deg: FloatArray
    output_deg: FloatArray
    torque_nm: FloatArray
    temperature_degc: FloatArray
    stated: dict[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """The record as CSV: comment lines with what is stated, one heading with units, a row a reading."""
        head = [f"# {key},{value}" for key, value in self.stated.items()]
        names = "time_s,input_angle_deg,output_angle_deg,torque_Nm,temperature_degC"
        columns = (self.time_s, self.input_deg, self.output_deg, self.torque_nm, self.temperature_degc)
        rows = [
            f"{t:.4f},{i:.8f},{o:.9f},{m:.4f},{c:.3f}"
            for t, i, o, m, c in zip(*(one.tolist() for one in columns), strict=True)
        ]
        return "\r\n".join([*head, names, *rows, ""])

    def and_then(self, other: BenchRecord) -> BenchRecord:
        """Both one after the other, the second later by a short stand."""
        later = replace(other, time_s=other.time_s + self.time_s[-1] + STAND_S)
        return BenchRecord(
            **{name: np.concatenate((getattr(self, name), getattr(later, name))) for name in READ},
            stated={**other.stated, **self.stated},
        )


class Bench:
    """One reducer on the bench of a file."""

    def __init__(self, spec: BenchFile, seed: int | None = None, reducer: Reducer | None = None) -> None:
        """``seed`` draws another reducer of the kind (None: the file's); ``reducer`` is one that was made elsewhere."""
        self.spec = spec
        self.seed = spec.seed if seed is None else seed
        self.reducer = reducer or spec.reducer(self.seed)
        self._mechanism = Mechanism(self.reducer)

    def running(
        self,
        *,
        torque_nm: float = 0.0,
        rpm: float = 5.0,
        steps: int = 24,
        turns: float = 1.0,
        both_ways: bool = True,
    ) -> BenchRecord:
        """The output turns on by ``turns`` and, ``both_ways``, back, at ``rpm`` of the output.

        ``steps`` readings in each turn of a crank. A pass is longer than the turns by two hundredths.
        """
        each = steps * self.reducer.gear.zc
        count = int(np.ceil((turns + RUN_IN) * each)) + 1
        way = np.arange(count) / each * 2.0 * np.pi
        ahead = self._pass(way, 1.0, torque_nm=torque_nm, rpm=rpm)
        return ahead.and_then(self._pass(way[::-1], -1.0, torque_nm=torque_nm, rpm=rpm)) if both_ways else ahead

    def _pass(self, nominal: FloatArray, sense: float, *, torque_nm: float, rpm: float) -> BenchRecord:
        """The output on its way through nominal angles (n,) rad in a sense."""
        time = np.abs(nominal - nominal[0]) / (2.0 * np.pi * rpm / 60.0)
        climate, friction = self.spec.climate, self.spec.friction
        degc = climate.housing_degc + climate.rise_k_per_h * time / 3600.0
        viscous = friction.viscous_nm_per_rpm * rpm * np.exp(-friction.thinner_per_k * (degc - 20.0))
        carried = torque_nm - sense * (friction.dry_nm + friction.dry_share * abs(torque_nm) + viscous)
        rest = self._mechanism.rest(nominal * self.reducer.ratio, carried)
        return self._read(time, nominal * self.reducer.ratio, rest.output_rad, np.full(len(time), torque_nm), degc)

    def hysteresis(self, *, at_deg: float = 0.0, torque_nm: float | None = None, steps: int = 40) -> BenchRecord:
        """A whole loop of torque with the input locked where the output is near ``at_deg``.

        ``steps`` torques from zero to the largest (None: the rated torque), a third of them within 6 % of it.
        """
        largest = self.spec.rated_torque_nm if torque_nm is None else torque_nm
        near = max(steps // 3, 6)
        fine = np.linspace(0.0, NEAR_ZERO, near, endpoint=False)
        up = largest * np.concatenate((fine, np.linspace(NEAR_ZERO, 1.0, max(steps - near, 2))))
        whole = np.concatenate((up, up[-2::-1], -up[1:], -up[-2::-1], up[1:]))
        return self.twisted(whole, at_deg=at_deg)

    def twisted(self, torque_nm: FloatArray, *, at_deg: float = 0.0) -> BenchRecord:
        """Torques (n,) one after the other on the output, the input locked where the output is near ``at_deg``."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        carried = self._carried(torque)
        held = np.full(len(torque), at_deg * DEG * self.reducer.ratio)
        least = LEAST * self.spec.rated_torque_nm
        leaning = np.where(np.abs(carried) < least, np.copysign(least, carried), carried)
        levels, back = np.unique(leaning, return_inverse=True)
        output = self._mechanism.rest(held[: len(levels)], levels).output_rad[back]
        time: FloatArray = STEP_S * np.arange(float(len(torque)))
        degc = self.spec.climate.housing_degc + self.spec.climate.rise_k_per_h * time / 3600.0
        return self._read(time, held, output, torque, degc)

    def _carried(self, torque: FloatArray) -> FloatArray:
        """What the drive carries of the torques (n,): it follows once friction is overcome."""
        friction, held = self.spec.friction, 0.0
        found = np.empty(len(torque))
        for at, one in enumerate(torque):
            band = friction.dry_nm + friction.dry_share * abs(one)
            held = float(np.clip(held, one - band, one + band))
            found[at] = held
        return found

    def _read(
        self, time: FloatArray, inputs: FloatArray, output: FloatArray, torque: FloatArray, degc: FloatArray
    ) -> BenchRecord:
        drawn = len(time) + (1 if torque[0] == torque[-1] else 0)
        rng = generator(self.seed, f"encoders {drawn} {inputs[0]:.9f} {inputs[-1]:.9f}")
        gear, stage = self.reducer.gear, self.reducer.stage
        stated = {
            "Reducer": self.spec.name,
            "Pins": f"{gear.zp}",
            "Ratio": f"{self.reducer.ratio:.12g}",
            "Rated torque Nm": f"{self.spec.rated_torque_nm:g}",
            "Cranks": f"{self.reducer.cranks.count}",
            **({"Sun teeth": f"{stage.sun_teeth}"} if stage else {}),
            "Output encoder U arcsec": f"{_expanded(self.spec.output_encoder):.3g}",
            "Input encoder U arcsec": f"{_expanded(self.spec.input_encoder):.3g}",
            "Instrument": "reducer bench (simulated)",
        }
        return BenchRecord(
            time_s=time,
            input_deg=_encoded(self.spec.input_encoder, inputs, rng) / DEG,
            output_deg=_encoded(self.spec.output_encoder, output, rng) / DEG,
            torque_nm=torque,
            temperature_degc=degc,
            stated=stated,
        )


def _expanded(spec: EncoderSection) -> float:
    """What the encoder's certificate states, k = 2: its waves at their largest, twice the noise, half a step."""
    waves = abs(spec.once_arcsec) + abs(spec.twice_arcsec)
    return float(np.sqrt(waves**2 + (2.0 * spec.noise_arcsec) ** 2 + (0.5 * spec.resolution_arcsec) ** 2))


def _encoded(spec: EncoderSection, angle: FloatArray, rng: np.random.Generator) -> FloatArray:
    """What an encoder reads of angles (n,), rad."""
    off = spec.once_arcsec * np.sin(angle) + spec.twice_arcsec * np.sin(2.0 * angle)
    read = angle + (off + spec.noise_arcsec * rng.normal(0.0, 1.0, len(angle))) * ARCSEC
    step = spec.resolution_arcsec * ARCSEC
    return np.asarray(np.rint(read / step) * step if step else read)
