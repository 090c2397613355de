"""The test bench of a reducer: the bench file, and the two tests that it runs.

The file describes a reducer by data and tolerances, drawn by a seed, and its encoders, friction, climate and tests.

*Running*: the input turns evenly through a whole turn of the output and a little more, one way and back, under a
constant torque on the output. *Hysteresis*: the input is locked, the torque goes up to the rated one, down to its
negative and up again, in steps that are finer about zero.

Friction sits at the output. While it turns, the drive carries the torque less friction against the motion: dry, dry by
share of the torque, and viscous. While it is twisted the output sticks until the torque differs from what the drive
carries by more than the friction: a play operator, the rate of which does not matter. So a drive without friction has
no loop, and the loop of one without play is as wide as twice its friction over its stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path

import numpy as np
from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.local.textfile import parse_toml, read_toml
from simulators.cellfile import Gear
from simulators.cellfile.curves import CellSection, Name
from simulators.grinding import CycloidDisc
from simulators.reducer.equilibrium import ARCSEC, Mechanism
from simulators.reducer.parts import Contact, CrankSet, Disc, FirstStage, Flanks, FloatArray, Reducer, Ring, marks
from simulators.truth import generator

DRAWN_PROFILE = 31


class PinSection(CellSection):
    """Standard deviations of the pins, um: radius, place along and across the circle; all are off by ``thick_um``."""

    radius_um: float = Field(default=0.5, ge=0)
    place_um: float = Field(default=1.5, ge=0)
    thick_um: float = 0.0


class DiscSection(CellSection):
    """How many discs, at which of their `marks` each is built, and how their flanks are off by standard deviations, um.

    ``pitch_um`` of each space, ``runout_um`` of the first three harmonics round the disc (tangential and radial each),
    ``form_um`` of a wave along the profile alike on all spaces, ``lead_um`` from one face to the other.
    ``clearance_um`` is what all flanks have less; ``slices`` share the face.
    """

    count: int = Field(default=2, ge=1, le=3)
    marks: tuple[int, ...] = ()
    slices: int = Field(default=3, ge=1, le=11)
    clearance_um: float = Field(default=6.0, ge=-50, le=200)
    pitch_um: float = Field(default=0.5, ge=0)
    runout_um: float = Field(default=1.5, ge=0)
    form_um: float = Field(default=0.5, ge=0)
    lead_um: float = Field(default=0.5, ge=0)


class CrankSection(CellSection):
    """Cranks, or output pins: how many at which radius, standard deviations, play and stiffness (0: rigid)."""

    count: int = Field(default=3, ge=1, le=24)
    radius_mm: float = Field(gt=0)
    eccentricity_um: float = Field(default=1.0, ge=0)
    phase_arcsec: float = Field(default=10.0, ge=0)
    seat_um: float = Field(default=2.0, ge=0)
    hole_um: float = Field(default=2.0, ge=0)
    clearance_um: float = Field(default=3.0, ge=0)
    stiffness_n_mm: float = Field(default=1.5e5, ge=0)


class StageSection(CellSection):
    """Sun and planets and their error in arcsec of the planets."""

    sun_teeth: int = Field(ge=4, le=400)
    planet_teeth: int = Field(ge=4, le=400)
    once_arcsec: float = 0.0
    mesh_arcsec: float = 0.0


class EncoderSection(CellSection):
    """An angle encoder: error once and twice a turn, noise (standard deviation) and resolution, arcsec."""

    once_arcsec: float = 0.0
    twice_arcsec: float = 0.0
    noise_arcsec: float = Field(default=0.0, ge=0)
    resolution_arcsec: float = Field(default=0.0, ge=0)


class FrictionSection(CellSection):
    """Friction at the output in Nm: dry, dry by share of the torque, and by speed at 20 degC.

    What grows with speed loses ``thinner_per_k`` of itself for each K.
    """

    dry_nm: float = Field(default=0.5, ge=0)
    dry_share: float = Field(default=0.01, ge=0, lt=1)
    viscous_nm_per_rpm: float = Field(default=0.3, ge=0)
    thinner_per_k: float = Field(default=0.03, ge=0, lt=1)


class ClimateSection(CellSection):
    """Housing's temperature, its rise in an hour, and how much warmer the discs are; steel unless said otherwise."""

    housing_degc: float = 25.0
    rise_k_per_h: float = 2.0
    discs_warmer_k: float = 0.0
    expansion_ppm_per_k: float = 11.5


