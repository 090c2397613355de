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

HOMES = {
    "benches": ("DriveTest", "EvaluatedDrive", "read_bench"),
    "drives": ("Drive", "Matched", "Reducer", "match", "transmission"),
    "inspected": ("Separated", "read_flank", "separate"),
    "kinematics": ("FrameOf", "RelativeError", "RelativeErrors"),
    "measuring": ("ErrorMotion", "Evaluated", "Measured", "evaluate", "fit", "read", "report"),
    "studies": ("Corrected", "Ranking", "Study", "correct", "rank", "study"),
    "surfaces": ("Contact", "Profile", "Surface", "Wheel"),
    "tooth": ("Flank", "Gear", "Machine", "contact", "flank"),
}
"""The module of each name."""
__all__ = [
    "Contact",
    "Corrected",
    "Drive",
    "DriveTest",
    "ErrorMotion",
    "Evaluated",
    "EvaluatedDrive",
    "Flank",
    "FrameOf",
    "Gear",
    "Machine",
    "Matched",
    "Measured",
    "Profile",
    "Ranking",
    "Reducer",
    "RelativeError",
    "RelativeErrors",
    "Separated",
    "Study",
    "Surface",
    "TrueflankError",
    "Wheel",
    "__version__",
    "contact",
    "correct",
    "evaluate",
    "fit",
    "flank",
    "interferometer",
    "match",
    "rank",
    "read",
    "read_bench",
    "read_flank",
    "report",
    "separate",
    "study",
    "transmission",
]


def __getattr__(name: str) -> object:
    """Load a name's module now; `trueflank/__init__.pyi` tells the names to type checkers."""
    found: object
    home = next((module for module, names in HOMES.items() if name in names), "")
    if home == "benches":
        from trueflank import benches as module
    elif home == "drives":
        from trueflank import drives as module
    elif home == "inspected":
        from trueflank import inspected as module
    elif home == "kinematics":
        from trueflank import kinematics as module
    elif home == "measuring":
        from trueflank import measuring as module
    elif home == "studies":
        from trueflank import studies as module
    elif home == "surfaces":
        from trueflank import surfaces as module
    elif home == "tooth":
        from trueflank import tooth as module
    elif name == "interferometer":
        import trueflank.interferometer as module
    elif name == "TrueflankError":
        from drivers import errors as module
    elif name == "__version__":
        from importlib.metadata import version

        globals()[name] = version("trueflank")
        return globals()[name]
    else:
        raise AttributeError(f"trueflank has no {name!r}; it has {', '.join(__all__)}")
    found = module if name == "interferometer" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """All names, for completion."""
    return sorted(__all__)
