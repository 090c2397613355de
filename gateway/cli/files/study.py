"""The commands `study` and `study match`: a gear on a machine, and discs paired for drives."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.message import Message, fixed
from drivers.terms import spoken
from gateway.cli.command_list import require_only
from gateway.cli.machine.tooth import HEIGHTS
from gateway.cli.options import JsonOption
from gateway.cli.output import echo, show_json, show_table
from gateway.workflow.files.headers import columns_of


def study_command(
    gear: Annotated[Path, typer.Argument(help="Gear file (TOML).", show_default=False)],
    errors: Annotated[
        Path, typer.Argument(help="Error file (TOML), a run's folder, or its errors.json.", show_default=False)
    ],
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures (PNG).", show_default=False)] = None,
    scheduler: Annotated[str, typer.Option(help="Dask scheduler, tcp://host:port.", show_default=False)] = "",
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Processes for the ranking.", show_default=False)
    ] = None,
    order: Annotated[
        str,
        typer.Option(help="Flank of the ranking: first, second or exact. With exact, before and after are exact too."),
    ] = "first",
    trajectories: Annotated[int, typer.Option(min=1, max=10_000, help="Morris trajectories.")] = 20,
    relative: Annotated[
        bool,
        typer.Option(
            "--relative",
            help="The six relative errors of wheel to work alone, without --paper; drawn into --plots, else here.",
        ),
    ] = False,
    paper: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the paper's figures and tables, and the disc as CSV and DXF.", show_default=False
        ),
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(
            help="Middle of the work's face in the coordinates of Z, mm, for a run; default: as its site file has it.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Work out a gear on a machine: each error alone, ranking, cures, before and after."""
    from gateway.study import describe
    from gateway.study.calculate import study, the_order
    from gateway.study.inputs import load_gear
    from gateway.study.workers import workers as open_workers
    from gateway.workflow.tooth.known_machine import known_machine

    if relative:
        require_only("study --relative")
        show_relative(gear, errors, plots or Path(), height, as_json=as_json)
        return
    gear_file, known, chosen = load_gear(gear), known_machine(errors, height), the_order(order)
    error_file = known.errors
    # A first-order sweep is over before a process has started.
    count = 1 if chosen == "first" and workers is None else workers
    with open_workers(scheduler, count) as executor:
        found = study(gear_file, error_file, executor=executor, order=chosen, r=trajectories, model=known.model)
    written: tuple[str, ...] = ()
    if plots is not None:
        from gateway.study.pictures import write_pictures

        written = tuple(str(path) for path in write_pictures(found, plots))
    if paper is not None:
        from gateway.study.evidence import evidence_of
        from gateway.study.paper import write_paper

        written += tuple(str(path) for path in write_paper(found, paper, evidence_of(errors)))
    if as_json:
        show_json({**describe.as_data(found), "pictures": list(written)})
        return
    echo(f"{gear_file.name} on {error_file.name}")
    headings = ("error", "RMS um", "largest um", "rank", "cured by", "here um", "left um")
    show_table(Message.of("S-STUDY-EACH"), headings, describe.error_rows(found))
    own = spoken().own
    show_table(
        Message.of("S-STUDY-BY-AXIS"),
        ("axis", Message.of("S-CLI-AS-IS"), own, f"{own} + {spoken().cross}", "unit"),
        describe.axis_rows(found),
    )
    show_table(
        Message.of("S-STUDY-BY-TOOTH"),
        ("value", Message.of("S-CLI-AS-IS"), own, "everything", "unit"),
        describe.tooth_rows(found),
    )
    if found.drive is not None:
        _show_drive(found.drive)
    setup = ", ".join(f"{name} {value:+.2f} {unit}" for name, value, unit in describe.setup_rows(found))
    lines = [
        f"set-up values: {setup}",
        *map(str, found.correction.said),
        *describe.floor_lines(found),
        *describe.product_lines(found),
        *describe.visible_lines(found),
    ]
    for line in (*lines, describe.next_line(found), describe.order_line(found)):
        echo(line)
    for path in written:
        echo(f"written: {path}" if Path(path).suffix != ".png" else f"picture: {path}")


def show_relative(gear: Path, errors: Path, folder: Path, height: float | None = None, *, as_json: bool) -> None:
    """Show the six relative errors of wheel to work where the gear is ground, and draw them into a folder."""
    from gateway.study.inputs import errors_from, load_gear
    from gateway.study.machine import grinding_of
    from gateway.study.pictures import write_relative
    from gateway.study.relative_errors import relative_data, relative_rows, relative_sweep

    gear_file, error_file = load_gear(gear), errors_from(errors, height)
    grinding = grinding_of(gear_file, error_file)
    sweep = relative_sweep(grinding)
    written = [str(path) for path in write_relative(grinding, sweep, folder)]
    if as_json:
        show_json({**relative_data(sweep), "pictures": written})
        return
    echo(f"{gear_file.name} on {error_file.name}")
    headings = ("error", "space 0", "least", "greatest", "RMS", "first order misses", "unit")
    title = Message.of("S-STUDY-RELATIVE")
    show_table(title, headings, relative_rows(sweep))
    for path in written:
        echo(f"picture: {path}")


def _show_drive(drive: Any) -> None:
    from drivers.errors import words
    from gateway.study.drive import drive_rows, state_rows
    from gateway.workflow.tooth.messages import measure_for_drive

    own = spoken().own
    headings = ("error", "constant: transmission", "lost motion", "here: transmission", "lost motion", "rank")
    title = Message.of("S-STUDY-DRIVE-FIRST")
    show_table(title, headings, drive_rows(drive))
    show_table(
        Message.of("S-STUDY-BY-DRIVE"),
        ("value", Message.of("S-CLI-AS-IS"), own, "everything", "unit"),
        state_rows(drive),
    )
    echo(
        words(
            "S-STUDY-DRIVE",
            name=drive.reducer.name,
            datum=drive.reducer.datum,
            missed=fixed(drive.missed_arcsec, 2, signed=True),
        )
    )
    for line in measure_for_drive(drive.doubts):
        echo(str(line))


# ---- match


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
    show_table(Message.of("S-STUDY-DRIVES"), tuple(heads), rows)
    for disc in found.discs:
        echo(f"{disc.part}: RMS {disc.fitted.rms_um:.2f} um, u {disc.rms_u_um:.2f} um")
    for line in found.lines:
        echo(line)
