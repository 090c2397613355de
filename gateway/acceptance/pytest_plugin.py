"""`pytest --trueflank-site SITE --allow LEVEL`: the shipped acceptance as tests, with JUnit and a sheet.

Without tests named on the command line the shipped suite is run. Tests of your own say what they need by
`@pytest.mark.trueflank_allow("motion")`; what lies above the allowance is skipped and said.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.probes import LEVELS, allows

SUITE = Path(__file__).with_name("suite.py")
MARK = "trueflank_allow"
RESULTS: pytest.StashKey[list[Any]] = pytest.StashKey()
SITE: pytest.StashKey[Any] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of an acceptance."""
    group = parser.getgroup("trueflank")
    group.addoption("--trueflank-site", default="", metavar="SITE", help="accept this site (its TOML file)")
    group.addoption("--allow", default="read", choices=LEVELS, help="what an acceptance may do (default: read)")
    group.addoption("--trueflank-machine", default="", metavar="NAME", help="the machine's name, for --allow write")
    group.addoption(
        "--trueflank-sheet",
        default="acceptance.html",
        metavar="FILE",
        help="the sheet to sign, .html or .pdf (default: %(default)s)",
    )
    group.addoption("--trueflank-language", default="", metavar="en|de|zh", help="of the sheet (default: the site's)")


def pytest_configure(config: pytest.Config) -> None:
    """Load the site, check the consent, and choose the shipped suite where no test is named."""
    config.addinivalue_line("markers", f"{MARK}(allowance): what a test of yours needs: read, program, motion or write")
    config.stash[RESULTS] = []
    given = config.getoption("--trueflank-site")
    if not given:
        return
    # Two processes would be at one machine, and no one of them has all results for the sheet.
    if hasattr(config, "workerinput") or getattr(config.option, "dist", "no") != "no":
        raise pytest.UsageError("an acceptance is one process at one machine: give -n 0, without --dist")
    from drivers.errors import TrueflankError  # noqa: PLC0415 - pytest loads this file on every run
    from gateway.acceptance.sheet import check_sheet  # noqa: PLC0415
    from gateway.config import load_site  # noqa: PLC0415
    from gateway.workflow.run.context import check_name  # noqa: PLC0415

    path = Path(given).resolve()
    try:
        site = load_site(path)
        allow, name = config.getoption("--allow"), config.getoption("--trueflank-machine")
        check_name(site, allow == "write", name, code="E-PYTEST-NAME", option="--trueflank-machine")
        check_sheet(Path(config.getoption("--trueflank-sheet")), config.getoption("--trueflank-language"))
    except TrueflankError as error:
        raise pytest.UsageError(str(error)) from error
    config.stash[SITE] = (site, path)
    if config.args_source is not pytest.Config.ArgsSource.ARGS:
        config.args = [str(SUITE)]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what lies above the allowance."""
    mark = item.get_closest_marker(MARK)
    needed = mark.args[0] if mark is not None and mark.args else "read"
    if needed not in LEVELS:
        raise pytest.UsageError(f"{MARK} takes one of {', '.join(LEVELS)}, not {needed!r}")
    given = item.config.getoption("--allow")
    if mark is not None and not allows(given, needed):
        pytest.skip(f"needs --allow {needed}; this run has --allow {given}")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each check and axis of the site."""
    if "trueflank_case" not in metafunc.fixturenames:
        return
    from gateway.acceptance.checks import cases  # noqa: PLC0415

    site, _ = metafunc.config.stash.get(SITE, (None, None))
    found = list(cases(site)) if site is not None else []
    metafunc.parametrize("trueflank_case", found, ids=[f"{check.name}-{axis}".rstrip("-") for check, axis in found])


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Write the sheet and say where it is."""
    results = config.stash[RESULTS]
    if not results:
        return
    from drivers.clock import LoopClock  # noqa: PLC0415
    from gateway.acceptance.sheet import Occasion, write_sheet  # noqa: PLC0415

    path, (site, site_path) = Path(config.getoption("--trueflank-sheet")), config.stash[SITE]
    allow, language = config.getoption("--allow"), config.getoption("--trueflank-language")
    write_sheet(path, results, Occasion(site, site_path, allow, LoopClock().utc(), language=language))
    terminalreporter.write_line(f"the sheet to sign: {path}")


@pytest.fixture
def trueflank_site(request: pytest.FixtureRequest) -> Any:
    """The site file of --trueflank-site, read; a test that needs it is skipped without."""
    if SITE not in request.config.stash:
        pytest.skip("say --trueflank-site SITE")
    return request.config.stash[SITE][0]


@pytest.fixture
def trueflank_desk(request: pytest.FixtureRequest) -> Any:
    """The site with a clock: `async with trueflank_desk.bench() as at` opens its control."""
    if SITE not in request.config.stash:
        pytest.skip("say --trueflank-site SITE")
    from drivers.clock import LoopClock  # noqa: PLC0415
    from gateway.acceptance.checks import SiteDesk  # noqa: PLC0415
    from gateway.say import silence  # noqa: PLC0415

    site, path = request.config.stash[SITE]
    return SiteDesk(site, path, LoopClock(), silence)
