"""The command that works out a gear on a machine: `trueflank study GEAR ERRORS`."""

from __future__ import annotations

from pathlib import Path

from drivers.terms import spoken
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
) -> None:
    """Work out a study and show it; pictures into ``plots`` if given."""
    from gateway.study import tell
    from gateway.study.files import load_errors, load_gear
    from gateway.study.work import study, the_order
    from gateway.study.workers import workers as open_workers

    gear_file, error_file, chosen = load_gear(gear), load_errors(errors), the_order(order)
    # A first-order sweep is over before a process has started.
    count = 1 if chosen == "first" and workers is None else workers
    with open_workers(scheduler, count) as executor:
        found = study(gear_file, error_file, executor=executor, order=chosen, r=trajectories)
    written: tuple[str, ...] = ()
    if plots is not None:
        from gateway.study.pictures import write_pictures

        written = tuple(str(path) for path in write_pictures(found, plots))
    if as_json:
        show_json({**tell.as_data(found), "pictures": list(written)})
        return
    echo(f"{gear_file.name} on {error_file.name}")
    headings = ("error", "RMS um", "largest um", "rank", "cured by", "here um", "left um")
    show_table("each error: alone at 5 um or 0.01 deg; in this machine", headings, tell.error_rows(found))
    own = spoken().own
    show_table("by axis (range)", ("axis", "as it is", own, f"{own} + {spoken().cross}", "unit"), tell.axis_rows(found))
    show_table("by tooth (predicted)", ("value", "as it is", own, "everything", "unit"), tell.tooth_rows(found))
    setup = ", ".join(f"{name} {value:+.2f} {unit}" for name, value, unit in tell.setup_rows(found))
    lines = [
        f"set-up values: {setup}",
        *found.correction.said,
        *tell.floor_lines(found),
        *tell.product_lines(found),
        *tell.visible_lines(found),
    ]
    for line in (*lines, tell.next_line(found), tell.order_line(found)):
        echo(line)
    for path in written:
        echo(f"picture: {path}")
