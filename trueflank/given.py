"""What a caller gives, judged before anything is reckoned: its kind, its name, its units."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.units import AxisUnit, DeviationUnit
from gateway.domain.values import FloatArray, component_unit

MOTION = re.compile(r"E[XYZABC][XYZUVWABC]")
TURNING = "ABC"
MOST_SHOWN = 40
HOW = {
    "Measured": Message.of("W-LIB-READ"),
    "Machine": Message.of("W-LIB-MACHINE"),
    "Flank": "tf.flank(machine, gear)",
    "Reducer": Message.of("W-LIB-REDUCER"),
    "Gear": Message.of("W-LIB-GEAR"),
}
ASKS = {
    "E-IMPORT-COLUMNS": "E-LIBRARY-COLUMNS",
    "E-IMPORT-WAYS": "E-LIBRARY-WAYS",
    "E-IMPORT-RUNS": "E-LIBRARY-RUNS",
    "E-IMPORT-READINGS": "E-LIBRARY-READINGS",
    "E-IMPORT-CHOOSE": "E-LIBRARY-SEVERAL",
    "E-IMPORT-SHEET": "E-LIBRARY-SHEET",
}
"""What is asked about a table, by the code of the command line; here the answer is an argument of `read`."""


def of_kind(one: Any, wanted: type, call: str) -> None:
    """Raise ConfigError (E-LIBRARY-KIND) where an argument is something else, say machine and gear exchanged."""
    if not isinstance(one, wanted):
        name = wanted.__name__
        raise ConfigError(
            "E-LIBRARY-KIND", call, call=f"tf.{call}", wanted=f"a tf.{name}", given=_said(one), how=HOW[name]
        )


def path_given(one: Any, call: str) -> None:
    """Raise ConfigError (E-LIBRARY-KIND) where a path is no text and no path."""
    if not isinstance(one, str) and not hasattr(one, "__fspath__"):
        how = Message.of("W-LIB-FILE-NAME")
        raise ConfigError("E-LIBRARY-KIND", call, call=f"tf.{call}", wanted="a path", given=_said(one), how=how)


def wholes_given(call: str, **given: Any) -> None:
    """Raise ConfigError (E-LIBRARY-KIND) where a seed or a count is no whole number of 0 or more."""
    for name, one in given.items():
        if isinstance(one, bool) or not isinstance(one, int | np.integer) or one < 0:
            how = Message.of("W-LIB-WHOLE")
            raise ConfigError("E-LIBRARY-KIND", call, call=f"tf.{call}", wanted=name, given=_shown(one), how=how)


def numbers_given(positions: Any, unit: AxisUnit, call: str) -> FloatArray:
    """Positions as finite numbers, of any shape. Raises ConfigError (E-LIBRARY-KIND) for anything else."""
    return plain_numbers(positions, call, what="positions", unit=f", in {unit}")


def plain_numbers(
    values: Any, call: str, *, what: str = "numbers", unit: str = "", missing: bool = False
) -> FloatArray:
    """Real numbers of any shape, finite unless NaN may stand for what is ``missing``.

    Raises ConfigError (E-LIBRARY-KIND) for anything else: texts, truth values, complex numbers, masked arrays.
    """
    unmasked_given(values, call)
    try:
        found = np.asarray(values)
    except ValueError:  # rows of different lengths
        found = np.asarray("")
    bad = found.size and (found.dtype.kind not in "iuf" or np.any(np.isinf(found) if missing else ~np.isfinite(found)))
    if bad:
        how = Message.of("W-LIB-NUMBER", unit=unit)
        raise ConfigError("E-LIBRARY-KIND", call, call=call, wanted=what, given=_shown(values), how=how)
    return np.asarray(found, dtype=np.float64)


def real_given(values: Any, call: str) -> None:
    """Raise ConfigError (E-LIBRARY-KIND) for what numpy would take and change: masked, complex, truth values, times."""
    unmasked_given(values, call)
    parts = values if isinstance(values, list | tuple) else (values,)
    if any(np.iscomplexobj(one) for one in parts):
        how = Message.of("W-LIB-REAL")
        raise ConfigError("E-LIBRARY-KIND", call, call=call, wanted="numbers", given="complex numbers", how=how)
    kinds = {one.dtype.kind for one in parts if isinstance(one, np.ndarray | np.generic)} & set("bmM")
    if kinds or (parts is values and any(isinstance(one, bool) for one in parts)):
        given = "times" if kinds & set("mM") else "truth values"
        how = Message.of("W-LIB-PLAIN-NUMBERS")
        raise ConfigError("E-LIBRARY-KIND", call, call=call, wanted="numbers", given=given, how=how)


def unmasked_given(values: Any, call: str) -> None:
    """Raise ConfigError (E-LIBRARY-KIND) for a masked array: numpy would take what lies under its mask."""
    parts = values if isinstance(values, list | tuple) else (values,)
    if any(isinstance(one, np.ma.MaskedArray) for one in parts):
        how = Message.of("W-LIB-MASKED")
        raise ConfigError("E-LIBRARY-KIND", call, call=call, wanted="numbers", given="a masked array", how=how)


def _shown(one: Any) -> str:
    text = repr(one)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."


def _said(one: Any) -> str | Message:
    kind = type(one)
    return (
        f"a tf.{kind.__name__}"
        if kind.__module__.startswith("trueflank")
        else Message.of("W-LIB-TYPE", name=kind.__name__)
    )


def motion_name(name: Any, call: str) -> str:
    """The ISO 230-1 name of an error motion. Raises ConfigError (E-LIBRARY-NAME)."""
    if not isinstance(name, str) or not MOTION.fullmatch(name):
        raise ConfigError("E-LIBRARY-NAME", call, name=name)
    return name


def axis_unit_of(name: str) -> AxisUnit:
    """The unit of positions of the axis whose error motion this is."""
    return "deg" if name[2] in TURNING else "mm"


def units_fit(name: str, axis_unit: AxisUnit, unit: DeviationUnit, call: str) -> None:
    """Raise ConfigError (E-LIBRARY-UNIT) where readings in these units cannot be error motion ``name``."""
    axis = axis_unit_of(name)
    wanted = component_unit(name, axis)
    if (axis, wanted) != (axis_unit, unit):
        raise ConfigError(
            "E-LIBRARY-UNIT", call, name=name, wanted=f"{wanted} over {axis}", given=f"{unit} over {axis_unit}"
        )
