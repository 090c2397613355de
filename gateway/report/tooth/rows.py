"""Rows of the tooth's tables: gear figures, set-up values, cures with ranks, tables of the proposal; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.message import Message
from drivers.terms import spoken
from drivers.units import AxisUnit, DeviationUnit
from gateway.report.material import PartMaterial, TableMaterial, ToothMaterial
from gateway.report.tooth.why import Tag, incurable, tag, what, why
from gateway.tooth import CureRecord, RankRecord, SetupValues


@dataclass(frozen=True, slots=True)
class FigureRow:
    """One figure of the gear in um, by part in the order of `ToothMaterial.parts`; None where a part has it not."""

    name: str
    values: tuple[float | None, ...]


def inspected_parts(tooth: ToothMaterial) -> tuple[PartMaterial, ...]:
    """The parts whose flanks were inspected."""
    return tuple(one for one in tooth.parts if one.flank is not None)


def figure_rows(tooth: ToothMaterial) -> tuple[FigureRow, ...]:
    """Profile, lead, pitch and runout as the inspections told them, every name that any part has."""
    given = [one.flank.figures for one in tooth.parts if one.flank is not None]
    names = dict.fromkeys(name for figures in given for name in figures)
    return tuple(FigureRow(name, tuple(figures.get(name) for figures in given)) for name in names)


@dataclass(frozen=True, slots=True)
class SetupRow:
    """Set-up values in um, arcsec, um: of a part as it was ground, or a proposed or applied change."""

    name: Message
    values: SetupValues


def setup_rows(tooth: ToothMaterial) -> tuple[SetupRow, ...]:
    """Each part's set-up values, what was proposed to add, and what was changed from the first part to the last."""
    ground = [(one.part, one.ground.setup) for one in tooth.parts if one.ground is not None]
    rows = [SetupRow(Message.of("S-SETUP-PART", name=name), values) for name, values in ground]
    if tooth.proposal is not None:
        rows.append(SetupRow(Message.of("S-SETUP-BY-MODEL"), tooth.proposal.setup))
    if tooth.from_gear is not None:
        rows.append(SetupRow(Message.of("S-SETUP-BY-PART", name=tooth.from_gear.part), tooth.from_gear.setup))
    if len(ground) > 1:
        changed = Message.of("S-SETUP-CHANGED", first=ground[0][0], last=ground[-1][0])
        rows.append(SetupRow(changed, ground[-1][1].less(ground[0][1])))
    return tuple(rows)


@dataclass(frozen=True, slots=True)
class CureRow:
    """One error on the tooth: RMS alone and what stays at best (um), rank with its interval, cure, and why not."""

    error: str
    rms_um: float
    floor_um: float
    tag: Tag
    by: str
    why: str
    mu_star_um: float | None = None
    mu_low_um: float | None = None
    mu_high_um: float | None = None
    rank: tuple[int, int] | None = None
    sigma_um: float | None = None

    @property
    def rank_text(self) -> str:
        """Rank or interval of ranks, "3" or "3–5"; "" without."""
        if self.rank is None:
            return ""
        low, high = self.rank
        return str(low) if low == high else f"{low}–{high}"


def cure_rows(tooth: ToothMaterial) -> tuple[CureRow, ...]:
    """Every error with a cure, the largest on the tooth first."""
    if tooth.proposal is None:
        return ()
    ranked = {one.error: one for one in tooth.proposal.ranking}
    cures = sorted(tooth.proposal.cures, key=lambda one: -one.rms_um)
    return tuple(_cure(one, ranked.get(one.error)) for one in cures)


def _cure(cure: CureRecord, ranked: RankRecord | None) -> CureRow:
    reason = why(cure) if incurable(cure) else ""
    row = CureRow(cure.error, cure.rms_um, cure.floor_um, tag=tag(cure), by=what(cure), why=reason)
    if ranked is None:
        return row
    low, high = ranked.low_um, ranked.high_um
    spread = ranked.sigma_um
    return replace(row, mu_star_um=ranked.mu_star_um, mu_low_um=low, mu_high_um=high, rank=ranked.rank, sigma_um=spread)


@dataclass(frozen=True, slots=True)
class TableRow:
    """One table: name among the proposal, what it is ("X(Z)"), its grid, its span, what became of it."""

    name: str
    table: str
    layer: str
    points: int
    minimum: float
    maximum: float
    step: float
    input_unit: AxisUnit
    low: float
    high: float
    unit: DeviationUnit
    direction: int
    outcome: str
    skipped: str


def table_rows(tables: Sequence[TableMaterial], letters: Mapping[str, str]) -> tuple[TableRow, ...]:
    """Every table of the proposal; ``letters`` translates machine names of axes (X1 -> X) for what it is."""
    return tuple(_table(one, letters) for one in tables)


def table_name(one: TableMaterial, letters: Mapping[str, str]) -> str:
    """X(Z): output of input, by axis letters."""
    out, over = one.change.new.output_axis, one.change.new.input_axis
    return f"{letters.get(out, out)}({letters.get(over, over)})"


def _table(one: TableMaterial, letters: Mapping[str, str]) -> TableRow:
    new = one.change.new
    return TableRow(
        name=one.change.name,
        table=table_name(one, letters),
        layer=spoken().kind(one.change.new.kind),
        points=len(new.deviations),
        minimum=new.minimum,
        maximum=new.maximum,
        step=new.step,
        input_unit=new.input_unit,
        low=min(new.deviations, default=0.0),
        high=max(new.deviations, default=0.0),
        unit=new.deviation_unit,
        direction=new.direction,
        outcome=one.push.outcome if one.push is not None else "",
        skipped=str(one.change.skipped or ""),
    )
