"""Result files, or a run that imported one, as a report's material: each file an axis as it was found."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.types.identity import MachineIdentity
from drivers.types.results import MeasuredSet
from drivers.units import deviation_unit
from gateway.config import SiteFile
from gateway.domain.captures import Capture, Corrections
from gateway.domain.stated import StatedFacts
from gateway.evaluate.behaviour.doubts import remarks, with_doubts
from gateway.evaluate.behaviour.positioning import Surroundings, budget_with, contributions, describe_contributions
from gateway.evaluate.optics import corrections
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from gateway.report.material import AxisMaterial, FileUsed, ReportMaterial
from gateway.store import Maps, RunFolder, Store, disk_errors
from gateway.workflow.axes.measure import stated_uncertainties_of
from gateway.workflow.files.exporting import MeasuredItem, measured_items
from gateway.workflow.files.headers import NAME, moment_of
from gateway.workflow.files.importing import STATE
from gateway.workflow.files.reading import ReadOptions
from gateway.workflow.files.statements import FileFacts, StatementComparison, facts_of
from gateway.workflow.results.particulars import conditions_of
from gateway.workflow.run import stages
from gateway.workflow.run.stages import MEASURED

DOUBLE = "simulated"
LONGEST_NAME = 32
CONDITION = "condition"
Conditions = Mapping[str, Mapping[str, str]]
"""Test conditions by axis ("" for every axis) and key."""


def is_imported(folder: RunFolder) -> bool:
    """Whether a run holds an imported result file and was never measured."""
    return folder.state == STATE and folder.has(MEASURED)


def material_of_import(
    folder: RunFolder,
    at: StatementComparison | None = None,
    maps: Maps | None = None,
    accepted: Mapping[str, str] | None = None,
) -> ReportMaterial:
    """A run that imported a result file, as a report shows it, with U by a site's register.

    ``at`` says with which site the file is compared. Raises CorruptRecord, ConfigError (E-FACTS-DIFFER and others of
    `settle`).
    """
    at = at or StatementComparison()
    plan = folder.plan
    said = plan.get("imported", {}) if isinstance(plan, Mapping) else {}
    name = str(said.get("name", folder.run_id))
    component = str(said.get("component", ""))
    item = MeasuredItem(f"{name} {component}".strip(), folder.get(MEASURED, MeasuredSet))
    file = FileUsed(name, str(said.get("sha256", "")), "imported")
    before = folder.get(stages.STATED, StatedFacts) if folder.has(stages.STATED) else StatedFacts()
    found = at.settled([facts_of(name, _measured_set(item).header)], maps)
    known = {(one.file, one.key, one.value): one for one in (*before.accepted, *found.accepted)}
    stated = replace(found, accepted=tuple(known.values()), conditions=before.conditions)
    made = _Files((item,), (name,), (file,), stated, at.site, accepted or {})
    return made.material(folder.run_id, str(folder.facts["created_utc"]))


def keep_conditions(folder: RunFolder, new: Conditions) -> None:
    """Keep test conditions that a person stated with the run. Raises StoreError."""
    stated = folder.get(stages.STATED, StatedFacts) if folder.has(stages.STATED) else StatedFacts()
    known = {axis: {**stated.conditions.get(axis, {}), **own} for axis, own in new.items()}
    folder.put(stages.STATED, replace(stated, conditions={**stated.conditions, **known}))


def material_of_files(
    paths: Sequence[Path],
    how: ReadOptions,
    store: Store,
    at: StatementComparison | None = None,
    *,
    conditions: Conditions | None = None,
    accepted: Mapping[str, str] | None = None,
) -> ReportMaterial:
    """Result files as a report shows them, each an axis as found; what a site's register states goes into U.

    What the files state is compared with the site of ``at`` and with each other. ``conditions`` are test conditions
    that a person stated; they are remembered for these files. ``accepted`` are doubts about the readings that a person
    answers for, reasons by code. Raises ConfigError (E-CLI-KIND) for a file that holds no targets, and what reading a
    file and `settle` raise.
    """
    at = at or StatementComparison()
    found: list[MeasuredItem] = []
    names: list[str] = []
    files: list[FileUsed] = []
    facts: list[FileFacts] = []
    for path in paths:
        new = measured_items(path, how, store)
        found += new
        names += [path.name] * len(new)
        facts.append(facts_of(path.name, _measured_set(new[0]).header))
        with disk_errors(path):
            files.append(FileUsed(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), "result file"))
    digest = hashlib.sha256("".join(one.sha256 for one in files).encode()).hexdigest()
    maps = Maps(store.root)
    stated = replace(at.settled(facts, maps), conditions=_remembered_conditions(maps, digest, conditions))
    made = _Files(tuple(found), tuple(names), tuple(files), stated, at.site, accepted or {})
    return made.material(f"files-{digest[:6]}", "")


def _remembered_conditions(maps: Maps, digest: str, new: Conditions | None) -> Conditions:
    """The test conditions that a person ever stated for these files, the new ones kept with them."""
    kept = maps.find(CONDITION, digest)
    flat = {str(key): str(value) for key, value in kept.said.items()} if kept is not None else {}
    if new:
        flat |= {f"{axis}.{key}": text for axis, own in new.items() for key, text in own.items()}
        maps.keep(CONDITION, digest, flat, "")
    found: dict[str, dict[str, str]] = {}
    for place, text in flat.items():
        axis, _, key = place.rpartition(".")
        found.setdefault(axis, {})[key] = text
    return found


@dataclass(frozen=True, slots=True)
class _Files:
    """Measured items with the file that each comes from, and everything that was settled about them."""

    found: tuple[MeasuredItem, ...]
    names: tuple[str, ...]
    files: tuple[FileUsed, ...]
    stated: StatedFacts
    site: SiteFile | None
    answered: Mapping[str, str]

    def material(self, run_id: str, created: str) -> ReportMaterial:
        labels = _names(self.found)
        axes = tuple(
            self._axis(label, item, name) for label, item, name in zip(labels, self.found, self.names, strict=True)
        )
        heads = [_measured_set(one).header for one in self.found]
        moments = sorted(filter(None, (moment_of(text) for text in self.stated.values("date"))))
        unclear = next(iter(self.stated.values("date")), "")
        first, last = (moments[0], moments[-1]) if moments else (unclear or created,) * 2
        return ReportMaterial(
            site=self.site.site.name if self.site is not None else ", ".join(self.stated.values("machine")),
            machine=MachineIdentity(self._serial, "", ()),
            run_id=run_id,
            outcome="not-pushed",
            axes=axes,
            started_utc=first,
            ended_utc=last,
            software=f"trueflank {metadata.version('trueflank')}",
            operator=", ".join(self.stated.values("operator")),
            files=self.files,
            simulated=any(DOUBLE in text.lower() for head in heads for text in head.values()),
            stated=self.stated,
        )

    @property
    def _serial(self) -> str:
        """Serial number of the site's control; without a site that which the files state."""
        return self.site.controller.serial if self.site is not None else ", ".join(self.stated.values("serial"))

    def _axis(self, name: str, item: MeasuredItem, file: str) -> AxisMaterial:
        found = _axis(name, item, self.site, self.answered)
        meant = self.site.meant(found.letter) if self.site is not None else None
        return replace(found, test_before=conditions_of(found.capture_before, self.stated, file, self.site, axis=meant))