class BenchFile(CellSection):
    """A reducer on its bench."""

    name: Name
    seed: int = Field(default=1, ge=0)
    rated_torque_nm: float = Field(gt=0)
    gear: Gear
    pins: PinSection = PinSection()
    discs: DiscSection = DiscSection()
    cranks: CrankSection
    stage: StageSection | None = None
    contact_n_mm_per_mm: float = Field(default=2e4, gt=0)
    contact_exponent: float = Field(default=1.0, ge=1.0, le=2.0)
    input_encoder: EncoderSection = EncoderSection()
    output_encoder: EncoderSection = EncoderSection()
    friction: FrictionSection = FrictionSection()
    climate: ClimateSection = ClimateSection()

    @model_validator(mode="after")
    def _marked(self) -> BenchFile:
        if self.discs.marks and len(self.discs.marks) != self.discs.count:
            raise ValueError("discs.marks has a number for each disc, or is left out")
        if any(not 0 <= mark < self.gear.zc for mark in self.discs.marks):
            raise ValueError("discs.marks are 0 to zc - 1")
        return self

    def reducer(self, seed: int | None = None, discs: Mapping[int, Flanks] | None = None) -> Reducer:
        """The reducer that a seed draws (None: the file's own); ``discs`` by number from 0 are taken as they are."""
        seed = self.seed if seed is None else seed
        gear, pins, given = self.gear, self.pins, discs or {}
        rng = generator(seed, "ring")
        across = rng.normal(0.0, 1.0, (2, gear.zp))
        climate = self.climate
        grown = -climate.discs_warmer_k * climate.expansion_ppm_per_k * 1e-3 * gear.rp
        ring = Ring.of(
            gear,
            pins.thick_um + pins.radius_um * rng.normal(0.0, 1.0, gear.zp),
            pins.place_um * (across[0] + 1j * across[1]),
            grown,
        )
        phases = 2.0 * np.pi * np.arange(self.discs.count) / self.discs.count
        places = self.discs.marks or tuple([0] * self.discs.count)
        flanks = [given.get(d) or self._flanks(seed, d) for d in range(self.discs.count)]
        built = tuple(
            Disc(one, float(phase), float(marks(gear, float(phase))[place]))
            for one, phase, place in zip(flanks, phases, places, strict=True)
        )
        stage = FirstStage(**self.stage.model_dump()) if self.stage else None
        contact = Contact(self.contact_n_mm_per_mm, self.contact_exponent)
        return Reducer(gear=gear, ring=ring, discs=built, cranks=self._cranks(seed), contact=contact, stage=stage)

    def _cranks(self, seed: int) -> CrankSet:
        cranks, rng = self.cranks, generator(seed, "cranks")
        shape = (cranks.count, self.discs.count)
        seat, hole = rng.normal(0.0, 1.0, (2, cranks.count)), rng.normal(0.0, 1.0, (2, *shape))
        return CrankSet(
            radius_mm=cranks.radius_mm,
            eccentricity_um=cranks.eccentricity_um * rng.normal(0.0, 1.0, shape),
            phase_arcsec=cranks.phase_arcsec * rng.normal(0.0, 1.0, shape),
            seat_um=cranks.seat_um * (seat[0] + 1j * seat[1]),
            hole_um=cranks.hole_um * (hole[0] + 1j * hole[1]),
            stiffness_n_mm=cranks.stiffness_n_mm or None,
            clearance_um=cranks.clearance_um,
        )

    def _flanks(self, seed: int, number: int) -> Flanks:
        """Flanks that a seed draws: pitch and run-out act as a turned or moved disc would, by normal and lever."""
        spec, gear = self.discs, self.gear
        lobes, rng = CycloidDisc(gear), generator(seed, f"disc {number}")
        t = lobes.even(DRAWN_PROFILE, 0.98)
        point, normal = lobes.profile(t)
        tangential = np.imag(np.conj(point) * normal) / np.max(np.abs(np.imag(np.conj(point) * normal)))
        round_ = 2.0 * np.pi * np.arange(gear.zc) / gear.zc
        turned, moved = spec.pitch_um * rng.normal(0.0, 1.0, gear.zc), np.zeros(gear.zc)
        for m in (1, 2, 3):
            wave = np.stack((np.cos(m * round_), np.sin(m * round_)))
            turned += spec.runout_um * rng.normal(0.0, 1.0, 2) @ wave
            moved += spec.runout_um * rng.normal(0.0, 1.0, 2) @ wave
        form = spec.form_um * rng.normal() * np.cos(2.0 * gear.zc * t + rng.uniform(0.0, 2.0 * np.pi))
        z = (np.arange(spec.slices) + 0.5) / spec.slices - 0.5
        lead = spec.lead_um * rng.normal(0.0, 1.0, gear.zc)[:, None, None] * z
        plane = turned[:, None] * tangential + moved[:, None] * normal.real + form - spec.clearance_um
        return Flanks(t, plane[:, :, None] + lead * tangential[:, None])


