"""A machine made of formulas: what straightness, angle, square, bar and ball set-ups would read of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gateway.evaluate.geometry.measurement import Measurement

ARCSEC = np.pi / 648000.0
X = np.linspace(-400.0, 0.0, 21)
Z = np.linspace(0.0, 300.0, 21)
C = np.arange(0.0, 360.0, 15.0)
PLACES = {"X": X, "Z": Z, "C": C}
STOOD = -230.0
UNITS = {"X": "mm", "Z": "mm", "C": "deg"}


@dataclass
class Machine:
    """Error motions as polynomials or harmonics drawn from a seed; location errors in arcsec or um."""

    seed: int = 1
    B0Z: float = 6.0
    A0C: float = -4.0
    B0C: float = 5.0
    noise: float = 0.05
    rng: np.random.Generator = field(init=False)
    curves: dict[str, np.ndarray] = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.curves = {f"E{way}{axis}": self.rng.uniform(-3.0, 3.0, 4) for axis in "XZC" for way in "XYZABC"}

    def motion(self, name: str, q: np.ndarray) -> np.ndarray:
        c = self.curves[name]
        if name[2] == "C":
            turn = np.deg2rad(q)
            return c[0] * np.cos(turn) + c[1] * np.sin(turn) + c[2] * np.cos(2 * turn) + c[3] * np.sin(3 * turn)
        at = PLACES[name[2]]
        s = 2.0 * (q - at[0]) / np.ptp(at) - 1.0
        return c[0] * s + c[1] * s**2 + c[2] * s**3 + c[3] * np.cos(4.0 * s)

    def read(self, name: str, value: np.ndarray, **how: object) -> Measurement:
        axis = str(how.pop("letter", name[2]))
        n = 3
        deviations = value[:, None, None] + self.rng.normal(0.0, self.noise, (value.size, n, 2))
        options = {"modulo": axis == "C", "systematic": 0.05} | how
        return Measurement(name, axis, UNITS[axis], PLACES[axis], deviations, **options)  # type: ignore[arg-type]

    def angle(self, name: str, lean: float = 0.0) -> Measurement:
        at = PLACES[name[2]]
        wave = {"A": -np.sin(np.deg2rad(at)), "B": np.cos(np.deg2rad(at))}.get(name[1], 0.0 * at)
        return self.read(name, self.motion(name, at) + (lean * wave if name[2] == "C" else 0.0) + 7.0)

    def length(
        self, name: str, offset: tuple[float, float, float] | None = None, slope: float = 0.0, eccentric: float = 0.0
    ) -> Measurement:
        at, axis = PLACES[name[2]], name[2]
        a, b, c = (self.motion(f"E{way}{axis}", at) * ARCSEC * 1e3 for way in "ABC")
        x, y, z = offset or (0.0, 0.0, 0.0)
        lever = {"X": b * z - c * y, "Y": c * x - a * z, "Z": a * y - b * x}[name[1]]
        wave = {"X": np.cos(np.deg2rad(at)), "Y": np.sin(np.deg2rad(at)), "Z": 0.0 * at}[name[1]]
        more = eccentric * wave if axis == "C" else slope * (at - at[0])
        return self.read(name, self.motion(name, at) + lever + more - 11.0, offset_mm=offset)

    def square(self, own: float, lean: float) -> list[Measurement]:
        """All four runs; the square leans differently once it is turned over."""
        found = []
        for turned, tilt in (("", lean), ("-R", -0.4 * lean)):
            angle = own if not turned else -own
            along_x = self.motion("EZX", X) + tilt * ARCSEC * 1e3 * X
            along_z = self.motion("EXZ", Z) + (self.B0Z + angle - tilt) * ARCSEC * 1e3 * Z
            found.append(self.read(f"B0Z{turned}", along_x, letter="X"))
            found.append(self.read(f"B0Z{turned}", along_z, letter="Z"))
        return found

    def bar(self, name: str, lean: float) -> list[Measurement]:
        across = self.motion("EYZ" if name == "A0C" else "EXZ", Z)
        found = []
        for sign, place in ((1.0, 0.0), (-1.0, 180.0)):
            tilt = sum(self.motion(f"E{name[0]}{axis}", np.array([q]))[0] for axis, q in (("X", STOOD), ("C", place)))
            slope = self.A0C + tilt if name == "A0C" else self.B0Z - self.B0C - tilt
            reading = across + (slope + sign * lean) * ARCSEC * 1e3 * Z
            found.append(self.read(name, reading, letter="Z", turned_deg=place, stands={"X": STOOD}))
        return found

    def table_lean(self, name: str) -> float:
        """A0C or B0C as the model tells it: X's tilt at its reference and C's mean tilt belong to it."""
        own = self.A0C if name == "A0C" else self.B0C
        return own + float(self.motion(f"E{name[0]}X", np.array([0.0]))[0])
