"""What people said of a calibration day's files, kept in one TOML file beside the folder: said once, never asked again.

Three places: [all] holds for every file, [axes.X1] for the files of an axis, [files."x.rta"] for one file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError
from drivers.local.names import guess, shown
from drivers.local.textfile import read_toml
from gateway.config.writing import written
from gateway.store.disk import write_whole

Value = str | int | float | bool | list[Any] | dict[str, Any]
ALL = "all"
KEYS: Mapping[str, tuple[type, ...]] = {
    "use": (bool,),
    "error": (str,),
    "axis": (str,),
    "unit": (str,),
    "columns": (str,),
    "datum": (int, float),
    "direction": (str,),
    "sense": (str,),
    "park": (int, float, dict),
    "U": (int, float),
    "offset": (list,),
    "own_angle": (int, float, str),
    "material_degc": (int, float, str),
    "accept_doubts": (dict,),
    "accept": (list,),
    "feed": (int, float),
    "overrun": (int, float),
    "dwell_s": (int, float),
    **dict.fromkeys(("cycle", "tables", "warm_up", "other_axes", "offsets", "sensors", "instrument"), (str,)),
}
FARTHEST = 1e6
"""The largest number an answer can be, mm, deg, um or arcsec: a kilometre."""
HOTTEST, COLDEST = 100.0, -50.0
"""degC that a machine's material can have."""
UNKNOWN = "unknown"
"""Said of a square's own angle where nobody knows it."""
SQUAREST = 80.0
"""The largest own angle, arcsec: more is an angle in degrees, or no square."""
_MOTION = re.compile(r" E[XYZABC][XYZABCUVW]\Z")  # one motion of a table with several: answers for the file count too
_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, slots=True)
class Answers:
    """Values by place ("all", "axes.X1", "files.x.rta") and key; ``where`` is the file they stand in."""

    where: str
    said: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)

    def of(self, key: str, name: str, axis: str = "") -> Any:
        """The answer for one file: its own, that of its axis, that for all; None where nobody said."""
        for place in (f"files.{name}", f"files.{_MOTION.sub('', name)}", f"axes.{axis}", ALL):
            if key in self.said.get(place, {}):
                return self.said[place][key]
        return None

    def plus(self, place: str, key: str, value: Value) -> Answers:
        """With one answer more."""
        return Answers(self.where, {**self.said, place: {**self.said.get(place, {}), key: value}})

    @property
    def text(self) -> str:
        """As the file has it."""
        lines = ["# What the files of a calibration day cannot say: `trueflank day` asks it once."]
        for place, values in self.said.items():
            lines += ["", section(place), *(f"{key} = {written(value)}" for key, value in values.items())]
        return "\n".join(lines) + "\n"


def section(place: str) -> str:
    """The heading of a place in the file: [all], [axes.X1], [files."x.rta"]."""
    kind, _, name = place.partition(".")
    if not name:
        return f"[{kind}]"
    return f"[{kind}.{name if _BARE.fullmatch(name) else written(name)}]"


def beside(folder: Path) -> Path:
    """Where a folder's answers are kept unless somebody says otherwise."""
    whole = folder.resolve()
    return whole.with_name(f"{whole.name}.answers.toml")


def read_answers(path: Path) -> Answers:
    """The answers kept so far; none where there is no file. Raises ConfigError (E-DAY-ANSWERS, E-DAY-KEY)."""
    where = str(path)
    try:
        tree = read_toml(path)
    except FileNotFoundError:
        return Answers(where)
    except (OSError, ValueError) as error:
        raise ConfigError("E-DAY-ANSWERS", where, why=str(error)) from error
    said: dict[str, dict[str, Value]] = {}
    for kind, values in tree.items():
        if not isinstance(values, dict) or kind not in (ALL, "axes", "files"):
            raise ConfigError("E-DAY-ANSWERS", where, why=f"{shown(kind)} is none of [all], [axes.NAME], [files.NAME]")
        for name, own in {"": values}.items() if kind == ALL else values.items():
            place = f"{kind}.{name}" if name else kind
            said[place] = _judged(own, place, where)
    return Answers(where, said)


def _judged(own: Any, place: str, where: str) -> dict[str, Value]:
    if not isinstance(own, dict):
        raise ConfigError("E-DAY-ANSWERS", where, why=f"{shown(place)} holds no keys")
    for key, value in own.items():
        wanted = KEYS.get(key)
        if wanted is None:
            known = ", ".join(KEYS) + guess(key, list(KEYS))
            raise ConfigError("E-DAY-KEY", where, place=shown(place), key=shown(key), known=known)
        right = isinstance(value, wanted) and (not isinstance(value, bool) or bool in wanted)
        if not right or not all(possible(one) for one in _numbers(value)):
            needs = " or ".join(one.__name__ for one in wanted)
            needs += f", from -{FARTHEST:g} to {FARTHEST:g}" if right else ""
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
        if key == "accept_doubts" and not all(isinstance(one, str) and one.strip() for one in value.values()):
            needs = "a reason for each code"
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
        if key == "material_degc" and value != UNKNOWN and (isinstance(value, str) or not COLDEST <= value <= HOTTEST):
            needs = f"degC from {COLDEST:g} to {HOTTEST:g}, {UNKNOWN}"
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
        if key == "own_angle" and value != UNKNOWN and (isinstance(value, str) or abs(value) > SQUAREST):
            needs = f"arcsec from -{SQUAREST:g} to {SQUAREST:g}, {UNKNOWN}"
            raise ConfigError("E-DAY-ANSWER", where, place=shown(place), key=key, value=shown(str(value)), known=needs)
    return dict(own)


def keep(answers: Answers) -> None:
    """Write the answers; what stood there gives way. Raises StoreError (E-STORE-DISK)."""
    write_whole(Path(answers.where), answers.text.encode())


def possible(number: float) -> bool:
    """Whether a number can be a place, an offset or an uncertainty: finite, and no more than `FARTHEST`."""
    return math.isfinite(number) and abs(number) <= FARTHEST


def _numbers(value: object) -> list[float]:
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]
    return [one for one in inside if isinstance(one, int | float) and not isinstance(one, bool)]
