"""A control's recorded answers beside its double's: every difference is a line, a failing test and a row of a page.

Called by `doctor compare` and by the tests it writes. Asks through the site's driver alone; knows no simulator. What
stays of a comparison are the session, a test that fails while the double differs, and rows of `docs/controls.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.message import Message
from drivers.probes import Disagreement, Level, ProbedSession, Prober
from gateway.config import SiteFile
from gateway.say import Say

START_S = 900.0
SESSION, SUITE, ROWS = "session.json", "test_double.py", "rows.md"


def prober_of(site: SiteFile, clock: Clock) -> Prober:
    """Who asks this site's control. Raises ConfigError (E-CONFORM-DRIVER)."""
    control = site.controller
    name = f"{control.driver}-prober"
    if name not in registry.known("prober"):
        raise ConfigError("E-CONFORM-DRIVER", site.site.name, driver=control.driver)
    made: Any = registry.load(name, "prober")(site.site.name, control.url, dict(control.settings), clock)
    prober: Prober = made
    return prober


async def recorded(site: SiteFile, allow: Level, clock: Clock, say: Say) -> ProbedSession:
    """Ask a control everything within the allowance; raises what the wire raises, and where nobody starts a program."""
    prober = prober_of(site, clock)
    probes = prober.probes(allow)
    programs = sum(probe.act == "program" for probe in probes)
    say("P-CONFORM-ASK", who=site.site.name, count=len(probes), programs=programs)
    session = await prober.ask(probes, say, site.controller.timeout_s, START_S)
    return replace(session, about={**session.about, "allow": allow, "date": clock.utc().date().isoformat()})


async def replayed(site: SiteFile, session: ProbedSession, clock: Clock, say: Say) -> ProbedSession:
    """Ask the double at ``site`` what the control was asked and answered; what it was not asked is left out."""
    probes = tuple(answer.probe for answer in session.answers if answer.asked)
    say("P-CONFORM-ASK", who="the double", count=len(probes), programs=sum(one.act == "program" for one in probes))
    return await prober_of(site, clock).ask(probes, say, site.controller.timeout_s, START_S)


_SUITE = '''"""What a control said and its double does not say yet: each fails until the double is as the control.

Recorded at a control of version {version}, {date}. Needs pytest and the extra "sim".
"""

from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.probes import read_session
from gateway.config import load_site
from gateway.acceptance.comparison import replayed
from gateway.say import silence

SESSION = read_session(Path(__file__).with_name("{session}"))
DIFFERENT = {names}


@pytest.fixture(scope="module")
def double(tmp_path_factory):
    from simulators.pytest_plugin import CellStarter

    async def main(cell):
        cell.nck.set_access_level(int(SESSION.about.get("access_level", "2")))
        return await replayed(load_site(cell.site_path), SESSION, LoopClock(), silence)

    return CellStarter(tmp_path_factory.mktemp("double")).in_memory(main, {cell!r})


@pytest.mark.parametrize("name", DIFFERENT)
def test_the_double_says_what_the_control_said(double, name):
    assert double.said(name) == SESSION.said(name)
'''


def suite_text(session: ProbedSession, found: Sequence[Disagreement], cell: str) -> str:
    """A test module, one case for each difference."""
    names = "[\n" + "".join(f"    {one.probe.name!r},\n" for one in found) + "]"
    about = session.about
    version, date = about.get("version", "unknown"), about.get("date", Message.of("W-CONFORM-NO-DAY"))
    return _SUITE.format(version=version, date=date, session=SESSION, names=names, cell=cell)


def rows_text(session: ProbedSession, found: Sequence[Disagreement]) -> str:
    """Rows for the table of `docs/controls.md`: what, this control, the double."""
    version = session.about.get("version", "unknown")
    head = f"| what was asked | control {version}, **seen** | simulated control |\n|---|---|---|\n"
    return head + "".join(
        f"| {_cell(one.probe.what)} | {_cell(one.control)} | {_cell(one.double)} |\n" for one in found
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def written(folder: Path, session: ProbedSession, found: Sequence[Disagreement], cell: str) -> tuple[Path, ...]:
    """The files of a comparison; test and rows only where something differs. Raises ConfigError (E-CLI-WRITE)."""
    texts = {SESSION: session.as_text()}
    if found:
        texts |= {SUITE: suite_text(session, found, cell), ROWS: rows_text(session, found)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (SUITE, ROWS):
            (folder / name).unlink(missing_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(folder), why=str(error)) from error
    return tuple(folder / name for name in texts)
