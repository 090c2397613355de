"""The plan of set-ups: what the site file says made whole, and put in the order with the fewest remountings; pure."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from drivers.errors import ConfigError
from drivers.units import DeviationUnit, deviation_unit
from gateway.config import AxisSection, SetupSection, SiteFile, Targets
from gateway.domain.values import COVERAGE, component_unit
from gateway.evaluate.geometry.measurement import Measurement
from gateway.table.proposal import InstrumentU

# Inherited from the axis' measure section unless the set-up says otherwise.
OWN = ("targets", "repetitions", "settle_s", "average_s", "stable", "material_degc")
ORDER = "ABCXYZ"
DEFAULT_U = 0.3
WORD_OF_A_PERSON = ("accept_doubts", "accept")
JOG = {"linear": 10.0, "rotary": 5.0}


@dataclass(frozen=True, slots=True)
class PlannedSetup:
    """One set-up made whole: ``axis`` carries its component, instrument, targets; ``unit`` is that of its readings.

    ``leader`` is the key of the set-up whose mounting and stops it shares (`mount`); "" where it has its own.
    """

    key: str
    setup: SetupSection
    axis: AxisSection
    unit: DeviationUnit
    positioning: bool
    leader: str = ""

    def was_measured_as(self, kept: str, *, shortened: bool = False) -> bool:
        """Whether a set-up's stored form is what the site file has: its doubts may have been accepted since.

        ``shortened``: a plan for limited hours had chosen its targets and repetitions.
        """
        # A run of an older version knew no shared mountings.
        now, then = json.loads(self.setup.model_dump_json()), {"mount": ""} | json.loads(kept)
        free = (*WORD_OF_A_PERSON, *(("targets", "repetitions") if shortened else ()))
        return all(now.get(key) == then.get(key) for key in (*now, *then) if key not in free)

    @property
    def measured(self) -> bool:
        """Whether somebody measures it, live or by file."""
        return self.setup.source != "none"

    @property
    def systematic(self) -> float:
        """Standard uncertainty that repetition does not show, in `unit`."""
        if self.setup.U is not None:
            return self.setup.U / COVERAGE
        if not self.positioning:
            return DEFAULT_U / COVERAGE
        usual = InstrumentU.usual(deviation_unit(self.axis.unit))
        return (usual.constant + usual.per_unit * (self.axis.travel[1] - self.axis.travel[0])) / COVERAGE

    @property
    def jog(self) -> float:
        """The plausibility move in the axis unit."""
        return self.setup.jog if self.setup.jog is not None else JOG[self.axis.kind]

    def measurement(
        self, targets: Any, deviations: Any, rotary: Collection[str], stands: Mapping[str, float] | None = None
    ) -> Measurement:
        """What was captured, for the model; ``rotary`` names the rotary axes, ``stands`` where axes stood by letter."""
        parked = [place for name, place in self.setup.park.items() if name in rotary]
        return Measurement(
            component=self.setup.component,
            letter=self.axis.letter,
            axis_unit=self.axis.unit,
            targets=targets,
            deviations=deviations,
            reference=self.axis.reference,
            modulo=self.axis.modulo,
            offset_mm=self.setup.offset_mm,
            systematic=self.systematic,
            own_angle_arcsec=self.setup.own_angle_arcsec,
            turned_deg=parked[0] if parked else None,
            stands=stands or {},
        )


def plan_setups(site: SiteFile) -> tuple[PlannedSetup, ...]:
    """Every set-up of the site, in the order it is best measured; each axis' own measure section is one.

    Raises ConfigError (E-SETUP-NONE) without any set-up, E-SETUP-TARGETS.
    """
    if not site.setups:
        raise ConfigError("E-SETUP-NONE", site.site.name)
    axes = {axis.name: axis for axis in site.axes}
    listed = {(setup.component, setup.axis) for setup in site.setups}
    own = [_own_positioning(axis) for axis in site.axes if (axis.measure.component, axis.name) not in listed]
    setups = [*(setup for setup in own if setup is not None), *site.setups]
    return _share_mountings(
        _order_setups([_complete_setup(setup, axes[setup.axis]) for setup in setups], [axis.name for axis in site.axes])
    )


SHARED = ("targets", "repetitions", "settle_s", "average_s", "cycle")


def _share_mountings(plan: Sequence[PlannedSetup]) -> tuple[PlannedSetup, ...]:
    """Set-ups of one mounting one after the other, behind the one that leads: its positioning, or the first.

    They take its targets and repetitions, for they are read at its stops. Raises ConfigError (E-SETUP-MOUNT) where
    they are not of one instrument, axis and place, or are read from files.
    """
    groups: dict[str, list[PlannedSetup]] = {}
    for one in plan:
        if one.setup.mount:
            groups.setdefault(one.setup.mount, []).append(one)
    leaders: dict[str, tuple[PlannedSetup, ...]] = {}
    for name, members in groups.items():
        places = {(one.axis.name, one.setup.instrument, tuple(sorted(one.setup.park.items()))) for one in members}
        if len(places) > 1 or any(one.setup.source != "live" or one.setup.step for one in members):
            raise ConfigError("E-SETUP-MOUNT", "setups", mount=name, setups=", ".join(one.key for one in members))
        lead = next((one for one in members if one.positioning), members[0])
        leaders[name] = (lead, *(_behind(one, lead) for one in members if one is not lead))
    last = {name: max(n for n, one in enumerate(plan) if one.setup.mount == name) for name in groups}
    found: list[PlannedSetup] = []
    for n, one in enumerate(plan):
        if not one.setup.mount:
            found.append(one)
        elif last[one.setup.mount] == n:
            found += leaders[one.setup.mount]
    return tuple(found)


def _behind(one: PlannedSetup, lead: PlannedSetup) -> PlannedSetup:
    shared = {name: getattr(lead.axis.measure, name) for name in SHARED}
    axis = one.axis.model_copy(update={"measure": one.axis.measure.model_copy(update=shared)})
    return replace(one, axis=axis, leader=lead.key)


def mounted_setups(plan: Sequence[PlannedSetup]) -> tuple[PlannedSetup, ...]:
    """Those of a plan that are mounted themselves: all but the ones whose leader is there."""
    keys = {one.key for one in plan}
    return tuple(one for one in plan if one.leader not in keys)


def _own_positioning(axis: AxisSection) -> SetupSection | None:
    """An axis' own positioning as a set-up; None where it measures something that is no component of it."""
    measure = axis.measure
    if measure.component != f"E{axis.letter}{axis.letter}":
        return None
    if measure.file is None:
        return SetupSection(axis=axis.name, component=measure.component, instrument=measure.instrument)
    return SetupSection(
        axis=axis.name,
        component=measure.component,
        source="file",
        path=measure.file,
        datum=measure.file_datum,
        unit=measure.file_unit,
        file_axis_sense=measure.file_axis_sense,
        material_degc=measure.material_degc,
        accept_doubts=measure.accept_doubts,
        accept=measure.accept,
    )


