"""The command `convert`: measured files, tables and errors into files that a control or another program reads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivers.terms import spoken
from gateway.cli.options import (
    AcceptOption,
    AskOption,
    ColumnOption,
    JsonOption,
    StatementOption,
    StoreOption,
    TodayAlone,
    accepted_doubts,
)

WORDS = spoken()


def convert(
    result: Annotated[
        Path, typer.Argument(help="Measured result file, a file in the format of --from, or a run.", show_default=False)
    ],
    to: Annotated[
        str,
        typer.Option(
            help=f"{WORDS.own_key} (mean of both directions), {WORDS.cross_key} (a pair by direction), linuxcnc, "
            "twincat, heidenhain, axeserr, aerotech, table-csv; errors of a machine: isg-volumetric, "
            "etalon-exchange, error-csv."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help=f"File to write: {WORDS.suffixes}.")],
    axis: Annotated[str, typer.Option(help=f"Machine axis name, {WORDS.axis_name}.", show_default=False)] = "",
    origin: Annotated[
        str,
        typer.Option(
            "--from",
            help="Format of the file: tables (of the control), fanuc, or one of the names of --to.",
            show_default=False,
        ),
    ] = "",
    reference: Annotated[
        float | None, typer.Option(help="Machine position where the table must be zero.", show_default=False)
    ] = None,
    datum: Annotated[
        list[str] | None,
        typer.Option(help="FILE=MACHINE position; twice if their directions are opposite.", show_default=False),
    ] = None,
    minimum: Annotated[float | None, typer.Option("--min", help="First point.", show_default=False)] = None,
    maximum: Annotated[float | None, typer.Option("--max", help="Last point.", show_default=False)] = None,
    step: Annotated[float | None, typer.Option(help="Distance of the points.", show_default=False)] = None,
    modulo: Annotated[bool, typer.Option("--modulo", help="Endless rotary axis, 0 to 360 deg.")] = False,
    unit: Annotated[str, typer.Option(help="Unit of the deviations, if the file does not state it.")] = "",
    column: ColumnOption = None,
    index: Annotated[
        int, typer.Option(min=0, help=f"Encoder ({WORDS.own_key}: 0 or 1) or first table number ({WORDS.cross_key}).")
    ] = 0,
    form: Annotated[
        str,
        typer.Option(
            help="program, ini, axis-ini, archive or numbered; linuxcnc: trims or positions; twincat: whole or real; "
            "fanuc, heidenhain: error or correction; aerotech: mean."
        ),
    ] = "",
    accept_doubt: AcceptOption = None,
    accept: StatementOption = None,
    ask: AskOption = True,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Make a table file of a measured result file (the datum must be given), or turn tables and errors into others."""
    from gateway.cli.files.convert import ConversionOptions, convert_file

    wish = ConversionOptions(
        result=result,
        to=to,
        axis=axis,
        reference=reference,
        datum=tuple(datum or ()),
        minimum=minimum,
        maximum=maximum,
        step=step,
        modulo=modulo,
        unit=unit,
        index=index,
        form=form,
        output=output,
        force=force,
        origin=origin,
        store=store,
        accepted=accepted_doubts(accept_doubt),
        columns=tuple(column or ()),
        compared=TodayAlone(tuple(accept or ()), ask and not as_json),
    )
    convert_file(wish, as_json=as_json)
