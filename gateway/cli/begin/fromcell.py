"""The site file of a shipped simulated cell, with what each key means: an example that can be run."""

from __future__ import annotations

import tomllib
from pathlib import Path

from drivers.errors import words


def cell_text(cell: str, file: Path) -> str:
    """Start the cell for a moment, take its site file, explain it. Raises ConfigError (E-CLI-CELL)."""
    from gateway.cli.demonstration import CellAsked, cell_process
    from gateway.config import site_text

    site = file.resolve().parent / f"{cell}-cell" / "site.toml"
    with cell_process(CellAsked(cell, site, 1.0, plan=True)):
        tree = tomllib.loads(site.read_text(encoding="utf-8"))
    return site_text(tree, words("P-INIT-CELL-HEAD", cell=cell, site=site))
