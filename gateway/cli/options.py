"""Arguments and options that several commands share, and what may be a name in one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError, TrueflankError, words
from drivers.local.names import allowed, is_name, shown
from drivers.local.textfile import read_toml
from drivers.message import Message

SiteArgument = Annotated[Path, typer.Argument(help="Site file (TOML).", show_default=False)]
RunArgument = Annotated[
    str,
    typer.Argument(
        help="Run folder or id (a unique prefix is enough), or latest: the newest run with the required data.",
        show_default=False,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
ApplyOption = Annotated[bool, typer.Option("--apply", help="Write to the controller (else: propose only).")]
MachineOption = Annotated[str, typer.Option(help="The machine's name, typed to confirm --apply.")]
RiskOption = Annotated[
    str, typer.Option(help="Type unprotected to push alone on an unprotected connection.", show_default=False)
]
AxesOption = Annotated[
    list[str] | None, typer.Option("--axis", help="Only this machine axis; may be repeated.", show_default=False)
]
PlanOption = Annotated[
    bool,
    typer.Option("--plan", help="Forecast the day: mountings, key presses, restarts, hours; opens no device."),
]
TablesOption = Annotated[
    list[str] | None,
    typer.Option("--axis", help="Only this axis or table, as the proposal names it; may be repeated."),
]
PointsOption = Annotated[bool, typer.Option("--points", help="Show every interpolation point.")]
SpeedOption = Annotated[
    float, typer.Option(min=1, max=500, help="Machine seconds per real second; deadlines use real seconds.")
]
SiteOption = Annotated[
    Path | None, typer.Option(help="Site file to compare the files' statements with.", show_default=False)
]
StatementOption = Annotated[
    list[str] | None,
    typer.Option(
        help="KEY=VALUE: accept a differing statement of a file. May be repeated.",
        show_default=False,
    ),
]
AskOption = Annotated[bool, typer.Option("--ask/--no-ask", help="Ask about differing statements of files, or refuse.")]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        help="Missing facts of a table, NAME=VALUE: target=1, measured=2, reading_unit=mm, sheet=X; may be repeated.",
        show_default=False,
    ),
]
CONNECTIONS = ("", "opcua", "modbus", "both")
TakeOption = Annotated[
    str, typer.Option(help="Reason for taking the devices from a service that does not respond.", show_default=False)
]
AcceptOption = Annotated[
    list[str] | None,
    typer.Option(
        "--accept-doubt",
        help="CODE=REASON: accept a doubt about the readings; may be repeated.",
        show_default=False,
    ),
]
USUAL_STORE = Path("runs")
MOST_SITES = 50


def resolve_store(context: typer.Context, given: Path) -> Path:
    """The store that is meant: the one that was typed, else that of the site file that the command was given.

    Without a site file: `runs` here, else that of the one site file here or a folder below. With none or several of
    them it stays `runs`: no command takes another machine's run for the latest.
    """
    source = context.get_parameter_source("store")
    if source is not None and source.name != "DEFAULT":
        return given
    named = (str(context.params.get(name) or "") for name in ("site", "place"))
    site = next((Path(one) for one in named if one.endswith(".toml")), None)
    if site is not None:
        return store_of_site_file(site) or given
    if given.exists():
        return given
    sites = [one for form in ("*.toml", "*/*.toml") for one in islice(Path().glob(form), MOST_SITES)]
    found = {store for site in sites if (store := store_of_site_file(site)) is not None}
    return found.pop() if len(found) == 1 else given


def store_of_site_file(site: Path) -> Path | None:
    """Where a site file keeps its runs; None for a file that is no site file."""
    try:
        named = read_toml(site)["site"].get("store", str(USUAL_STORE))
        return site.parent / named
    except (OSError, ValueError, KeyError, TypeError, AttributeError, TrueflankError):
        return None


def open_run(store: Any, run: str, needs: str = "anything", axis: str = "") -> Any:
    """The run folder that a command was given, by what it needs (`NEEDS`) of an axis; which one `latest` is, is said.

    Raises as `gateway.store.Store.open`.
    """
    from gateway.cli.output import echo
    from gateway.store import ANYTHING, LATEST, Needs

    code, stages, always, made = RUN_NEEDS[needs]
    wanted = Needs(code, tuple(one.format(axis=axis) for one in stages), made)
    folder = store.open(run, wanted if always or run == LATEST else replace(ANYTHING, made=made))
    if run == LATEST:
        echo(Message.of("S-RUN-LATEST", run=folder.run_id, needs=words(code)), err=True)
    return folder


def run_or_file(store: Path, word: Path | str) -> Path:
    """The word as it is, but `latest` as the newest run with something measured: a file of that name comes first."""
    from gateway.store import LATEST, Store

    if str(word) != LATEST or Path(word).exists():
        return Path(word)
    return Path(open_run(Store(store), LATEST, "measured").path)


_BY_RUN, _BY_MEASURE, _BY_INSPECT = "W-MADE-BY-RUN", "W-MADE-BY-MEASURE", "W-MADE-BY-INSPECT"
RUN_NEEDS: Mapping[str, tuple[str, tuple[str, ...], bool, str]] = {
    "anything": ("W-NEEDS-ANYTHING", (), False, _BY_RUN),
    "proposal": ("W-NEEDS-PROPOSAL", ("proposal",), True, _BY_RUN),
    "errors": ("W-NEEDS-ERRORS", ("errors",), True, _BY_MEASURE),
    "part": ("W-NEEDS-PART", ("inspected-",), False, _BY_INSPECT),
    "curve": ("W-NEEDS-CURVE", ("evaluation-{axis}", "setup-"), False, _BY_RUN),
    "setups": ("W-NEEDS-SETUPS", ("setup-",), False, _BY_MEASURE),
    "measured": ("W-NEEDS-MEASURED", ("capture-", "measured", "gear-inspection", "setup-"), False, _BY_RUN),
    "report": ("W-NEEDS-REPORT", ("evaluation-", "measured", "errors", "tooth", "inspected-"), False, _BY_RUN),
}
"""What a command needs of a run: the catalogue's word for it, how the names of such stages begin, whether a run that
was named without it is a wrong option, too, and the catalogue's word for the command that makes it."""


