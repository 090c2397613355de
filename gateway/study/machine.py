"""The machine of an error file: its chain with errors in mm and rad, drawn from a seed where it says so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivers.units import arcsec_to_rad, deg_to_rad, um_to_mm
from gateway.correct.plan.layers import known_travel
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.chain import LETTERS, Chain, Motion
from gateway.model.components import SLACK
from gateway.model.error_model import LOCATION_NAMES, yk7350b
from gateway.model.frames import chain_of
from gateway.model.motion import Fourier, MotionSum, Polynomial, motion_of
from gateway.study.inputs import ErrorFile, ErrorFunction, GearFile, SeededErrors, gear_of

REACH_MM = 5.0
ORDERS = 3
DEGREE = 3


def grid_of(file: GearFile, gear: CycloidGear) -> FlankGrid:
    """The points that are judged."""
    return flank_grid(gear, profile=file.flank.profile, width=file.flank.width, fraction=file.flank.fraction)


def grinding_of(gear_file: GearFile, errors: ErrorFile) -> Grinding:
    """The gear on the machine with all its errors. Raises ModelError, E-STUDY-HEIGHT off the range of the stroke."""
    grinding = Grinding(machine_of(errors), gear_of(gear_file), gear_file.grinding.centre_distance_mm)
    _demand_known(grinding, grid_of(gear_file, grinding.gear), errors)
    return grinding


def _demand_known(grinding: Grinding, grid: FlankGrid, errors: ErrorFile) -> None:
    """Refuse a face that lies where an error of the stroke is not known, which a wrong or missing height does."""
    ends = grinding.stroke_command(np.array([grid.zs[0], grid.zs[-1]]))
    for name, value in errors.errors.items():
        for one in value if isinstance(value, tuple) else (value,):
            known = one.range if isinstance(one, ErrorFunction) else None
            if known is None or grinding.chain.error_place(name)[0] != grinding.stroke:
                continue
            if min(ends) < known[0] - SLACK or max(ends) > known[1] + SLACK:
                low, high, first, last = (f"{one:.6g}" for one in (*known, min(ends), max(ends)))
                axis = grinding.stroke
                raise ModelError(
                    "E-STUDY-HEIGHT", name, name=name, axis=axis, low=low, high=high, first=first, last=last
                )


def machine_of(file: ErrorFile) -> Chain:
    """The chain with the file's errors; those it does not give are drawn if there is a seed, else zero."""
    plain = chain_of(file.machine.chain) if file.machine.chain else yk7350b(c_frame=file.machine.c_frame)
    drawn = {} if file.seeded is None else drawn_errors(plain, file.seeded)
    given = {name: motion_in_mm_rad(plain, name, value) for name, value in file.errors.items()}
    return plain.with_errors({**drawn, **given})


def error_names(chain: Chain) -> tuple[str, ...]:
    """The 18 motions and the location errors looked at: the preset's three and any other that is set."""
    motions = tuple(f"E{letter}{axis.name}" for axis in chain.axes for letter in LETTERS)
    known = set(chain.error_names())
    preset = [name for name in LOCATION_NAMES if name in known]
    others = [f"{key}{axis.name}" for axis in chain.axes for key, value in axis.loc.items() if value]
    return (*motions, *preset, *(name for name in others if name not in preset))


def is_angle(name: str) -> bool:
    """Whether an error is an angle: EAX, B0Z."""
    return (name[1:2] if name.startswith("E") else name[:1]) in "ABC"


def motion_in_mm_rad(
    chain: Chain, name: str, value: float | ErrorFunction | tuple[float | ErrorFunction, ...]
) -> Motion:
    """An error in um or arcsec over mm or deg as a motion in mm or rad over mm or rad; several are added up.

    Raises ModelError (E-CHAIN-MOTION-DATA, a series over a linear axis without its period too).
    """
    if isinstance(value, tuple):
        return MotionSum(tuple(motion_in_mm_rad(chain, name, one) for one in value))
    axis, _ = chain.error_place(name)
    size = arcsec_to_rad(1.0) if is_angle(name) else um_to_mm(1.0)
    if not isinstance(value, ErrorFunction):
        return value * size
    at = deg_to_rad(1.0) if chain.axis(axis).kind == "revolute" else 1.0
    scaled = {key: tuple(one * size for one in getattr(value, key)) for key in ("c", "a", "b", "v")}
    period = {} if value.period is None else {"period": value.period * at}
    data: dict[str, Mapping[str, object]] = {
        "poly": {"c": scaled["c"], "q0": value.q0 * at, "scale": value.scale * at},
        "fourier": {"a0": value.a0 * size, "a": scaled["a"], "b": scaled["b"], **period},
        "pl": {"q": tuple(one * at for one in value.q), "v": scaled["v"], **period},
    }
    if value.type == "fourier" and value.period is None and chain.axis(axis).kind != "revolute":
        raise ModelError("E-CHAIN-MOTION-DATA", name, why="a Fourier series over a linear axis needs its period in mm")
    known = {} if value.range is None else {"range": tuple(one * at for one in value.range)}
    turning = chain.axis(axis).kind == "revolute"
    return motion_of({"type": value.type, **data[value.type], **known}, name, name=name, turning=turning)


