"""Result files, or a run that imported one, as a report's material: each file an axis as it was found."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from drivers.errors import ConfigError
from drivers.local.names import shown
from drivers.types.identity import MachineIdentity
from drivers.types.results import MeasuredSet
from drivers.units import deviation_unit
from gateway.config import SiteFile
from gateway.domain.captures import Capture, Corrections
from gateway.evaluate.behaviour.doubts import told, with_doubts
from gateway.evaluate.behaviour.positioning import Surroundings, budget_with, contributions, said_contributions
from gateway.evaluate.optics import corrections
from gateway.evaluate.standards.iso230_2 import evaluate
from gateway.report.material import AxisMaterial, FileUsed, ReportMaterial
from gateway.store import RunFolder, Store
from gateway.store.disk import disk_errors
from gateway.workflow.axes.conditions import stated_of
from gateway.workflow.files.exporting import MeasuredItem, items
from gateway.workflow.files.importing import MEASURED, STATE, How

DOUBLE = "simulated"
LONGEST_NAME = 32


def imported(folder: RunFolder) -> bool:
    """Whether a run holds an imported result file and was never measured."""
    return folder.state == STATE and folder.has(MEASURED)


def material_of_import(
    folder: RunFolder, site: SiteFile | None = None, *, accepted: Mapping[str, str] | None = None
) -> ReportMaterial:
    """A run that imported a result file, as a report shows it, with U by a site's register. Raises CorruptRecord."""
    plan = folder.plan
    said = plan.get("imported", {}) if isinstance(plan, Mapping) else {}
    name = str(said.get("name", folder.run_id))
    item = MeasuredItem(name, folder.get(MEASURED, MeasuredSet))
    file = FileUsed(name, str(said.get("sha256", "")), "imported")
    return _material((item,), (file,), folder.run_id, str(folder.facts["created_utc"]), site=site, accepted=accepted)


def material_of_files(
    paths: Sequence[Path],
    how: How,
    store: Store,
    site: SiteFile | None = None,
    *,
    accepted: Mapping[str, str] | None = None,
) -> ReportMaterial:
    """Result files as a report shows them, each an axis as found; what a site's register states goes into U.

    ``accepted`` are doubts about the readings that a person answers for, reasons by code.

    Raises ConfigError (E-CLI-KIND) for a file that holds no targets, and what reading a file raises.
    """
    found: list[MeasuredItem] = []
    files: list[FileUsed] = []
    for path in paths:
        found += items(path, how, store)
        with disk_errors(path):
            files.append(FileUsed(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), "result file"))
    digest = hashlib.sha256("".join(one.sha256 for one in files).encode()).hexdigest()
    return _material(found, files, f"files-{digest[:6]}", "", site=site, accepted=accepted)


def _material(
    found: Iterable[MeasuredItem],
    files: Sequence[FileUsed],
    run_id: str,
    created: str,
    *,
    site: SiteFile | None,
    accepted: Mapping[str, str] | None = None,
) -> ReportMaterial:
    found = tuple(found)
    named = zip(_names(found), found, strict=True)
    axes = tuple(_axis(name, item, site, accepted or {}) for name, item in named)
    heads = [item.header for item in (_measured(one) for one in found)]
    moments = sorted(head["Date"] for head in heads if head.get("Date"))
    first = moments[0] if moments else created
    return ReportMaterial(
        site=_said(heads, "Machine"),
        machine=MachineIdentity(_said(heads, "Serial No"), "", ()),
        run_id=run_id,
        outcome="not-pushed",
        axes=axes,
        started_utc=first,
        ended_utc=moments[-1] if moments else created,
        software=f"trueflank {metadata.version('trueflank')}",
        operator=_said(heads, "By"),
        files=tuple(files),
        simulated=any(DOUBLE in text.lower() for head in heads for text in head.values()),
    )


def _said(heads: Sequence[Mapping[str, str]], key: str) -> str:
    return next((head[key].strip() for head in heads if head.get(key, "").strip()), "")


def _measured(item: MeasuredItem) -> MeasuredSet:
    if not isinstance(item.content, MeasuredSet):
        raise ConfigError("E-CLI-KIND", item.label, kind=type(item.content).__name__)
    return item.content


def _names(found: Sequence[MeasuredItem]) -> Iterator[str]:
    """What each is called: the axis that its file names, else the file's name; a number behind what stands twice."""
    seen: dict[str, int] = {}
    for item in found:
        name = _measured(item).header.get("Axis", "").strip() or Path(item.label).stem
        name = shown(name)[:LONGEST_NAME]
        seen[name] = seen.get(name, 0) + 1
        yield name if seen[name] == 1 else f"{name} ({seen[name]})"


def _axis(name: str, item: MeasuredItem, site: SiteFile | None, accepted: Mapping[str, str]) -> AxisMaterial:
    measured = with_doubts(_measured(item), accepted)
    unit = deviation_unit(measured.axis_unit)
    letter = shown(measured.header.get("Axis", "").strip())
    known = Surroundings(equipment=stated_of(site, letter) if site is not None else None)
    budget, supposed = budget_with(item.capture or measured, known)
    result = evaluate(measured.targets, measured.deviations, unit, budget=budget)
    done = item.capture.corrections if item.capture is not None else corrections.begin(measured.compensated_for)
    notes = (
        *measured.warnings,
        *item.notes,
        *(one.text for one in supposed),
        said_contributions(contributions(measured, budget), unit),
        *told(measured.doubts),
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
        started_utc=measured.header.get("Date", ""),
        doubts=measured.doubts,
    )
