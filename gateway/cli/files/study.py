"""The command that works out a gear on a machine: `trueflank study GEAR ERRORS`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.terms import spoken
from gateway.cli.modes import only
from gateway.cli.show import echo, show_json, show_table


def study_command(
    gear: Path,
    errors: Path,
    *,
    plots: Path | None,
    scheduler: str,
    workers: int | None,
    order: str,
    trajectories: int,
    as_json: bool,
    relative: bool = False,
    paper: Path | None = None,
    height: float | None = None,
) -> None:
    """Work out a study and show it; pictures into ``plots``, the paper's figures and tables into ``paper``."""
    from gateway.study import describe
    from gateway.study.calculate import study, the_order
    from gateway.study.inputs import load_gear
    from gateway.study.workers import workers as open_workers
    from gateway.workflow.tooth.known_machine import known_machine

    if relative:
        only("study --relative")
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
    show_table("each error: alone at 5 um or 0.01 deg; in this machine", headings, describe.error_rows(found))
    own = spoken().own
    show_table(
        "by axis (range)", ("axis", "as it is", own, f"{own} + {spoken().cross}", "unit"), describe.axis_rows(found)
    )
    show_table("by tooth (predicted)", ("value", "as it is", own, "everything", "unit"), describe.tooth_rows(found))
    if found.drive is not None:
        _tell_drive(found.drive)
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
    title = "relative errors of wheel to work, told in the work: every space, over the face"
    show_table(title, headings, relative_rows(sweep))
    for path in written:
        echo(f"picture: {path}")


def _tell_drive(drive: Any) -> None:
    from drivers.errors import words
    from gateway.study.drive import drive_rows, state_rows
    from gateway.workflow.tooth.messages import measure_for_drive

    own = spoken().own
    headings = ("error", "constant: transmission", "lost motion", "here: transmission", "lost motion", "rank")
    title = "the drive in arcsec, first order: each error alone, constant at 5 um or 0.01 deg, and as it is here"
    show_table(title, headings, drive_rows(drive))
    show_table("by drive (full model)", ("value", "as it is", own, "everything", "unit"), state_rows(drive))
    echo(
        words("S-STUDY-DRIVE", name=drive.reducer.name, datum=drive.reducer.datum, missed=f"{drive.missed_arcsec:+.2f}")
    )
    for line in measure_for_drive(drive.doubts):
        echo(str(line))