def load_bench(source: str | Path) -> BenchFile:
    """A packaged bench ("rv-40e") or a TOML file. Raises ConfigError (E-BENCH-FILE)."""
    try:
        if str(source) in packaged_benches():
            inside = resources.files("simulators").joinpath("reducer", "benches", f"{source}.toml")
            tree = parse_toml(inside.read_text(encoding="utf-8"))
        else:
            tree = read_toml(Path(source))
        return BenchFile.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(file)"
        raise ConfigError("E-BENCH-FILE", str(source), why=f"{shown(key)}: {first['msg']}") from error
    except (OSError, ValueError) as error:
        raise ConfigError("E-BENCH-FILE", str(source), why=str(error)) from error


def packaged_benches() -> tuple[str, ...]:
    """Names of the benches that come with us."""
    folder = resources.files("simulators").joinpath("reducer", "benches")
    return tuple(sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml")))


def flanks_of(rows: Sequence[Sequence[float]], gear: Gear, where: str) -> Flanks:
    """Flanks from rows of space, profile angle rad, height mm, deviation um. Raises ConfigError (E-BENCH-FLANKS)."""
    table = np.asarray(rows, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 4 or not np.isfinite(table).all():
        raise ConfigError("E-BENCH-FLANKS", where, why="it needs four columns of numbers")
    spaces, t, z = (np.unique(np.round(table[:, k], 9)) for k in range(3))
    wanted = len(spaces) * len(t) * len(z)
    if len(spaces) != gear.zc or len(t) < 2 or len(table) != wanted:
        why = f"{len(table)} points are no whole grid of {gear.zc} spaces: {len(spaces)} x {len(t)} x {len(z)}"
        raise ConfigError("E-BENCH-FLANKS", where, why=why)
    grid: FloatArray = np.full((len(spaces), len(t), len(z)), np.nan)
    at = [np.searchsorted(axis, np.round(table[:, k], 9)) for k, axis in enumerate((spaces, t, z))]
    grid[at[0], at[1], at[2]] = table[:, 3]
    if np.isnan(grid).any() or np.abs(t).max() > np.pi / gear.zc:
        raise ConfigError("E-BENCH-FLANKS", where, why="a point is missing or beyond the tips of its space")
    return Flanks(t, grid)


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
        return self.twist(whole, at_deg=at_deg)

    def twist(self, torque_nm: FloatArray, *, at_deg: float = 0.0) -> BenchRecord:
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
