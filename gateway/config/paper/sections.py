"""What a site file says for the report: letterhead, parties, the machine, the register of equipment, tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from gateway.siteplan import Flag, MaybeName, Name, Number, Section, Whole

MOST_LINES = 8
Line = Annotated[str, Field(max_length=120)]
Lines = Annotated[tuple[Line, ...], Field(max_length=MOST_LINES)]
Letters = Annotated[tuple[Annotated[str, Field(pattern=r"^[A-CXYZ]$")], ...], Field(max_length=6)]


class ReportSection(Section):
    """The calibration report: who makes it, for whom, in which language."""

    language: Literal["en", "de", "zh"] = Field(default="en", description="language of the report")
    title: Line = Field(default="", description="what it is called; left out: calibration report")
    accreditation: Line = Field(default="", description="accreditation number; no mark is drawn")
    laboratory: Line = Field(default="", description="who makes the report, on the letterhead")
    address: Lines = Field(default=(), description="its address, a line each")
    country: Annotated[str, Field(pattern=r"^([A-Z]{2})?$")] = Field(
        default="", description="its country by ISO 3166: DE, CN; for the digital certificate"
    )
    logo: Path | None = Field(default=None, description="logo (.svg, .png, .jpg), relative to the site file")
    customer: Line = Field(default="", description="for whom it is made")
    customer_address: Lines = Field(default=(), description="the customer's address, a line each")
    order: Line = Field(default="", description="number of the order")
    place: Line = Field(default="", description="location of the machine")
    operator: Line = Field(default="", description="who measured")
    number_prefix: Annotated[str, Field(max_length=20, pattern=r"^[A-Za-z0-9_.-]*$")] = Field(
        default="", description="prefix of the report's number"
    )
    warm_up: Line = Field(default="", description="how the machine was warmed up before measuring")
    refuse_overdue: Flag = Field(
        default=False, description="a run is refused while a calibration in the register is overdue; else a warning"
    )
    signatures: Lines = Field(default=(), description="who signs; left out: calibrated by, checked by")


class MachineSection(Section):
    """The machine as its owner names it; nothing of it is compared with the control."""

    maker: Line = Field(default="", description="maker of the machine")
    type: Line = Field(default="", description="type")
    number: Line = Field(
        default="", description="machine number; left out: only the control's serial number is printed"
    )
    year: Whole | None = Field(default=None, ge=1900, le=2200, description="year of manufacture")
    work_side: Letters = Field(
        default=(), description="letters of the axes from the bed outward to the work, for the drawings of mountings"
    )
    tool_side: Letters = Field(
        default=(), description="letters of the axes from the bed outward to the tool or wheel, for these drawings"
    )


class EquipmentSection(Section):
    """One entry of the register of equipment: who calibrated it, until when, and the uncertainty stated for it."""

    name: Line = Field(min_length=1, description="what it is: laser head, optics, rotary calibrator, sensor ...")
    instrument: MaybeName = Field(default="", description="the instrument of this site that it belongs to, if any")
    maker: Line = Field(default="", description="maker")
    type: Line = Field(default="", description="type")
    serial: Line = Field(default="", description="serial number")
    certificate: Line = Field(default="", description="number of its calibration certificate")
    laboratory: Line = Field(default="", description="who calibrated it")
    calibrated: date | None = Field(default=None, description="day of calibration, YYYY-MM-DD")
    due: date | None = Field(default=None, description="day on which the next one is due, YYYY-MM-DD")
    um_per_m: Number | None = Field(
        default=None, gt=0, le=100.0, description="stated U (k = 2) of a laser system, um/m; used instead of 0.5"
    )
    arcsec: Number | None = Field(
        default=None, gt=0, le=100.0, description="stated U (k = 2) of a rotary calibrator, arcsec; instead of 1"
    )
    kelvin: Number | None = Field(
        default=None, gt=0, le=10.0, description="stated U (k = 2) of a material sensor, K; instead of a range of 0.2"
    )


class CaptureConditionsSection(Section):
    """How readings of files were taken, of one axis or of all: what a file states itself counts before it."""

    axis: MaybeName = Field(default="", description="machine axis; left out: every axis")
    feed: Number | None = Field(default=None, gt=0, le=1e6, description="feed, mm/min or deg/min")
    overrun: Number | None = Field(default=None, gt=0, le=1000.0, description="overrun before reversing, mm or deg")
    dwell_s: Number | None = Field(default=None, gt=0, le=600.0, description="dwell at each target, s")
    cycle: Literal["", "standard", "pendulum", "pilgrim"] = Field(default="", description="measuring cycle")
    tables: Line = Field(default="", description="compensation tables that acted: none, or their names")
    warm_up: Line = Field(default="", description="warm-up before measuring; left out: that of [report]")
    other_axes: Line = Field(default="", description="positions of the axes that did not move")
    offsets: Line = Field(default="", description="offsets from the measuring line to tool and workpiece reference")
    sensors: Line = Field(default="", description="places of the temperature sensors")
    instrument: Line = Field(default="", description="instrument and its optics")


Limits = Annotated[Mapping[Name, Annotated[Number, Field(gt=0, le=1e6)]], Field(max_length=20)]


class ToleranceSection(Section):
    """Limits of one axis by a standard and edition, in um or arcsec; each is decided with its U by ISO 14253-1."""

    axis: Name = Field(description="machine axis")
    standard: Line = Field(
        default="ISO 230-2:2014", description="standard and edition, as `evaluate --standard` has it"
    )
    limits: Limits = Field(description="limit by the standard's own letter: { A = 8.0, M = 5.0 }, um or arcsec")


class GearToleranceSection(Section):
    """Limits of the gear's figures: those of the reducer or an own tolerance, um, or a class of ISO 1328-1:2013.

    That standard is for involute gears: for a cycloid disc its class is an own tolerance that is named so.
    """

    grade: Whole | None = Field(
        default=None,
        ge=2,
        le=11,
        description="class by the formulae of ISO 1328-1:2013, as a named own tolerance: the standard is for involute "
        "gears; that its classes go from 2 to 11 is remembered, not looked up",
    )
    module_mm: Number | None = Field(default=None, gt=0, le=100.0, description="module for that class, mm")
    diameter_mm: Number | None = Field(default=None, gt=0, le=10000.0, description="reference diameter for it, mm")
    width_mm: Number | None = Field(default=None, gt=0, le=2000.0, description="face width for it, mm")
    limits: Limits = Field(default_factory=dict, description="limit by figure, um: { F_alpha = 6.0, F_p = 20.0 }")