def _measured_set(item: MeasuredItem) -> MeasuredSet:
    if not isinstance(item.content, MeasuredSet):
        raise ConfigError("E-CLI-KIND", item.label, kind=type(item.content).__name__)
    return item.content


def _names(found: Sequence[MeasuredItem]) -> Iterator[str]:
    """What each is called: the axis that its file names, else the file's name; a number behind what stands twice."""
    seen: dict[str, int] = {}
    for item in found:
        header = _measured_set(item).header
        title = header.get("TITLE", "").split()[:1]
        motion = title[0] if title and NAME.fullmatch(title[0]) else ""
        name = header.get("Axis", "").strip() or Path(item.label).stem
        name = f"{name} {motion}" if motion and item.label.endswith(f" {motion}") else name
        name = shown(name)[:LONGEST_NAME]
        seen[name] = seen.get(name, 0) + 1
        yield name if seen[name] == 1 else f"{name} ({seen[name]})"


def _axis(name: str, item: MeasuredItem, site: SiteFile | None, accepted: Mapping[str, str]) -> AxisMaterial:
    measured = _measured_set(item)
    unit = deviation_unit(measured.axis_unit)
    letter = shown(measured.header.get("Axis", "").strip())
    axis = site.meant(letter) if site is not None else None
    measured = with_doubts(measured, accepted, modulo=axis is not None and axis.modulo)
    known = Surroundings(equipment=stated_uncertainties_of(site, letter) if site is not None else None)
    budget, supposed = budget_with(item.capture or measured, known)
    result = evaluate_iso230_2(measured.targets, measured.deviations, unit, budget=budget)
    done = item.capture.corrections if item.capture is not None else corrections.begin(measured.compensated_for)
    notes = (
        *measured.warnings,
        *item.notes,
        *(one.message for one in supposed),
        describe_contributions(contributions(measured, budget), unit),
        *remarks(measured.doubts),
    )
    return AxisMaterial(
        axis=name,
        letter=letter,
        unit=measured.axis_unit,
        capture_before=_capture(name, item.label, measured, done),
        before=result,
        findings=tuple(dict.fromkeys(notes)),
        budget=budget,
    )


def _capture(axis: str, label: str, measured: MeasuredSet, done: Corrections) -> Capture:
    return Capture(
        axis=axis,
        component="",
        axis_unit=measured.axis_unit,
        targets=measured.targets,
        deviations=measured.deviations,
        reading_u=0.0,
        ambient_start=measured.ambient_start,
        ambient_end=measured.ambient_end,
        corrections=done,
        live=None,
        sense=None,
        source=label,
        started_utc=moment_of(measured.header.get("Date", "")) or measured.header.get("Date", ""),
        doubts=measured.doubts,
    )