def _complete_setup(setup: SetupSection, axis: AxisSection) -> PlannedSetup:
    own = {name: getattr(setup, name) for name in OWN if getattr(setup, name) is not None}
    changes: dict[str, Any] = {"component": setup.component, "instrument": setup.instrument, "file": None, **own}
    changes["accept"] = (*axis.measure.accept, *setup.accept)
    changes["accept_doubts"] = {**axis.measure.accept_doubts, **setup.accept_doubts}
    if setup.source == "file":
        more = {"file": setup.path, "file_datum": setup.datum, "file_axis_sense": setup.file_axis_sense}
        changes |= more
    elif setup.source == "live" and changes.get("targets", axis.measure.targets) is None:
        raise ConfigError("E-SETUP-TARGETS", setup.component, axis=axis.name)
    measure = axis.measure.model_copy(update=changes)
    name = setup.name
    location = name[1] == "0"
    unit: DeviationUnit = "um" if location else component_unit(name, axis.unit)
    positioning = not location and name[1] == name[2]
    return PlannedSetup(
        key=key_of(setup),
        setup=setup,
        axis=axis.model_copy(update={"measure": measure}),
        unit=unit,
        positioning=positioning,
    )


def key_of(setup: SetupSection) -> str:
    """The set-up's name in a run folder and on the command line: EYX-X1, B0Z-R-X1, A0C-Z1-C1at180."""
    parked = "".join(f"-{axis}at{place:g}" for axis, place in sorted(setup.park.items()))
    return f"{setup.component}-{setup.axis}{parked}"


def with_way(one: PlannedSetup, positions: Sequence[float], repetitions: int) -> PlannedSetup:
    """The set-up at these targets (mm or deg) with so many repetitions; all else as the site file has it."""
    targets = Targets(positions=tuple(float(place) for place in positions))
    return _complete_setup(one.setup.model_copy(update={"targets": targets, "repetitions": repetitions}), one.axis)


def _order_setups(plan: Sequence[PlannedSetup], axes: Sequence[str]) -> tuple[PlannedSetup, ...]:
    """One instrument after the other, files first; with each, all of one artefact, then one axis after the other.

    What measures the axes' own positioning comes last: a push asks for a young measurement at the same warmth.
    """
    ranks: dict[str, int] = {}
    for one in sorted(plan, key=lambda one: one.positioning):
        ranks.setdefault(_tool(one), len(ranks))

    def rank(one: PlannedSetup) -> tuple[object, ...]:
        setup = one.setup
        artefact = setup.name if setup.name[1] == "0" else ""
        files = 0 if setup.source != "live" else 1
        place = tuple(sorted(setup.park.items()))
        way = ORDER.find(setup.component[1]) if not artefact else 0
        return files, ranks[_tool(one)], artefact, setup.turned, axes.index(setup.axis), way, place

    return tuple(sorted(plan, key=rank))


def _tool(one: PlannedSetup) -> str:
    return one.setup.instrument if one.setup.source == "live" else ""


def remountings(plan: Sequence[PlannedSetup]) -> int:
    """How often another instrument, or the same one on another axis or artefact, must be mounted along a plan."""
    alone = mounted_setups(plan)
    kinds = [(_tool(p), p.axis.name, p.setup.name if p.setup.name[1] == "0" else "", p.setup.turned) for p in alone]
    return sum(before != after for before, after in zip([None, *kinds], kinds, strict=False) if after[0])


def select_setups(plan: Sequence[PlannedSetup], wanted: Sequence[str]) -> tuple[PlannedSetup, ...]:
    """Those asked for by key or component (none: all), if they are measured. Raises ConfigError (E-SETUP-UNKNOWN)."""
    able = [one for one in plan if one.measured]
    for name in wanted:
        if not any(name in (one.key, one.setup.component, one.setup.name) for one in able):
            raise ConfigError("E-SETUP-UNKNOWN", "--setups", name=name, known=", ".join(one.key for one in able))
    return tuple(one for one in able if not wanted or {one.key, one.setup.component, one.setup.name} & set(wanted))


def spans(site: SiteFile) -> Mapping[str, float]:
    """Assumed half widths by name, where a set-up gives one."""
    return {setup.name: setup.assumed for setup in site.setups if setup.assumed is not None}
