"""Static memory: what survives power off, as plain values that go into a file and back.

Tables, machine and setting data, R parameters, global user data and program files survive; references of
incremental encoders, the mode and the program under execution do not.
"""

from __future__ import annotations

from typing import Any

from simulators.nck.machine.core import Core
from simulators.nck.machine.files import FileSystem

FORMAT = 1


def saved(core: Core, files: FileSystem, selected: str) -> dict[str, Any]:
    """The content of static memory; fit for JSON."""
    return {
        "format": FORMAT,
        "axes": [axis.name for axis in core.spec.axes],
        "data": core.data.saved(),
        "tables": core.memory.saved(),
        "r": list(core.r),
        "gud": {name: list(values) for name, values in core.gud.items()},
        "files": files.saved(),
        "selected": selected,
    }


def restore(content: dict[str, Any], core: Core, files: FileSystem) -> str:
    """Fill static memory before the control is switched on; returns the selected program.

    Raises ValueError for the memory of another control or another format.
    """
    if content.get("format") != FORMAT or content.get("axes") != [axis.name for axis in core.spec.axes]:
        raise ValueError("this static memory belongs to another control")
    core.data.restore(content["data"])
    core.memory.restore(content["tables"])
    core.r[:] = content["r"]
    core.gud.update({name: list(values) for name, values in content["gud"].items()})
    files.restore(content["files"])
    return str(content["selected"])
