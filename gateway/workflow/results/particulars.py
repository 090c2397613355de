"""From a run's site file to what the report says beside the figures: letterhead, parties, the machine's names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from drivers.errors import ConfigError
from drivers.local.names import shown
from gateway.config import AxisSection, CaptureConditionsSection, EquipmentSection, SiteFile
from gateway.domain.captures import Capture, Conditions
from gateway.domain.stated import StatedFacts
from gateway.report.material import CONDITIONS
from gateway.report.particulars import Maker, NamedMachine, Particulars, Parties, Registered
from gateway.workflow.files.statements import UNIT_OF, quantity

MOST_LOGO_BYTES = 2_000_000
LOGOS = ("svg", "png", "jpg", "jpeg")


def particulars_of(site: SiteFile, site_path: Path, day: str = "") -> Particulars:
    """What a site file says for the report of a run begun on ``day``; a logo that cannot be read is left out."""
    said, own = site.report, site.machine
    logo, ending = _logo(site, site_path)
    return Particulars(
        language=said.language,
        title=said.title,
        number_prefix=said.number_prefix,
        maker=Maker(
            laboratory=said.laboratory,
            address=said.address,
            logo=logo,
            logo_ending=ending,
            accreditation=said.accreditation,
            country=said.country,
        ),
        parties=Parties(
            customer=said.customer,
            customer_address=said.customer_address,
            order=said.order,
            place=said.place,
            operator=said.operator,
        ),
        machine=NamedMachine(own.maker, own.type, own.number, own.year),
        signatures=said.signatures,
        register=tuple(_accreditation(one, day[:10]) for one in site.equipment),
    )


def _accreditation(one: EquipmentSection, day: str) -> Registered:
    told = ((one.um_per_m, "um/m"), (one.arcsec, "arcsec"), (one.kelvin, "K"))
    return Registered(
        name=one.name,
        instrument=one.instrument,
        model=" ".join(part for part in (one.maker, one.type) if part),
        serial=one.serial,
        certificate=one.certificate,
        laboratory=one.laboratory,
        calibrated=str(one.calibrated or ""),
        due=str(one.due or ""),
        stated=", ".join(f"{value:g} {unit}" for value, unit in told if value is not None),
        overdue=one.due is not None and bool(day) and str(one.due) < day,
    )


def _logo(site: SiteFile, site_path: Path) -> tuple[bytes, str]:
    if site.report.logo is None:
        return b"", ""
    path = site_path.parent / site.report.logo
    ending = path.suffix.lower().lstrip(".")
    try:
        data = path.read_bytes()
    except OSError:
        return b"", ""
    return (data, ending) if ending in LOGOS and len(data) <= MOST_LOGO_BYTES else (b"", "")


# The test conditions of an axis as ISO 230-2 lists them: from run, file, answers and site file; none is supposed.

STATED = tuple(name for name in CaptureConditionsSection.model_fields if name != "axis")
_OF_FILE = {"dwell": "dwell_s"}
CORRECTED = (".rtl", ".rta")
NUMBERS = {"feed": "feed", "dwell_s": "dwell", "overrun": "overrun"}


def conditions_of(
    capture: Capture | None,
    stated: StatedFacts,
    file: str,
    site: SiteFile | None = None,
    axis: AxisSection | None = None,
) -> Mapping[str, str]:
    """Every condition that is known, by key of `CONDITIONS`; what is not there was not stated.

    The run itself counts first, then the file, then what a person stated, then the site file.
    """
    if capture is None:
        return {}
    unit = capture.axis_unit
    sources: list[Mapping[str, str]] = [_recorded_conditions(capture), _of_file(stated.of(file))]
    names = ("",) if axis is None else (axis.name, axis.letter, "")
    sources += [stated.conditions[name] for name in names if name in stated.conditions]
    sources += _of_site(site, axis, unit)
    found: dict[str, str] = {}
    for one in sources:
        for key, text in one.items():
            if text:
                found.setdefault(key, text)
    return {key: found[key] for key in CONDITIONS if key in found}


def _recorded_conditions(capture: Capture) -> dict[str, str]:
    """What the record of the readings itself has."""
    said = capture.conditions or Conditions()
    unit = capture.axis_unit
    found = {
        "feed": _number(said.feed, f"{unit}/min"),
        "dwell_s": _number(said.dwell_s, "s"),
        "overrun": _number(said.overrun, unit),
        "tables": said.compensation,
        "warm_up": said.warm_up,
        "cycle": capture.cycle if capture.source == "live" else "",
        "other_axes": _others(capture.axis, said.stands),
        "expansion": _number(capture.corrections.details.get("expansion.ppm_per_k"), "ppm/K"),
        "compensated": _compensation_word(capture),
    }
    return {key: text for key, text in found.items() if text}


def _number(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:g} {unit}"


def _others(axis: str, stands: Mapping[str, float]) -> str:
    """Where the axes stood that did not move: "Z 150 mm, C 0 deg"."""
    return ", ".join(
        f"{letter} {place:.4g} {'deg' if letter in 'ABC' else 'mm'}"
        for letter, place in stands.items()
        if not axis.startswith(letter)
    )


def _compensation_word(capture: Capture) -> str:
    """Which of air and material the readings are corrected for, as a word of the report; "" where nobody knows.

    Of files only those of the layouts that are always corrected are known; a table states nothing of it.
    """
    if capture.source != "live" and not capture.source.lower().endswith(CORRECTED):
        return ""
    standing: set[str] = set()
    for step in capture.corrections.chain:
        (standing.discard if step.undone else standing.add)(step.step)
    if not capture.corrections.chain:
        return ""
    return "air+material" if "expansion" in standing else "air" if "air" in standing else "nothing"


def _of_file(said: Mapping[str, str]) -> dict[str, str]:
    found = {_OF_FILE.get(key, key): text for key, text in said.items()}
    serial = said.get("instrument_serial", "")
    instrument = ", ".join(part for part in (said.get("instrument", ""), serial) if part)
    return {key: text for key, text in found.items() if key in CONDITIONS} | (
        {"instrument": instrument} if instrument else {}
    )


def _of_site(site: SiteFile | None, axis: AxisSection | None, unit: str) -> list[Mapping[str, str]]:
    if site is None:
        return []
    mine = [one for one in site.test_conditions if one.axis in ("", axis.name if axis is not None else "")]
    found: list[Mapping[str, str]] = [section_words(one, unit) for one in sorted(mine, key=lambda one: not one.axis)]
    return [*found, {"warm_up": site.report.warm_up}]


def section_words(one: CaptureConditionsSection, unit: str) -> dict[str, str]:
    """A section of the site file as texts with units."""
    return {key: with_unit(key, value, unit) for key in STATED if (value := getattr(one, key)) not in (None, "")}


def with_unit(key: str, value: object, unit: str) -> str:
    """A condition as text; a number gets the unit of its key."""
    return f"{value:g} {UNIT_OF[NUMBERS[key]].format(unit)}" if key in NUMBERS else str(value)


def stated_conditions(said: Sequence[str], where: str = "--condition") -> Mapping[str, Mapping[str, str]]:
    """Conditions that a person typed as NAME=VALUE or AXIS.NAME=VALUE: "feed=1000 mm/min", "X1.dwell_s=3 s".

    Raises ConfigError (E-CONDITION: an unknown name, no value, or a number without a unit).
    """
    found: dict[str, dict[str, str]] = {}
    for word in said:
        place, mark, value = word.partition("=")
        axis, _, key = place.strip().rpartition(".")
        text = " ".join(value.split())
        unit = key in NUMBERS and quantity(NUMBERS[key], text) is None
        if not mark or key not in STATED or not text or unit:
            raise ConfigError("E-CONDITION", where, text=shown(word), known=", ".join(STATED))
        found.setdefault(axis, {})[key] = text
    return found