def drawn_errors(chain: Chain, seeded: SeededErrors) -> dict[str, Motion]:
    """Smooth errors of a machine nobody knows: cubics on linear axes, three harmonics on rotary ones, three tilts."""
    rng = np.random.default_rng(seeded.seed)
    found: dict[str, Motion] = {}
    for axis in chain.axes:
        for letter in LETTERS:
            name = f"E{letter}{axis.name}"
            size = arcsec_to_rad(seeded.angular_arcsec) if is_angle(name) else um_to_mm(seeded.linear_um)
            if axis.kind == "prismatic":
                c = rng.uniform(-size, size, DEGREE + 1)
                found[name] = Polynomial((0.0, *(float(v) for v in c[1:])), 0.0, seeded.travel_mm)
            else:
                a, b = rng.uniform(-size, size, (2, ORDERS)) / np.arange(1, ORDERS + 1)
                found[name] = Fourier(0.0, tuple(a.tolist()), tuple(b.tolist()))
    names = [name for name in LOCATION_NAMES if name in chain.error_names()]
    tilts = rng.uniform(-1.0, 1.0, len(names)) * arcsec_to_rad(seeded.location_arcsec)
    return {**found, **dict(zip(names, tilts.tolist(), strict=True))}


def plan_of(file: ErrorFile, grinding: Grinding) -> Plan:
    """The controller's grids: those of the file, others to suit the gear (5 mm along the face, 15 deg around)."""
    names = (grinding.infeed, grinding.stroke, grinding.index)
    given = {one.axis: one for one in table_grids(file)}
    for name in given:
        if name not in names:
            raise ModelError("E-CHAIN-AXIS", "tables", name=name, known=", ".join(names))
    usual = _usual_grids(grinding)
    x, z, c = names
    return Plan(
        tuple(given.get(name, usual[name]) for name in names),
        own=names,
        cross=((x, z), (x, c), (c, z), (c, c)),
        zeros=(x, c),
        norm=file.goal,
        bounds=file.bounds,
    )


def table_grids(file: ErrorFile) -> tuple[AxisGrid, ...]:
    """The controller's grids that the file states."""
    return tuple(AxisGrid(name, **grid.model_dump()) for name, grid in file.tables.items())


def _usual_grids(grinding: Grinding) -> dict[str, AxisGrid]:
    x, z, c = grinding.infeed, grinding.stroke, grinding.index
    at = float(grinding.commands(0.0, 0.0)[x])
    far = 20.0 * np.ceil((abs(at) + 20.0) / 20.0)
    reach = REACH_MM * np.ceil(grinding.gear.b / 2.0 / REACH_MM) + REACH_MM
    low, high = (-far, 0.0) if at < 0.0 else (0.0, far)
    return {
        x: _known_grid(grinding.chain, AxisGrid(x, float(low), float(high), 20.0)),
        z: _known_grid(grinding.chain, AxisGrid(z, -float(reach), float(reach), REACH_MM)),
        c: AxisGrid(c, 0.0, 360.0, 15.0, modulo=True),
    }


def _known_grid(chain: Chain, grid: AxisGrid) -> AxisGrid:
    """The grid as far as the axis' own deviation is known, zero at its place nearest to the reference."""
    low, high = known_travel(chain, grid.axis, grid.minimum, grid.maximum)
    if (low, high) == (grid.minimum, grid.maximum) or not low < high:
        return grid
    step = (high - low) / max(round((high - low) / grid.step), 1)
    return replace(grid, minimum=low, maximum=high, step=step, reference=float(np.clip(grid.reference, low, high)))


def travels(plan: Plan, chain: Chain) -> dict[str, tuple[float, float]]:
    """Range of each axis' tables, mm or rad."""
    return {
        grid.axis: (grid.minimum, grid.maximum)
        if chain.axis(grid.axis).kind == "prismatic"
        else (deg_to_rad(grid.minimum), deg_to_rad(grid.maximum))
        for grid in plan.grids
    }
