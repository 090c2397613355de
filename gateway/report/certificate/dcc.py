"""The report as a digital calibration certificate: DCC 3.1.2 of the PTB with units by D-SI 2.1; pure.

Written from the public schema. Figures stand with their U (k = 2), deviations target by target, as found and as left.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from drivers.message import words
from gateway.report.certificate.quantities import deviations, figure, influences
from gateway.report.certificate.tree import Node, node, text_of
from gateway.report.material import AxisMaterial, Judged, ReportMaterial
from gateway.report.parameters import PARAMETERS

NAMESPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
VERSION = "3.1.2"
NO_COUNTRY = "ZZ"
"""The code of ISO 3166 that stands for none: nobody said a country."""
DAY = re.compile(r"\d{4}-\d\d-\d\d")
NOT_STATED = "not stated"
SIMULATED = words("S-DCC-SIMULATED")
STATUS = {"pass": "pass", "fail": "fail", "not decidable": "noPass"}


def dcc(material: ReportMaterial, number: str) -> str:
    """The certificate as XML text; same material, same text. Raises ValueError where no axis was evaluated."""
    results = tuple(one for axis in material.axes for one in _results(axis, material))
    if not results:
        raise ValueError("no axis was evaluated")
    root = node(
        "dcc:digitalCalibrationCertificate",
        (_administrative(material, number), node("dcc:measurementResults", (*results,))),
        schemaVersion=VERSION,
    )
    return text_of(root, NAMESPACES)


def evaluated(material: ReportMaterial) -> bool:
    """Whether there is anything that a certificate could state."""
    return any(axis.before is not None or axis.after is not None for axis in material.axes)


def _administrative(material: ReportMaterial, number: str) -> Node:
    name, _, release = material.software.partition(" ")
    software = node(
        "dcc:software", (_named("dcc:name", name or "trueflank"), node("dcc:release", release or NOT_STATED))
    )
    return node(
        "dcc:administrativeData",
        (
            node("dcc:dccSoftware", software),
            _core(material, number),
            node("dcc:items", _item(material)),
            _laboratory(material),
            node("dcc:respPersons", _person(material)),
            _contact(
                "dcc:customer", material.particulars.parties.customer, material.particulars.parties.customer_address
            ),
            _statements(material),
        ),
    )


def _core(material: ReportMaterial, number: str) -> Node:
    first, last = _days(material)
    order = material.particulars.parties.order
    ids = [_identified("calibrationLaboratory", material.run_id, "record")]
    ids += [_identified("customer", order, "order")] if order else []
    return node(
        "dcc:coreData",
        (
            node("dcc:countryCodeISO3166_1", material.particulars.maker.country or NO_COUNTRY),
            node("dcc:usedLangCodeISO639_1", "en"),
            node("dcc:mandatoryLangCodeISO639_1", "en"),
            node("dcc:uniqueIdentifier", number),
            node("dcc:identifications", (*ids,)),
            node("dcc:beginPerformanceDate", first),
            node("dcc:endPerformanceDate", last),
            node("dcc:performanceLocation", "customer"),
        ),
    )


def _days(material: ReportMaterial) -> tuple[str, str]:
    """First and last day; a file that says none has the day that stands for none."""
    found = [DAY.match(moment) for moment in (material.started_utc, material.ended_utc)]
    days = [one[0] for one in found if one is not None]
    return (min(days), max(days)) if days else ("0001-01-01", "0001-01-01")


def _item(material: ReportMaterial) -> Node:
    own = material.particulars.machine
    name = " ".join(part for part in (own.maker, own.type) if part) or material.site or NOT_STATED
    ids = [_identified("manufacturer", own.number, "machine number")] if own.number else []
    ids.append(_identified("manufacturer", material.machine.serial or NOT_STATED, "control serial number"))
    return node(
        "dcc:item",
        (
            _named("dcc:name", f"{name}{' (SIMULATED)' if material.simulated else ''}"),
            node("dcc:manufacturer", _named("dcc:name", own.maker or NOT_STATED)),
            node("dcc:model", own.type) if own.type else None,
            node("dcc:identifications", (*ids,)),
        ),
    )


def _laboratory(material: ReportMaterial) -> Node:
    maker = material.particulars.maker
    code = node("dcc:calibrationLaboratoryCode", maker.accreditation) if maker.accreditation else None
    return node("dcc:calibrationLaboratory", (code, _contact("dcc:contact", maker.laboratory, maker.address)))


def _person(material: ReportMaterial) -> Node:
    name = material.particulars.parties.operator or material.operator or NOT_STATED
    return node("dcc:respPerson", (node("dcc:person", _named("dcc:name", name)), node("dcc:role", "calibrated by")))


def _contact(tag: str, name: str, address: tuple[str, ...]) -> Node:
    place = node(
        "dcc:location", node("dcc:further", (*(node("dcc:content", line) for line in address or (NOT_STATED,)),))
    )
    return node(tag, (_named("dcc:name", name or NOT_STATED), Node("dcc:eMail", ""), place))


def _statements(material: ReportMaterial) -> Node | None:
    found = [_conformity(one) for one in material.judged]
    if material.simulated:
        found.insert(0, node("dcc:statement", node("dcc:declaration", node("dcc:content", SIMULATED))))
    return node("dcc:statements", (*found,)) if found else None


def _conformity(one: Judged) -> Node:
    state = "as left" if one.as_left else "as found"
    said = f"{one.of}, {one.decision.parameter} <= {one.decision.limit:g}, {state}: {one.decision.verdict}"
    return node(
        "dcc:statement",
        (
            node("dcc:convention", "ISO 14253-1, guard band U (k = 2)"),
            node("dcc:norm", one.standard) if one.standard else None,
            node("dcc:declaration", node("dcc:content", said)),
            node("dcc:conformity", STATUS[one.decision.verdict]),
        ),
    )


def _results(axis: AxisMaterial, material: ReportMaterial) -> Iterator[Node]:
    for state, found, capture in (
        ("as found", axis.before, axis.capture_before),
        ("as left", axis.after, axis.capture_after),
    ):
        if found is None:
            continue
        values = [(name, getattr(found, name), found.U.get(name)) for name in PARAMETERS]
        quantities = [figure(name, value, U=U, unit=found.unit) for name, value, U in values if value is not None]
        status = "beforeAdjustment" if found is axis.before else "afterAdjustment"
        if not quantities:
            continue
        yield node(
            "dcc:measurementResult",
            (
                _named("dcc:name", f"{axis.axis} {axis.component}, {state}".replace("  ", " ")),
                node(
                    "dcc:usedMethods",
                    node("dcc:usedMethod", (_named("dcc:name", "positioning"), node("dcc:norm", found.standard))),
                ),
                _equipment(material),
                influences(capture, status) if capture is not None else None,
                node(
                    "dcc:results",
                    (
                        node("dcc:result", (_named("dcc:name", "figures"), node("dcc:data", (*quantities,)))),
                        node(
                            "dcc:result",
                            (_named("dcc:name", "mean deviations"), node("dcc:data", deviations(found, axis.unit))),
                        ),
                    ),
                ),
            ),
        )


def _equipment(material: ReportMaterial) -> Node | None:
    """The register's entries; what is in no register is not claimed here."""
    found = [
        node(
            "dcc:measuringEquipment",
            (
                _named("dcc:name", one.name),
                node("dcc:model", one.model) if one.model else None,
                _ids(
                    (
                        ("manufacturer", one.serial, "serial number"),
                        ("other", one.certificate, "calibration certificate"),
                    )
                ),
            ),
        )
        for one in material.particulars.register
    ]
    return node("dcc:measuringEquipments", (*found,)) if found else None


def _ids(told: Iterable[tuple[str, str, str]]) -> Node | None:
    found = [_identified(issuer, value, name) for issuer, value, name in told if value]
    return node("dcc:identifications", (*found,)) if found else None


def _identified(issuer: str, value: str, name: str) -> Node:
    return node("dcc:identification", (node("dcc:issuer", issuer), node("dcc:value", value), _named("dcc:name", name)))


def _named(tag: str, text: str) -> Node:
    return node(tag, node("dcc:content", text, lang="en"))
