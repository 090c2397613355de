"""From a run's site file to what the report says beside the figures: letterhead, parties, the machine's names."""

from __future__ import annotations

from pathlib import Path

from gateway.config import SiteFile
from gateway.config.paper.sections import EquipmentSection
from gateway.report.particulars import Maker, NamedMachine, Particulars, Parties, Registered

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
        register=tuple(_registered(one, day[:10]) for one in site.equipment),
    )


def _registered(one: EquipmentSection, day: str) -> Registered:
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
