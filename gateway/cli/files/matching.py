"""The command that pairs inspected discs: `trueflank match GEAR FILE FILE ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.machine.inspecting import HEIGHTS
from gateway.cli.options import JsonOption
from gateway.cli.show import echo, show_json, show_table
from gateway.workflow.files.headers import columns_of


def match_command(
    gear: Annotated[Path, typer.Argument(help="Gear file (TOML) with a [reducer].", show_default=False)],
    files: Annotated[list[Path], typer.Argument(help="Files of flank points, one a disc.", show_default=False)],
    mark: Annotated[
        list[int] | None,
        typer.Option(
            help="Tooth position of the second disc that its holes allow; repeat it. Without it all are tried."
        ),
    ] = None,
    heights: Annotated[
        str, typer.Option(help="Zero of the heights in the files: lower-face or middle.")
    ] = "lower-face",
    column: Annotated[list[str] | None, typer.Option(help="NAME=VALUE of the files' column map.")] = None,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Expected figures with u too: inspection, pins and cranks are drawn.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Pair inspected discs for the least transmission error: who with whom, and in which tooth position."""
    from gateway.workflow.tooth.pairing import DiscFile, match_files

    if heights not in HEIGHTS:
        raise typer.BadParameter(f"{heights!r} is none of {', '.join(HEIGHTS)}", param_hint="--heights")
    zero: Any = heights
    how = DiscFile(zero, columns_of(column or []) or None)
    found = match_files(gear, files, how, marks=mark, sure=uncertainty)
    if as_json:
        show_json(found.as_data())
        return
    heads = ["first", "second", "mark", "angle deg", "transmission arcsec", "lost motion arcsec"]
    heads += ["backlash arcsec", "stiffness Nm/arcmin"]
    rows = []
    for pair in found.pairs:
        row = [pair.first, pair.second, str(pair.mark), f"{pair.mark_deg:.3f}"]
        row += [f"{pair.figures.error_arcsec:.2f}", f"{pair.figures.lost_motion:.2f}"]
        row += [f"{pair.figures.backlash:.2f}", f"{pair.figures.stiffness_nm_arcmin:.4g}"]
        if pair.expected is not None:
            row += [
                f"{one.mean:.2f} ± {one.u:.2f}"
                for one in (pair.expected["error_arcsec"], pair.expected["lost_motion_arcsec"])
            ]
        rows.append(tuple(row))
    if uncertainty:
        heads += ["expected transmission ± u", "expected lost motion ± u"]
    show_table("drives, by the full model", tuple(heads), rows)
    for disc in found.discs:
        echo(f"{disc.part}: RMS {disc.fitted.rms_um:.2f} um, u {disc.rms_u_um:.2f} um")
    for line in found.lines:
        echo(line)
