"""The paper's figures and tables for a gear on a machine, by one command: what each of them shows, in one folder.

Numbers are the paper's. What it leaves open and what was chosen is written into the folder's own page beside each
figure. Everything is drawn from the study and from the functions that the library gives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from drivers.types.values import FloatArray
from drivers.units import mm_to_um, rad_to_arcsec, rad_to_deg
from gateway.errors import StoreError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import bounded_first_order
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.wheel_passage import contact_line
from gateway.model.chain import LETTERS
from gateway.model.frames import RELATIVE, with_relative
from gateway.model.motion import travel_of
from gateway.sensitivity.outputs import EQUAL_MM, EQUAL_RAD, equal_size
from gateway.sensitivity.screening import ScreeningResult, sigma_intervals
from gateway.study.calculate import State, Study
from gateway.study.describe import tooth_values
from gateway.study.drawing import axes_before_after, flank_maps
from gateway.study.evidence import Evidence, inspected_chart, part_rows
from gateway.study.export import (
    PROFILE_COLUMNS,
    WHEEL_COLUMNS,
    profile_rows,
    space_angles,
    wheel_rows,
    write_dxf,
    write_rows,
)
from gateway.study.machine import is_angle, travels
from gateway.study.pictures import write_relative
from gateway.study.plots.charts import (
    MotionCurve,
    Paint,
    measured_pairs,
    measured_panels,
    motion_panels,
    screening_bars,
    write_sheet,
)
from gateway.study.plots.laboratory import Chart, Traces, laboratory_page, rooms_um
from gateway.study.plots.surfaces import contact_sheet, error_surfaces, profile_sheet, wheel_sheet
from gateway.study.relative_errors import relative_rows, relative_sweep

POINTS, HEIGHTS, SAMPLES = 23, 9, 181
PROFILE, WIDTH = 41, 21
TABLE_2 = ("value", "before", "after", "unit")
ASKED = (0.0, 0.25, 0.5, 0.75)  # of the turn: four spaces are traced
Case = tuple[str, FloatArray]


@dataclass(frozen=True)
class Sheet:
    """One picture of the paper: its file, size in inches, painter, and what its caption says."""

    name: str
    size: tuple[float, float]
    paint: Paint
    said: str


def relative_cases(grinding: Grinding, grid: FlankGrid) -> list[Case]:
    """Figure 3: each of the six relative errors alone, 5 um or 0.01 deg told in the wheel; deviations (T, Z), mm."""
    sizes = {name: EQUAL_MM if name[0] == "d" else EQUAL_RAD for name in RELATIVE}
    chains = {name: with_relative(grinding.chain, name, size) for name, size in sizes.items()}
    return [(name, _raw(replace(grinding, chain=chain), grid)) for name, chain in chains.items()]


def error_cases(grinding: Grinding, grid: FlankGrid, names: tuple[str, ...]) -> list[Case]:
    """Figure 3: each geometric error alone, 5 um or 0.01 deg; deviations (T, Z) in mm, nothing removed."""
    clean = grinding.chain.without_errors()
    return [(name, _raw(replace(grinding, chain=clean.with_errors({name: equal_size(name)})), grid)) for name in names]


def _raw(grinding: Grinding, grid: FlankGrid) -> FloatArray:
    e = bounded_first_order(grinding, grid.k, grid.theta, grid.z).second
    return np.asarray(np.broadcast_to(e, grid.shape)[0])


def sigma_bounds(screening: ScreeningResult, output: str) -> dict[str, list[float]]:
    """Bounds of sigma of each error by its name, um."""
    bounds = sigma_intervals(screening.effects[..., screening.outputs.index(output)])
    low, high = (mm_to_um(one) for one in bounds)
    return {name: [float(low[i]), float(high[i])] for i, name in enumerate(screening.names)}


def screening_rows(study: Study, output: str = "rms") -> list[Mapping[str, float | str]]:
    """Figure 5: mu* and sigma of each error with bounds in um, the most important first; equal steps."""
    screening, bounds = study.equal, sigma_bounds(study.equal, output)
    return [
        {
            "name": one.name,
            "mu_star_um": mm_to_um(one.mu_star),
            "mu_star_low_um": mm_to_um(one.low),
            "mu_star_high_um": mm_to_um(one.high),
            "sigma_um": mm_to_um(one.sigma),
            "sigma_low_um": bounds[one.name][0],
            "sigma_high_um": bounds[one.name][1],
            "mu_share": one.mu_share,
            "sigma_share": one.sigma_share,
        }
        for one in screening.rankings[output]
    ]


def motion_curves(study: Study, known: Mapping[str, float]) -> list[MotionCurve]:
    """Figure 7: every error motion over its axis' travel, um or arcsec over mm or deg; ``known`` are U (k = 2)."""
    chain, found = study.grinding.chain, []
    for axis in chain.axes:
        turning = axis.kind == "revolute"
        reach = travels(study.plan, chain).get(axis.name, (0.0, 2.0 * np.pi) if turning else (-1.0, 1.0))
        for letter, key in zip(LETTERS, ("dx", "dy", "dz", "ea", "eb", "ec"), strict=True):
            name = f"E{letter}{axis.name}"
            at = np.linspace(*travel_of(axis.err.get(key, 0.0), *reach), SAMPLES)
            values = axis.value(key, at)
            unit = "arcsec" if is_angle(name) else "um"
            found.append(
                MotionCurve(
                    name=name,
                    axis=axis.name,
                    unit=unit,
                    axis_unit="deg" if turning else "mm",
                    at=np.asarray(rad_to_deg(at)) if turning else at,
                    values=np.asarray(rad_to_arcsec(values) if unit == "arcsec" else mm_to_um(values)),
                    U=np.full(at.shape, known.get(name, 0.0)),
                )
            )
    return found


