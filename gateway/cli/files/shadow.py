"""The command `shadow`: a corrected copy of the builder's own NC program."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from drivers.message import Message
from gateway.cli.options import JsonOption, open_run
from gateway.cli.output import echo, show_json, show_table

_FRAME = re.compile(r"(G5[4-7])[:=](.+)")
_VALUE = re.compile(r"([A-Z])=([+-]?(?:\d+\.?\d*|\.\d+))")


def shadow_command(
    program: Annotated[Path, typer.Argument(help="NC program of the builder.", show_default=False)],
    site: Annotated[Path, typer.Option(help="Site file (TOML).")],
    run: Annotated[
        str, typer.Option(help="Run with the proposal or the error model: folder, id or latest.")
    ] = "latest",
    out: Annotated[
        Path | None,
        typer.Option(help="File for the copy; without it NAME-corrected in the program's folder.", show_default=False),
    ] = None,
    frame: Annotated[
        list[str] | None, typer.Option(help="A settable frame that the program uses: G54:X=-160,Z=12.5; repeat it.")
    ] = None,
    velocity: Annotated[list[str] | None, typer.Option(help="Most of an axis, mm/min or deg/min: X=30000.")] = None,
    acceleration: Annotated[list[str] | None, typer.Option(help="Most of an axis, m/s2 or rev/s2: X=1.5.")] = None,
    tolerance: Annotated[float, typer.Option(min=0.01, max=10.0, help="Chord tolerance, um.")] = 0.1,
    model: Annotated[
        bool, typer.Option("--model", help="By the run's error model, X(Z, C) and C(Z, C), not by its tables.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a copy of an NC program whose commanded positions carry the correction; nothing goes to the control."""
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.shadowing import ShadowOptions, shadow_program

    options = ShadowOptions(
        frames=dict(map(_frame, frame or [])),
        velocity=dict(map(_value, velocity or [])),
        acceleration=dict(map(_value, acceleration or [])),
        chord_um=tolerance,
        by_model=model,
    )
    tree = load_site(site)
    folder = open_run(store_of(tree, site), run, "errors" if model else "proposal")
    target = out or program.with_name(f"{program.stem}-corrected{program.suffix}")
    found = shadow_program(tree, site, run=folder, program=program, out=target, options=options)
    if as_json:
        show_json(found.as_data())
        return
    show_table(
        Message.of("S-SHADOW-TITLE"), ("line", "axis", "original", "copy", Message.of("S-UNIT-UM-ARCSEC")), found.rows
    )
    for line in found.lines:
        echo(line)
    echo(f"picture: {found.picture}")


def _frame(text: str) -> tuple[str, dict[str, float]]:
    whole = _FRAME.fullmatch(text.strip().upper())
    if whole is None:
        raise typer.BadParameter(f"{text!r} is not like G54:X=-160,Z=12.5", param_hint="--frame")
    return whole[1], dict(_value(one, "--frame") for one in whole[2].split(","))


def _value(text: str, option: str = "--velocity, --acceleration") -> tuple[str, float]:
    one = _VALUE.fullmatch(text.strip().upper())
    if one is None:
        raise typer.BadParameter(f"{text!r} is not like X=30000", param_hint=option)
    return one[1], float(one[2])
