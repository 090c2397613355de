"""The command `evaluate`: its options, and which evaluation they ask for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from gateway.cli.command_list import require_only
from gateway.cli.options import (
    AcceptOption,
    AskOption,
    ColumnOption,
    DateComparison,
    JsonOption,
    StatementOption,
    StoreOption,
    accepted_doubts,
    load_site,
    statement_comparison,
)


def evaluate_command(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Result files, folders of them, or runs.", show_default=False)
    ] = None,
    standard: Annotated[str, typer.Option(help="Standard by name, or an edition of ISO 230-2; list: all.")] = "2014",
    unit: Annotated[str, typer.Option(help="Unit of an .rta's deviations: mrad, urad, arcsec or deg.")] = "",
    column: ColumnOption = None,
    limit: Annotated[list[str] | None, typer.Option(help="Judge a parameter: A=10. May be repeated.")] = None,
    air: Annotated[str, typer.Option(help="Re-compensate: edlen, ciddor or edlen-1966.")] = "",
    expansion: Annotated[float | None, typer.Option(min=-5, max=100, help="Re-compensate: ppm/K.")] = None,
    material_degc: Annotated[float | None, typer.Option(help="Material, degC: for U, and to re-compensate.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the Monte Carlo.")] = 1,
    axis: Annotated[
        str, typer.Option(help="Only this axis or component, X or EYX; with --kind: the machine axis, X.")
    ] = "",
    phase: Annotated[str, typer.Option(help="For a run: before or after only.")] = "",
    kind: Annotated[
        str,
        typer.Option(
            help="positioning, straightness, angular, squareness, parallelism, reversal, axis-location, rotary-motion, "
            "harmonics, six-dof, transmission, ballbar, gear."
        ),
    ] = "positioning",
    angle: Annotated[
        str, typer.Option(help="Angular: pitch, yaw, roll; for Z: tilt about X, tilt about Y, roll.")
    ] = "",
    plane: Annotated[str, typer.Option(help="Squareness: XY, XZ or YZ.")] = "XY",
    artefact: Annotated[float, typer.Option(help="Squareness: the square's own angle minus 90 deg, arcsec.")] = 0.0,
    senses: Annotated[
        str,
        typer.Option(
            help="Squareness: way each reading counts up, in or out of the square, and in-corner or out-corner where "
            "positions grow towards its corner: in,out. Parallelism: same or opposite side."
        ),
    ] = "",
    motion: Annotated[str, typer.Option(help="Rotary motion: radial, axial, rotating or tilt.")] = "radial",
    distance: Annotated[float, typer.Option(min=0, help="Tilt: distance of the two sensors, mm.")] = 0.0,
    offset: Annotated[
        str, typer.Option(help="Six-dof: point of interest from the measured point, x,y,z in mm.")
    ] = "0,0,0",
    order: Annotated[list[int] | None, typer.Option(help="Harmonics: this order. May be repeated.")] = None,
    pins: Annotated[int | None, typer.Option(min=4, help="Transmission: number of pins.", show_default=False)] = None,
    ratio: Annotated[
        float | None,
        typer.Option(help="Transmission: input turns per output turn; < 0 if opposite.", show_default=False),
    ] = None,
    rated_torque: Annotated[
        float | None, typer.Option(help="Transmission: rated torque, Nm.", show_default=False)
    ] = None,
    encoder_u: Annotated[
        float | None,
        typer.Option(
            "--encoder-U", min=0, help="Transmission: U of the output encoder, arcsec, k = 2.", show_default=False
        ),
    ] = None,
    site: Annotated[
        Path | None,
        typer.Option(
            help="Site file: of positioning its tolerances and equipment, of kind gear the gear of a contour scan.",
            show_default=False,
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture (.png or .svg).", show_default=False)] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Positioning: number of processes that share the files.")] = 1,
    scheduler: Annotated[str, typer.Option(help="Dask scheduler, tcp://host:port.", show_default=False)] = "",
    table: Annotated[
        Path | None,
        typer.Option(help="Write all results to one table (.csv); a repeated call continues it.", show_default=False),
    ] = None,
    accept_doubt: AcceptOption = None,
    store: StoreOption = Path("runs"),
    accept: StatementOption = None,
    ask: AskOption = True,
    as_json: JsonOption = False,
) -> None:
    """Evaluate result files or runs: positioning to ISO 230-2 or another standard, or another --kind of geometry."""
    from gateway.cli.files.positioning import BatchOptions, EvaluationOptions, evaluate_files, limits_of, list_standards

    if standard == "list":
        require_only("evaluate --standard list")
        list_standards(as_json=as_json)
        return
    if kind not in ("positioning", "gear") and site is not None:  # tolerances ignored would be taken for a pass
        raise ConfigError("E-CLI-SITE-KIND", "--site", kind=kind)
    require_only(f"evaluate --kind {kind}")
    if kind != "positioning":
        if kind == "transmission":
            from gateway.cli.files.measurands import DriveOptions, evaluate_transmission
            from gateway.workflow.files.drives import DriveQuestion
            from gateway.workflow.files.headers import columns_of

            drive = DriveQuestion(
                pins=pins,
                ratio=ratio,
                rated_torque_nm=rated_torque,
                output_encoder_U_arcsec=encoder_u,
                columns=columns_of(column or ()),
            )
            wanted = DriveOptions(drive, plot, limits_of(limit or ()))
            raise typer.Exit(evaluate_transmission(files or [], wanted, as_json=as_json))
        if kind == "ballbar":
            from gateway.cli.files.measurands import CircleOptions, evaluate_ballbar_files
            from gateway.workflow.files.headers import columns_of

            circle = CircleOptions(columns_of(column or ()), plot, limits_of(limit or ()))
            raise typer.Exit(evaluate_ballbar_files(files or [], circle, as_json=as_json))
        if kind == "gear":
            from gateway.cli.files.measurands import evaluate_gear_files

            raise typer.Exit(evaluate_gear_files(files or [], site, limits_of(limit or ()), plot, as_json=as_json))
        from gateway.cli.files.measurands import KindOptions, evaluate_kinds, point_of
        from gateway.workflow.files.kind_records import KindQuestion

        question = KindQuestion(
            axis=axis.strip().upper(),
            angle=angle,
            plane=plane.upper(),
            orders=tuple(order or ()),
            artefact_arcsec=artefact,
            distance_mm=distance,
            motion=motion,
            offset_mm=point_of(offset),
            senses=tuple(one.strip().lower() for one in senses.split(",") if one.strip()),
        )
        options = KindOptions(
            kind=kind,
            question=question,
            unit=unit,
            plot=plot,
            phase=phase,
            store=store,
            limits=limits_of(limit or ()),
            accepted=accepted_doubts(accept_doubt),
            columns=tuple(column or ()),
            compared=statement_comparison(None, accept, ask=ask and not as_json)
            if len(files or ()) > 1
            else DateComparison(tuple(accept or ()), ask and not as_json),
        )
        raise typer.Exit(evaluate_kinds(files or [], options, as_json=as_json))
    tree = load_site(site) if site is not None else None
    crew = BatchOptions(jobs, scheduler, table)
    apart = crew.each_alone(files or [])
    asked = EvaluationOptions(
        standard=standard,
        unit=unit,
        limits=limits_of(limit or ()),
        air=air,
        expansion_ppm_per_k=expansion,
        material_degc=material_degc,
        seed=seed,
        store=store,
        axis=axis,
        phase=phase,
        plot=plot,
        site=tree,
        compared=statement_comparison(None, accept, ask=ask and not (as_json or apart), tree=tree)
        if tree or (len(files or ()) > 1 and not apart)
        else DateComparison(tuple(accept or ()), ask and not (as_json or apart)),
        accepted=accepted_doubts(accept_doubt),
        columns=tuple(column or ()),
    )
    evaluate_files(files or [], asked, as_json=as_json, crew=crew)
