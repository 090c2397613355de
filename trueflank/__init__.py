"""What a scientist needs of trueflank, in one place: files, figures, machine errors, tooth flanks, tables, drives.

Units at this surface, everywhere: mm for lengths and positions, um for deviations, deg for angles of axes, arcsec for
deviations of angles. Deviation = measured - target; an error motion is actual - nominal under its ISO 230-1 name.
Normal deviations of a flank are positive for surplus material. Names are loaded when they are first used.

    import trueflank as tf

    measured = tf.read("X-axis.rtl")
    print(tf.evaluate(measured))
    machine = tf.Machine({"EXX": tf.fit(measured, "EXX")})
    print(tf.flank(machine, tf.Gear.load("gear.toml")))
"""

from __future__ import annotations

MEASURING = ("ErrorMotion", "Evaluated", "Measured", "evaluate", "fit", "read", "report")
TOOTH = ("Flank", "Gear", "Machine", "flank")
DRIVES = ("Drive", "Matched", "Reducer", "match", "transmission")
STUDIES = ("Corrected", "Ranking", "Studied", "correct", "rank", "study")
__all__ = [
    "Corrected",
    "Drive",
    "ErrorMotion",
    "Evaluated",
    "Flank",
    "Gear",
    "Machine",
    "Matched",
    "Measured",
    "Ranking",
    "Reducer",
    "Studied",
    "TrueflankError",
    "correct",
    "evaluate",
    "fit",
    "flank",
    "match",
    "rank",
    "read",
    "report",
    "study",
    "transmission",
]


def __getattr__(name: str) -> object:
    """Load a name's module now; `trueflank/__init__.pyi` tells the names to type checkers."""
    found: object
    if name in MEASURING:
        from trueflank import measuring

        found = getattr(measuring, name)
    elif name in TOOTH:
        from trueflank import tooth

        found = getattr(tooth, name)
    elif name in DRIVES:
        from trueflank import drives

        found = getattr(drives, name)
    elif name in STUDIES:
        from trueflank import studies

        found = getattr(studies, name)
    elif name == "TrueflankError":
        from drivers.errors import TrueflankError

        found = TrueflankError
    else:
        raise AttributeError(f"trueflank has no {name!r}; it has {', '.join(__all__)}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """All names, for completion."""
    return sorted(__all__)
