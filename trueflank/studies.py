"""Studies of a gear on a machine: which error matters, what corrects it, everything at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError
from drivers.types.tables import CompensationTable
from drivers.units import mm_to_um
from gateway.correct.outlook.prediction import predict
from gateway.correct.plan.layers import correct as solve
from gateway.errors import ModelError
from gateway.gear.first_order import bounded_first_order
from gateway.sensitivity.outputs import OUTPUTS, FlankOutputs, equal_spans, measured_spans
from gateway.sensitivity.screening import screen
from gateway.study import describe
from gateway.study.calculate import Study as Worked
from gateway.study.calculate import prepare_study
from gateway.study.calculate import study as worked
from gateway.study.machine import error_names, grid_of, grinding_of, plan_of, travels
from gateway.study.paper import sigma_bounds
from gateway.tooth import FlankPrediction
from trueflank.frames import frame
from trueflank.given import of_kind, path_given, wholes_given
from trueflank.tooth import Flank, Gear, Machine, doubts_of, flank_of

ENDS = ((0, "low"), (1, "high"))


@dataclass(frozen=True, slots=True, repr=False)
class Ranking:
    """Morris' measures of each error on one output of the flank, the most important first; um.

    A row has ``name``, ``mu_um`` (mean of the effects), ``mu_star_um`` (of their sizes), ``sigma_um`` (their standard
    deviation), the intervals ``mu_star_interval_um`` and ``sigma_interval_um`` (95 %), and the shares of their sums.
    """

    output: str
    rows: tuple[dict[str, Any], ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"output": self.output, "rows": [dict(row) for row in self.rows]}

    def to_pandas(self) -> Any:
        """One row an error. Raises ConfigError (E-LIBRARY-PANDAS)."""
        return frame({key: [row[key] for row in self.rows] for key in self.rows[0]})

    def plot(self) -> Any:
        """Normalised mu* and sigma of each error with their intervals, and the same in um; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet, screening_bars

        rows = [
            {
                **{key: row[key] for key in ("name", "mu_star_um", "sigma_um")},
                **{f"{key}_{end}_um": row[f"{key}_interval_um"][i] for key in ("mu_star", "sigma") for i, end in ENDS},
            }
            for row in self.rows
        ]
        return new_sheet((11.0, 5.8), lambda figure: screening_bars(figure, rows, self.output))

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
    bounds = sigma_bounds(found, output)
    rows = ({**describe.ranking_row(one), "sigma_interval_um": bounds[one.name]} for one in found.rankings[output])
    return Ranking(output, tuple(rows))


