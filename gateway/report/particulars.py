"""What a report says beside what was measured: who made it for whom, and the machine as its owner names it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Maker:
    """Who makes the report: the letterhead. ``logo`` are the bytes of a picture, ``logo_ending`` svg, png or jpg."""

    laboratory: str = ""
    address: tuple[str, ...] = ()
    logo: bytes = b""
    logo_ending: str = ""
    accreditation: str = ""
    country: str = ""


@dataclass(frozen=True, slots=True)
class Parties:
    """For whom, at whose order, where and by whom."""

    customer: str = ""
    customer_address: tuple[str, ...] = ()
    order: str = ""
    place: str = ""
    operator: str = ""


@dataclass(frozen=True, slots=True)
class NamedMachine:
    """The machine as its owner names it; "" and None for what nobody said."""

    maker: str = ""
    type: str = ""
    number: str = ""
    year: int | None = None


@dataclass(frozen=True, slots=True)
class Registered:
    """One entry of the register of equipment; days as YYYY-MM-DD, ``overdue`` by the run's own day."""

    name: str
    instrument: str = ""
    model: str = ""
    serial: str = ""
    certificate: str = ""
    laboratory: str = ""
    calibrated: str = ""
    due: str = ""
    stated: str = ""
    overdue: bool = False


@dataclass(frozen=True, slots=True)
class Particulars:
    """Everything of a report that no instrument told; ``title`` "" is the usual one, ``language`` of the product's."""

    language: str = "en"
    title: str = ""
    number_prefix: str = ""
    maker: Maker = Maker()
    parties: Parties = Parties()
    machine: NamedMachine = NamedMachine()
    signatures: tuple[str, ...] = ()
    register: tuple[Registered, ...] = ()
