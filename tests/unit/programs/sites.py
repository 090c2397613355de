"""Sites of every shipped cell, as files, without their cells running."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

from simulators.cell.site import gear_text, site_text
from simulators.cellfile import load_cell, with_plan

CELLS = sorted(
    entry.name.removesuffix(".toml")
    for entry in resources.files("simulators").joinpath("cells").iterdir()
    if entry.name.endswith(".toml")
)


def site_file(folder: Path, cell: str, *, plan: bool = True, **settings: Any) -> Path:
    """A shipped cell's site file in ``folder``; ``plan``: with every set-up and the work."""
    found = with_plan(load_cell(cell)) if plan else load_cell(cell)
    gear = ""
    if found.part is not None:
        (folder / "gear.toml").write_text(gear_text(found.part), encoding="utf-8")
        gear = str(folder / "gear.toml")
    control = {"url": "opc.tcp://127.0.0.1:1", "settings": {"security": "None", **settings}}
    urls = {one.name: "tcp://127.0.0.1:1" for one in found.instruments}
    path = folder / "site.toml"
    path.write_text(site_text(found, found.machine.serial, control, urls, gear), encoding="utf-8")
    return path