def traced_spaces(gear: CycloidGear) -> tuple[int, ...]:
    """The spaces whose traces are drawn: four, a quarter of a turn apart."""
    return tuple(sorted({round(share * gear.zc) % gear.zc for share in ASKED}))


def chart_of(study: Study, grinding: Grinding, state: State, title: str) -> Chart:
    """Figures 11 and 12: traces of four spaces on both flanks, and pitch and runout of all, of one state."""
    gear = grinding.gear
    spaces = traced_spaces(gear)
    grid = flank_grid(gear, profile=PROFILE, width=WIDTH, fraction=study.gear.flank.fraction, spaces=spaces)
    e = np.broadcast_to(bounded_first_order(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
    e = e - state.figure.rotation * grid.section.h
    middle = int(np.argmin(np.abs(grid.zs)))
    arc, half = gear.arc(grid.thetas), 0.5 * gear.limits().half_lobe_arc
    profile, lead = [], []
    for side in (grid.thetas > 0.0, grid.thetas < 0.0):
        outward = np.argsort(np.abs(arc[side]))
        profile.append(Traces.of(spaces, np.abs(arc[side])[outward], e[:, side, middle][:, outward]))
        where = int(np.flatnonzero(side)[np.argmin(np.abs(np.abs(arc[side]) - half))])
        lead.append(Traces.of(spaces, grid.zs, e[:, where, :]))
    note = (
        f"{study.gear.name}: calculated from the errors of {study.errors.name}; values in µm, one rotation removed\n"
        "each trace about its own mean, surplus material to the right; dashed: least-squares line"
    )
    left, right = zip(profile, lead, strict=True)
    return Chart(title=title, note=note, profile=(left[0], right[0]), lead=(left[1], right[1]), chart=state.chart)


def gear_rows(study: Study) -> list[tuple[str, str, str, str]]:
    """Table 1: the gear's parameters, each with its symbol and unit."""
    gear, limits = study.grinding.gear, study.grinding.gear.limits()
    rows: list[tuple[str, str, float, str]] = [
        ("radius of the pin circle", "r_p", gear.rp, "mm"),
        ("radius of the pin", "r_rp", gear.rrp, "mm"),
        ("eccentricity", "a", gear.a, "mm"),
        ("teeth of the gear", "z_c", gear.zc, ""),
        ("pins", "z_p", gear.zp, ""),
        ("short amplitude coefficient", "K1", limits.K1, ""),
        ("face width", "b", gear.b, "mm"),
        ("shift modification", "Δr_p", gear.drp, "mm"),
        ("equidistant modification", "Δr_rp", gear.drrp, "mm"),
        ("rotation modification", "δ", rad_to_arcsec(gear.drot), "arcsec"),
        ("root radius", "r_f", limits.r_root, "mm"),
        ("tip radius", "r_a", limits.r_tip, "mm"),
        ("largest pin without undercut", "r_rp,max", limits.rrp_max, "mm"),
        ("centre distance to the wheel", "E", study.grinding.E, "mm"),
    ]
    return [(name, symbol, f"{value:.6g}", unit) for name, symbol, value, unit in rows]


def result_rows(study: Study) -> list[tuple[str, str, str, str]]:
    """Table 2: the tooth's values before and after, um."""
    before, after = (tooth_values(state) for state in (study.before, study.after))
    return [(name, f"{before[name]:.3f}", f"{after[name]:.3f}", "um") for name in before]


def pages_of(study: Study, evidence: Evidence | None) -> tuple[tuple[Chart, str], ...]:
    """Figures 11 and 12, each with its caption: the run's inspected parts, calculated where none was inspected."""
    gear, found = study.grinding.gear, []
    ours = evidence is not None and evidence.is_of(gear)
    parts = evidence.parts if evidence is not None and ours else {}
    spaces = traced_spaces(gear)
    for name, machine, state in (
        ("before", study.grinding, study.before),
        ("after", study.correction.machine, study.after),
    ):
        title, part = f"{name.capitalize()} the correction", parts.get(name)
        if part is not None:
            chart, said = inspected_chart(gear, part, spaces, f"{title}, measured"), "as the part was inspected."
        else:
            chart, said = chart_of(study, machine, state, f"{title}, calculated"), "calculated from the errors."
            if evidence is not None and evidence.parts and not ours:
                said += " The parts of the run are of another gear."
        found.append((chart, said))
    return tuple(found)


def _readings(study: Study, evidence: Evidence | None) -> list[Sheet]:
    """Figures 7 and 8 as the run measured them; figure 8 calculated where no axis was measured again."""
    found = []
    if evidence is not None and evidence.readings:
        name, read = evidence.run, [one.drawn() for one in evidence.readings]
        note = f"{name}; points: readings, line: mean of a direction, band: 2 s where a target was read 3 times or more"
        rows = -(-len(read) // 3)
        found.append(
            Sheet(
                "figure-7-measured",
                (11.0, 1.2 + 2.0 * rows),
                lambda f: measured_panels(f, read, "measured before the correction", note),
                "Figure 7, measured: the readings of the run, before anything was written.",
            )
        )
        if evidence.proved:
            pairs = [one.drawn() for one in evidence.proved]
            found.append(
                Sheet(
                    "figure-8-measured",
                    (11.0, 1.2 + 2.2 * len(pairs)),
                    lambda f: measured_pairs(f, pairs, "measured before and after the correction", note),
                    "Figure 8, measured: the same axes with their own tables acting, before the cross tables.",
                )
            )
    again = bool(evidence and evidence.proved)
    found.append(
        Sheet(
            "figure-8-axes-after",
            (11.0, 4.0),
            lambda f: axes_before_after(f, study.correction.axes),
            f"{'What the study calculates beside it' if again else 'Figure 8, calculated'}: each axis' own deviation "
            "before and after. With cross tables an axis is spoilt on purpose where the tooth needs it; the paper "
            "corrects axes alone.",
        )
    )
    return found


def sheets(study: Study, evidence: Evidence | None = None) -> tuple[Sheet, ...]:
    """Every picture of the paper that one gear on one machine makes, but the machine's frames.

    ``evidence``: what the run that the errors come from measured; it is drawn where there is some.
    """
    grinding, gear = study.grinding, study.grinding.gear
    near = FlankGrid(gear, np.zeros(1), space_angles(gear, 2 * POINTS - 1), np.linspace(-0.5, 0.5, HEIGHTS) * gear.b)
    section, shape = near.section, near.shape[1:]
    nominal = np.stack(np.broadcast_arrays(section.x, section.y, near.zs), axis=-1)
    normals = np.stack(np.broadcast_arrays(section.nx, section.ny, np.zeros(shape)), axis=-1)

    def cases(found: list[Case]) -> list[tuple[str, FloatArray, FloatArray, FloatArray]]:
        return [(name, nominal, normals, e) for name, e in found]

    six = cases(relative_cases(grinding, near))
    each = cases(error_cases(grinding, near, study.names))
    size = "5 µm or 0.01 deg alone, space 0, nothing removed"
    doubt = study.errors.uncertainty
    known = {} if doubt is None else {
        name: 2.0 * doubt.each.get(name, doubt.angular_arcsec if is_angle(name) else doubt.linear_um)
        for name in study.names
    }  # fmt: skip
    clean = replace(grinding, chain=grinding.chain.without_errors())
    at = (np.zeros((1, 1)), np.linspace(-0.5, 0.5, 11)[:, None] * gear.b, space_angles(gear, 101))
    lines = [np.broadcast_to(contact_line(one, *at).points, (11, 101, 3)) for one in (clean, grinding)]
    (first, first_said), (last, last_said) = pages_of(study, evidence)
    rooms = rooms_um((first, last))
    output = "RMS normal deviation"
    states = (("before", study.before.deviation), ("after", study.after.deviation))
    return (
        Sheet("gear", (11.0, 4.2), lambda f: profile_sheet(f, gear), "The disc of table 1, its normals and curvature."),
        Sheet(
            "figure-3-relative-errors", (11.0, 7.0),
            lambda f: error_surfaces(f, six, columns=3, title=f"each relative error of wheel to work, {size}"),
            "Figure 3, the six degrees of freedom between wheel and work, told in the wheel's frame. The text does not "
            "say in which frame they count.",
        ),
        Sheet(
            "figure-3-geometric-errors", (13.0, 6.6),
            lambda f: error_surfaces(f, each, columns=7, title=f"each geometric error, {size}"),
            "Figure 3 for each of the geometric errors. EZX, EZZ, EZC, EBZ do nothing to a spur flank, EAZ next to "
            "nothing; the paper does not say so.",
        ),
        Sheet(
            "figure-4-wheel", (10.0, 4.4), lambda f: wheel_sheet(f, gear, grinding.E),
            "Section 4.2: the dressed axial section and the wheel's surface.",
        ),
        Sheet(
            "figure-4-contact", (7.0, 5.2), lambda f: contact_sheet(f, lines[0], lines[1]),
            "Section 4.2: contact lines, ideal and actual. All lines of a stroke together are the flank.",
        ),
        Sheet(
            "figure-5-sensitivity", (11.0, 5.8), lambda f: screening_bars(f, screening_rows(study), output),
            "Figure 5. The formula of the normalisation is not in the text: shares of the sum are shown. On one-sided "
            "steps mu and mu* rank alike; mu* is shown because it cannot cancel.",
        ),
        Sheet(
            "figure-7-error-motions", (10.0, 7.4),
            lambda f: motion_panels(
                f, motion_curves(study, known), f"error motions of {study.errors.name}",
                "band: U (k = 2) as the error file states it" if known else "the error file states no uncertainty",
            ),
            "Figure 7 as fitted: the error motions that the study takes, from the error file or run.",
        ),
        *_readings(study, evidence),
        Sheet(
            "flank-before-after", (11.0, 4.4), lambda f: flank_maps(f, study, states),
            "All flanks unrolled, before and after, one scale.",
        ),
        Sheet(
            "figure-11-before", (9.0, 11.0), lambda f: laboratory_page(f, first, rooms),
            f"Figure 11: the chart of a gear laboratory before the correction, {first_said}",
        ),
        Sheet(
            "figure-12-after", (9.0, 11.0), lambda f: laboratory_page(f, last, rooms),
            f"Figure 12: the same after it, {last_said} Traces are on the scale of figure 11, bars on their own.",
        ),
    )  # fmt: skip


def write_paper(study: Study, folder: Path, evidence: Evidence | None = None) -> tuple[Path, ...]:
    """Everything into a folder (made if missing): pictures, tables, the disc's files, a page that says what is what.

    ``evidence`` is what the run of the errors measured: figures 7, 8, 11, 12 draw it, and table 2 gets its inspected
    twin; None: they are calculated.
    Raises StoreError E-STUDY-WRITE.
    """
    sweep = relative_sweep(study.grinding)
    frames, curves = write_relative(study.grinding, sweep, folder)
    gear, rows = study.grinding.gear, screening_rows(study)
    files = [frames, curves]
    found = sheets(study, evidence)
    files += [write_sheet(folder / f"{one.name}.png", one.size, one.paint) for one in found]
    columns = ("error", "space_0", "least", "greatest", "rms", "first_order_misses", "unit")
    files += [
        write_rows(folder / "table-1.csv", ("parameter", "symbol", "value", "unit"), gear_rows(study)),
        write_rows(folder / "table-2.csv", TABLE_2, result_rows(study)),
        write_rows(folder / "figure-5.csv", tuple(rows[0]), [tuple(one.values()) for one in rows]),
        write_rows(folder / "relative-errors.csv", columns, relative_rows(sweep)),
        write_rows(folder / "gear.csv", PROFILE_COLUMNS, profile_rows(gear, range(gear.zc), 201)),
        write_rows(folder / "wheel.csv", WHEEL_COLUMNS, wheel_rows(gear, study.grinding.E, 201)),
    ]
    inspected = [] if evidence is None or not evidence.is_of(gear) else part_rows(evidence)
    if inspected:
        files.append(write_rows(folder / "table-2-inspected.csv", TABLE_2, inspected))
    said = ""
    try:
        files.append(write_dxf(folder / "gear.dxf", gear))
    except ConfigError as error:  # ezdxf is an extra: everything else is made without it
        said = f"\nNo DXF: {error}\n"
    page = folder / "paper.md"
    try:
        page.write_text(_page(study, found, inspected) + said, encoding="utf-8")
    except OSError as error:
        raise StoreError("E-STUDY-WRITE", str(page), why=error.strerror or str(error)) from error
    return (page, *files)


def _page(study: Study, found: tuple[Sheet, ...], inspected: list[tuple[str, str, str, str]]) -> str:
    parts = [
        f"# {study.gear.name} on {study.errors.name}\n",
        'Figures numbered as in the paper; calculated where "measured" is not said. Units: mm, deg, µm, arcsec; '
        "+ is surplus material.\n",
        _table("Table 1", ("parameter", "symbol", "value", "unit"), gear_rows(study)),
        "## Figures 1 and 2\n\n![frames](frames.png)\n\nThe bodies and their frames. Y and the dressing spindle are in "
        "no chain: they act on the wheel's profile alone.\n",
        "## Section 3.3\n\n![relative errors](relative-errors.png)\n\nThe six relative errors of wheel to work.\n",
    ]
    parts += [f"## {one.name}\n\n![{one.name}]({one.name}.png)\n\n{one.said}\n" for one in found]
    parts.append(_table("Table 2, calculated", TABLE_2, result_rows(study)))
    if inspected:
        parts.append(_table("Table 2, as the parts of the run were inspected", TABLE_2, inspected))
    parts.append("The values of the paper's own tables are not in its text, so they are not compared.\n")
    return "\n".join(parts)


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[str, str, str, str]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in (heads, ("---",) * len(heads), *rows)]
    return f"## {title}\n\n" + "\n".join(lines) + "\n"
