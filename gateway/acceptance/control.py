"""The road to a control, line by line, with nothing changed: what `doctor` says at its lowest level.

The site's driver asks the control; what this PC knows of it is added: changes of the machine that a person accepted,
self-tests kept, pushes that did not end, the font for reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.checks import CheckLine, Wanted, WantedAxis, fine, unknown, wrong
from drivers.clock import Clock
from drivers.stale_programs import Sent
from gateway.config import AxisSection, SiteFile
from gateway.push import JOURNALS, SentProgramBook, held_pushes
from gateway.store.machine_books import SelfTestBook
from gateway.workflow.run.folder import known_of, store_of


async def examine_control(site: SiteFile, path: Path, clock: Clock) -> tuple[CheckLine, ...]:
    """Every line: the road to the control, the self-tests kept, pushes that did not end. Writes nothing.

    Raises ConfigError (E-CFG-DRIVER) for a driver that has no doctor.
    """
    known, control = known_of(site, store_of(site, path).root), site.controller
    doctor = registry.load(f"{control.driver}-doctor", "doctor")(site.site.name, control.url, control.settings, clock)
    lines = await doctor.examine(wanted_control(site, sent_programs(site, path), known.facts), control.timeout_s)
    excused = [fine("W-DOC-ACCEPTED", "identity", **one.fields) for one in known.accepted]
    return (
        *lines,
        *excused,
        *stored_self_tests(site, path, lines),
        *unfinished_pushes(site, path),
        *report_font_line(site.report.language),
    )


def wanted_control(site: SiteFile, sent: tuple[Sent, ...], facts: Mapping[str, str]) -> Wanted:
    """What the site expects of its control; ``sent`` are the programs that were sent there.

    ``facts`` are what its machine is known by; without them the serial number of the site file alone.
    """
    axes = tuple(
        WantedAxis(axis.name, axis.unit, axis.encoder, table_points(axis), encoder_said=axis.encoder_said)
        for axis in site.axes
        if getattr(axis, "table", None) is not None
    )
    serial = facts.get("serial", site.controller.serial)
    return Wanted(serial, axes, sent, access_level=site.controller.access_level, facts=facts)


def table_points(axis: AxisSection) -> int:
    """Interpolation points of the table of an axis of the site file."""
    return round((axis.table.maximum - axis.table.minimum) / axis.table.step) + 1


def sent_programs(site: SiteFile, path: Path) -> tuple[Sent, ...]:
    """Every program this store sent to the control; none while a gateway is at work with them."""
    book = SentProgramBook(store_of(site, path).root / JOURNALS, site.controller.serial)
    return () if book.at_work() else book.known()


def unfinished_pushes(site: SiteFile, path: Path) -> tuple[CheckLine, ...]:
    """A line for each push of this store that did not end and that nobody is at work with, the loud ones first."""
    held = held_pushes(store_of(site, path).root / JOURNALS)
    return tuple(wrong(one.code, "journal", **one.fields) for one in held)


def stored_self_tests(site: SiteFile, path: Path, seen: Sequence[CheckLine]) -> tuple[CheckLine, ...]:
    """The last self-test of each axis as this store knows it: that is what a push asks for.

    ``seen`` is what was found of the control just now: a test of another version of it does not count.
    """
    if f"{site.controller.driver}-paper" not in registry.known("paper"):
        return ()  # no programs of ours run on this road
    now = next((str(line.fields["version"]) for line in seen if line.code == "W-DOC-SERIAL"), "")
    known = SelfTestBook(store_of(site, path).root).all(site.controller.serial)
    last = {(one.axis, one.encoder): one for one in known}
    return tuple(self_test_line(axis.name, last.get((axis.name, axis.encoder)), now) for axis in site.axes)


def self_test_line(axis: str, test: Any, now: str) -> CheckLine:
    """A kept self-test (None: never made) as a line: passed, not passed, of another version."""
    if test is None:
        return unknown("W-DOC-UNTESTED", "self-test kept", axis=axis)
    fields = {"axis": axis, "date": test.utc, "version": test.machine.version}
    if now and test.machine.version != now:
        return wrong("E-DOC-TESTED-OTHER", "self-test kept", now=now, **fields)
    if test.ok:
        return fine("W-DOC-TESTED", "self-test kept", passed=len(test.passed), **fields)
    return wrong("E-DOC-TESTED", "self-test kept", missed=test.missed, **fields)


def report_font_line(language: str) -> tuple[CheckLine, ...]:
    """Which font of this computer writes Chinese in a report; a fault only where the site's reports need it."""
    try:
        from gateway.report.document.pdf import (  # noqa: PLC0415 - an extra that only paper needs
            CJK_FONTS,
            NEED_CJK,
            cjk_font,
        )
    except ModuleNotFoundError:
        return ()  # the extra that makes reports is not installed here
    found = cjk_font()
    if found:
        return (fine("W-DOC-FONT", "report font", font=found),)
    if language in NEED_CJK:
        return (wrong("E-DOC-FONT", "report font", language=language, fonts=", ".join(CJK_FONTS)),)
    return (fine("W-DOC-FONT-NONE", "report font"),)