StoreOption = Annotated[Path, typer.Option(help="Folder that holds the runs.", callback=resolve_store)]


def parse_name(text: str) -> str:
    """An option that becomes a part of a file's name. Raises ConfigError (E-NAME)."""
    if text and not is_name(text):
        raise ConfigError("E-NAME", "command line", name=shown(text), allowed=allowed())
    return text


PartOption = Annotated[str, typer.Option(help="Name of the part in its run.", callback=parse_name)]


def parse_connection(text: str) -> str:
    """A way into a simulated control. Raises typer.BadParameter."""
    if text not in CONNECTIONS:
        raise typer.BadParameter(f"{text!r} is none of {', '.join(CONNECTIONS[1:])}")
    return text


def accepted_doubts(texts: list[str] | None) -> dict[str, str]:
    """Reasons by code of --accept-doubt. Raises ConfigError (E-DOUBT-ACCEPT)."""
    from gateway.evaluate.behaviour.doubts import accepted_of

    return accepted_of(texts or (), "--accept-doubt")


def require_control(tree: Any) -> None:
    """A site that names a control. Raises ConfigError (E-FILES-ONLY)."""
    from gateway.config import files_only

    if files_only(tree):
        raise ConfigError("E-FILES-ONLY", tree.site.name)


def load_site(path: Path) -> Any:
    """The site file of a command; what reads it is loaded now, so that --help is quick. Raises ConfigError."""
    from gateway.config import load_site as load

    return load(path)


def statement_comparison(site: Path | None, accepted: list[str] | None, *, ask: bool, tree: Any = None) -> Any:
    """With what files' statements are compared: a site, what was accepted, and whether a person is asked."""
    from gateway.workflow.files.statements import StatementComparison

    known = load_site(site) if tree is None and site is not None else tree
    return StatementComparison(known, tuple(accepted or ()), _ask_about if ask else None, _utc_now)


@dataclass(frozen=True, slots=True)
class DateComparison:
    """One file without a site: its day is compared with today, and the rest with nothing; loaded where it differs."""

    accepted: tuple[str, ...]
    ask: bool

    def compared(self, header: Mapping[str, str]) -> Any:
        """With what its statements are compared, None where its day is not still to come."""
        from gateway.workflow.files.headers import date_in, is_future

        return (
            statement_comparison(None, list(self.accepted), ask=self.ask)
            if is_future(date_in(header), _utc_now().date())
            else None
        )


def _utc_now() -> datetime:
    return datetime.now(UTC)  # by name, so that another process can be given it


def _ask_about(one: Any) -> bool:
    """Show one difference; yes takes the file. Without anybody at the terminal it is refused (E-FACTS-DIFFER)."""
    from drivers.local.names import visible
    from gateway.cli.output import echo
    from gateway.workflow.files.statements import refusal

    echo(Message.of("P-FACTS-DIFFER", **difference_fields(one)))
    try:
        return typer.confirm(f"  {visible(words('P-FACTS-DIFFER', 'do', **difference_fields(one)))}", default=None)
    except typer.Abort as error:
        raise refusal([one]) from error


def difference_fields(one: Any) -> dict[str, str]:
    """The fields of P-FACTS-DIFFER for a difference."""
    from gateway.workflow.files.statements import SITE

    found = {name: shown(getattr(one, name)) for name in ("file", "key", "value", "other", "source")}
    return {**found, "source": words("W-FACTS-SITE")} if one.source == SITE else found


def accepted_words(one: Any) -> str:
    """An accepted difference in words."""
    return words("W-FACTS-ACCEPTED", **difference_fields(one))
