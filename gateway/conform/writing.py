"""What stays of a comparison: the session, a test that fails while the double differs, rows of `docs/controls.md`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from drivers.errors import ConfigError
from drivers.probes import Disagreement, ProbedSession

SESSION, SUITE, ROWS = "session.json", "test_double.py", "rows.md"

_SUITE = '''"""What a control said and its double does not say yet: each fails until the double is as the control.

Recorded at a control of version {version}, {date}. Needs pytest and the extra "sim".
"""

from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.probes import read_session
from gateway.config import load_site
from gateway.conform import replayed
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
    version, date = about.get("version", "unknown"), about.get("date", "on an unknown day")
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