@dataclass(frozen=True, slots=True, repr=False)
class Corrected:
    """Compensation tables and set-up values that make the tooth best, and the flank's RMS before and after, um.

    A table holds the deviation of its output axis that it cancels (um or arcsec); ``kind`` "axis" is an axis'
    own table, "cross" the tooth's, of an axis over another or over itself. ``setup``: (name, value, unit).
    ``findings`` say in words what was left or given back, and why. ``flank`` is the tooth after it. ``expected`` is
    what a part will show as the report of a run states it, set-up values right, with clamping, drift and scatter: of a
    run's machine alone.
    """

    tables: tuple[CompensationTable, ...]
    setup: tuple[tuple[str, float, str], ...]
    rms_before: float
    rms_after: float
    findings: tuple[str, ...]
    flank: Flank | None = None
    expected: FlankPrediction | None = None

    @property
    def rms_u(self) -> float | None:
        """Standard deviation of the RMS to be expected after, um, of a run's machine; None: not known."""
        return None if self.expected is None else self.expected.rms_u_um

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "tables": [describe.table_data(one) for one in self.tables],
            "setup": [{"name": name, "value": value, "unit": unit} for name, value, unit in self.setup],
            "rms_before_um": self.rms_before,
            "rms_after_um": self.rms_after,
            "rms_expected_um": None if self.expected is None else self.expected.rms_um,
            "rms_u_um": self.rms_u,
            "findings": list(self.findings),
        }

    def to_pandas(self) -> Any:
        """One row a point of a table. Raises ConfigError (E-LIBRARY-PANDAS)."""
        rows = [
            (one.kind, one.name, at, one.input_unit, value, one.deviation_unit)
            for one in self.tables
            for at, value in zip(one.positions, one.deviations, strict=True)
        ]
        names = ("kind", "table", "position", "position_unit", "deviation", "deviation_unit")
        return frame({name: [row[i] for row in rows] for i, name in enumerate(names)})

    def plot(self) -> Any:
        """Every table's points, um or arcsec over mm or deg; a matplotlib figure."""
        from gateway.study.plots.charts import new_sheet, table_panels

        rows = -(-len(self.tables) // 3) or 1
        return new_sheet((10.0, 0.6 + 2.1 * rows), lambda figure: table_panels(figure, self.tables))

    def __repr__(self) -> str:
        kinds = {kind: [one.name for one in self.tables if one.kind == kind] for kind in ("axis", "cross")}
        told = "; ".join(f"{kind} tables {', '.join(names)}" for kind, names in kinds.items() if names)
        return f"Corrected(RMS {self.rms_before:.3f} -> {self.rms_after:.3f} µm by {told or 'no table'})"


def correct(machine: Machine, gear: Gear) -> Corrected:
    """The best axis tables, cross tables and set-up values for this gear on this machine.

    Points of tables in um or arcsec over mm or deg, the flank's RMS in um. Raises ConfigError (E-LIBRARY-KIND),
    ModelError.
    """
    of_kind(machine, Machine, "correct")
    of_kind(gear, Gear, "correct")
    model = machine.known.model
    ready = prepare_study(gear.data, machine.data, model)
    grinding, grid = ready.grinding, ready.grid
    found = solve(grinding, grid, ready.used)
    e = np.broadcast_to(bounded_first_order(found.machine, grid.k, grid.theta, grid.z).second, grid.shape)
    shop = machine.known.shop(grinding)
    return Corrected(
        flank=flank_of(gear.data, grid, e, doubts_of(machine, gear)),
        expected=None
        if model is None
        else predict(grinding, grid, plan=ready.used, model=model, found=found, shop=shop).flank,
        tables=(*found.own, *found.cross),
        setup=tuple(describe.setup_values(found, grinding)),
        rms_before=mm_to_um(found.before.rms),
        rms_after=mm_to_um(found.checked.rms),
        findings=tuple(map(str, found.said)),
    )


@dataclass(frozen=True, slots=True, repr=False)
class Study:
    """Everything that `trueflank study` tells, in um: each error alone, ranking, cures, before and after.

    ``run`` is where the machine came from, if from a run: its readings and inspected parts are in the paper's figures.
    """

    found: Worked
    run: Path | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as `trueflank study --json` prints it."""
        return describe.as_data(self.found)

    def to_pandas(self) -> Any:
        """The tooth's values as it is, with axis tables, with everything. Raises ConfigError (E-LIBRARY-PANDAS)."""
        rows = describe.tooth_rows(self.found)
        names = ("value", "before", "with_own", "after", "unit")
        return frame({name: [row[place] for row in rows] for place, name in enumerate(names)})

    def plot(self) -> Any:
        """All flanks before and after on one scale, um; a matplotlib figure."""
        from gateway.study.drawing import flank_maps
        from gateway.study.plots.charts import new_sheet

        states = (("before", self.found.before.deviation), ("after", self.found.after.deviation))
        return new_sheet((10.0, 4.2), lambda figure: flank_maps(figure, self.found, states))

    def paper(self, folder: str | Path) -> tuple[Path, ...]:
        """Every figure and table of the paper into a folder, as `trueflank study --paper` (mm, um, arcsec).

        What the machine's run measured is drawn as measured, all else as calculated. Returns the files made.
        Raises ConfigError (E-LIBRARY-KIND), StoreError E-STUDY-WRITE, CorruptRecord.
        """
        from gateway.study.paper import write_paper

        path_given(folder, "Study.paper")
        return write_paper(self.found, Path(folder), self._evidence())

    def figure(self, name: str) -> Any:
        """One picture of the paper by the name of its file, "figure-3-relative-errors" (mm, um); a matplotlib figure.

        Raises ConfigError (E-LIBRARY-KIND) that names those there are.
        """
        from gateway.study.paper import sheets
        from gateway.study.plots.charts import new_sheet

        found = {one.name: one for one in sheets(self.found, self._evidence())}
        if name not in found:
            how = f"one of {', '.join(found)}"
            raise ConfigError(
                "E-LIBRARY-KIND", "figure", call="tf.Study.figure", wanted="a picture", given=repr(name), how=how
            )
        return new_sheet(found[name].size, found[name].paint)

    def _evidence(self) -> Any:
        """What the run measured, or None."""
        from gateway.study.evidence import evidence_of

        return None if self.run is None else evidence_of(self.run)

    def pictures(self, folder: str | Path) -> tuple[Path, ...]:
        """Draw the study into a folder (PNG, um and arcsec); the files made. Raises StoreError E-STUDY-WRITE."""
        from gateway.study.pictures import write_pictures

        return tuple(write_pictures(self.found, Path(folder)))

    def __repr__(self) -> str:
        before, after = (
            describe.tooth_values(one)["RMS normal deviation"] for one in (self.found.before, self.found.after)
        )
        return f"Study({self.found.gear.name} on {self.found.errors.name}: RMS {before:.3f} -> {after:.3f} µm)"


def study(machine: Machine, gear: Gear, *, trajectories: int = 20, seed: int = 1) -> Study:
    """The whole study of a gear on a machine, as `trueflank study`; flanks in um, drives in arcsec.

    ``trajectories`` and ``seed`` are those of the Morris screening.
    Raises ConfigError (E-LIBRARY-KIND), ModelError.
    """
    of_kind(machine, Machine, "study")
    of_kind(gear, Gear, "study")
    wholes_given("study", trajectories=trajectories, seed=seed)
    return Study(worked(gear.data, machine.data, r=trajectories, seed=seed, model=machine.known.model), machine.run)
