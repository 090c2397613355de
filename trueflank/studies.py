"""Studies of a gear on a machine: which error matters, what corrects it, everything at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.types.tables import CompensationTable
from drivers.units import mm_to_um
from gateway.errors import ModelError
from gateway.sensitivity.outputs import OUTPUTS, FlankOutputs, equal_spans, measured_spans
from gateway.sensitivity.sweep import screen
from gateway.study import tell
from gateway.study.machine import error_names, grid_of, grinding_of, plan_of, travels
from gateway.study.work import Study, corrected
from gateway.study.work import study as worked
from trueflank.frames import frame
from trueflank.given import of_kind, wholes_given
from trueflank.tooth import Gear, Machine


@dataclass(frozen=True, slots=True, repr=False)
class Ranking:
    """Morris' measures of each error on one output of the flank, the most important first; um."""

    output: str
    rows: tuple[dict[str, Any], ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"output": self.output, "rows": [dict(row) for row in self.rows]}

    def to_pandas(self) -> Any:
        """One row an error. Raises ConfigError (E-LIBRARY-PANDAS)."""
        return frame({key: [row[key] for row in self.rows] for key in self.rows[0]})

    def __repr__(self) -> str:
        first = ", ".join(f"{row['name']} {row['mu_star_um']:.3f}" for row in self.rows[:5])
        return f"Ranking(mu* on {self.output}, µm: {first} ...)"


def rank(
    machine: Machine, gear: Gear, *, output: str = "rms", spans: str = "measured", trajectories: int = 20, seed: int = 1
) -> Ranking:
    """Rank the errors by Morris screening: their effect in um on one output of the flank.

    ``spans``: the machine's own sizes ("measured") or equal ones of um and arcsec ("equal"). Raises ConfigError
    (E-LIBRARY-KIND), ModelError (E-SENS-OUTPUT, E-SENS-SIZE).
    """
    of_kind(machine, Machine, "rank")
    of_kind(gear, Gear, "rank")
    wholes_given("rank", trajectories=trajectories, seed=seed)
    if output not in OUTPUTS or spans not in ("measured", "equal"):
        known = ", ".join((*OUTPUTS, "measured", "equal"))
        raise ModelError("E-SENS-OUTPUT", "rank", output=f"{output}, {spans}", known=known)
    grinding = grinding_of(gear.data, machine.data)
    names = error_names(grinding.chain)
    widths = (
        equal_spans(names)
        if spans == "equal"
        else measured_spans(grinding, names, travels(plan_of(machine.data, grinding), grinding.chain))
    )
    grid = grid_of(gear.data, grinding.gear)
    found = screen(FlankOutputs(grinding, grid, widths, "first"), names, OUTPUTS, r=trajectories, seed=seed)
    return Ranking(output, tuple(tell.ranked(one) for one in found.rankings[output]))


@dataclass(frozen=True, slots=True, repr=False)
class Corrected:
    """Compensation tables and set-up values that make the tooth best, and the flank's RMS before and after, um.

    A table holds the deviation of its output axis that it cancels (um or arcsec). ``setup``: (name, value, unit).
    """

    tables: tuple[CompensationTable, ...]
    setup: tuple[tuple[str, float, str], ...]
    rms_before: float
    rms_after: float
    said: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "tables": [tell.table_data(one) for one in self.tables],
            "setup": [{"name": name, "value": value, "unit": unit} for name, value, unit in self.setup],
            "rms_before_um": self.rms_before,
            "rms_after_um": self.rms_after,
            "said": list(self.said),
        }

    def to_pandas(self) -> Any:
        """One row a point of a table. Raises ConfigError (E-LIBRARY-PANDAS)."""
        pairs = ((one.name, zip(one.positions, one.deviations, strict=True)) for one in self.tables)
        rows = [(name, at, value) for name, points in pairs for at, value in points]
        names, at, values = zip(*rows, strict=True) if rows else ((), (), ())
        return frame({"table": names, "position": at, "deviation": values})

    def __repr__(self) -> str:
        names = ", ".join(one.name for one in self.tables)
        return f"Corrected(RMS {self.rms_before:.3f} -> {self.rms_after:.3f} µm by {names or 'no table'})"


def correct(machine: Machine, gear: Gear) -> Corrected:
    """The best axis tables, cross tables and set-up values for this gear on this machine.

    Points of tables in um or arcsec over mm or deg, the flank's RMS in um. Raises ConfigError (E-LIBRARY-KIND),
    ModelError.
    """
    of_kind(machine, Machine, "correct")
    of_kind(gear, Gear, "correct")
    grinding, found = corrected(gear.data, machine.data)
    return Corrected(
        tables=(*found.own, *found.cross),
        setup=tuple(tell.setup_values(found, grinding)),
        rms_before=mm_to_um(found.before.rms),
        rms_after=mm_to_um(found.checked.rms),
        said=tuple(found.said),
    )


@dataclass(frozen=True, slots=True, repr=False)
class Studied:
    """Everything that `trueflank study` tells, in um: each error alone, ranking, cures, before and after."""

    found: Study

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as `trueflank study --json` prints it."""
        return tell.as_data(self.found)

    def to_pandas(self) -> Any:
        """The tooth's values as it is, with axis tables, with everything. Raises ConfigError (E-LIBRARY-PANDAS)."""
        rows = tell.tooth_rows(self.found)
        names = ("value", "before", "with_own", "after", "unit")
        return frame({name: [row[place] for row in rows] for place, name in enumerate(names)})

    def pictures(self, folder: str | Path) -> tuple[Path, ...]:
        """Draw the study into a folder (PNG)."""
        from gateway.study.pictures import write_pictures

        return tuple(write_pictures(self.found, Path(folder)))

    def __repr__(self) -> str:
        before, after = (
            tell.tooth_values(one)["RMS normal deviation"] for one in (self.found.before, self.found.after)
        )
        return f"Studied({self.found.gear.name} on {self.found.errors.name}: RMS {before:.3f} -> {after:.3f} µm)"


def study(machine: Machine, gear: Gear, *, trajectories: int = 20, seed: int = 1) -> Studied:
    """The whole study of a gear on a machine; what it tells of the flank is in um.

    Raises ConfigError (E-LIBRARY-KIND), ModelError.
    """
    of_kind(machine, Machine, "study")
    of_kind(gear, Gear, "study")
    wholes_given("study", trajectories=trajectories, seed=seed)
    return Studied(worked(gear.data, machine.data, r=trajectories, seed=seed))
