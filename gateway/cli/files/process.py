"""The commands of the grinding process: `inspect separate` parts by cause, `inspect redress` the wheel from them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.machine.tooth import HEIGHTS, show_lines, show_separation
from gateway.cli.options import JsonOption
from gateway.cli.output import echo, show_json
from gateway.workflow.files.headers import columns_of

GearArgument = Annotated[Path, typer.Argument(help="Gear file (TOML).", show_default=False)]
FilesArgument = Annotated[
    list[Path],
    typer.Argument(help="Files of flank points, one a part, all ground after one dressing.", show_default=False),
]
OrderOption = Annotated[
    str,
    typer.Option(help="Order in which the spaces were ground: unknown, ascending, descending, or numbers 0,7,14,..."),
]
HeightsOption = Annotated[str, typer.Option(help="Zero of the heights in the files: lower-face or middle.")]
ColumnsOption = Annotated[list[str] | None, typer.Option("--column", help="NAME=VALUE of the files' column map.")]


def separate_command(
    gear: GearArgument,
    files: FilesArgument,
    order: OrderOption = "unknown",
    heights: HeightsOption = "lower-face",
    column: ColumnsOption = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw shares and wheel form into this file.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Separate the deviations of inspected parts by cause: wheel, dresser, set-up, axes, clamping, wear, rest."""
    from gateway.workflow.tooth.processing import separate_files

    show_separation(separate_files(gear, files, how=_how(heights, column), order=order), plot, as_json=as_json)


def redress_command(
    gear: GearArgument,
    files: FilesArgument,
    dresser: Annotated[Path, typer.Option(help="Dresser file (TOML): columns, units, sign, diamond.")],
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("wheel"),
    step: Annotated[
        bool, typer.Option("--step", help="Write a known small step in place of the correction: it proves the sense.")
    ] = False,
    before: Annotated[
        list[Path] | None,
        typer.Option(help="Part ground before the step was dressed; the FILES are ground after it. Judges the sense."),
    ] = None,
    dxf: Annotated[bool, typer.Option("--dxf", help="Write a drawing, too.")] = False,
    order: OrderOption = "unknown",
    heights: HeightsOption = "lower-face",
    column: ColumnsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Correct the wheel's axial profile from measured flanks: points, CSV, DXF and a table for the dresser."""
    from gateway.workflow.tooth.processing import prove_files, redress_files

    how = _how(heights, column)
    if before:
        if step:
            raise typer.BadParameter("give either --step or --before", param_hint="--step, --before")
        proved = prove_files(gear, before, files, dresser_path=dresser, how=how)
        show_lines(proved, as_json=as_json)
        return
    found = redress_files(gear, files, dresser, out, how=how, order=order, step=step, dxf=dxf)
    if as_json:
        show_json(found.as_data())
        return
    for line in found.lines:
        echo(line)
    for path in found.files:
        echo(f"file: {path}")


def _how(heights: str, column: list[str] | None) -> Any:
    from gateway.workflow.tooth.pairing import DiscFile

    if heights not in HEIGHTS:
        raise typer.BadParameter(f"{heights!r} is none of {', '.join(HEIGHTS)}", param_hint="--heights")
    zero: Any = heights
    return DiscFile(zero, columns_of(column or []) or None)
