"""The commands on stored runs and the index: `runs` and `tables list`."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers import registry
from drivers.errors import ConfigError
from drivers.message import Message
from gateway.cli.next_steps import next_command, show_next
from gateway.cli.options import JsonOption, RunArgument, SiteArgument, StoreOption, load_site, open_run
from gateway.cli.output import count_words, echo, show_json, show_table


def list_runs_command(store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """List the runs of a store, oldest first."""
    from gateway.store import Store

    found = Store(store).runs()
    if as_json:
        show_json([asdict(one) for one in found])
        return
    if not found:
        echo(Message.of("S-RUNS-NONE", store=store))
        show_next("run SITE")
        return
    rows = [(one.run_id, one.machine, one.problem or one.state, str(len(one.stages))) for one in found]
    show_table(f"{count_words(len(rows), 'run', 'runs')} in {store}", ("run", "machine", "state", "records"), rows)
    echo(Message.of("S-RUNS-NAMED"))
    show_next(f"runs show latest --store {store}")


def show_run_command(run: RunArgument, store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Show a run: its machine, its state, what it holds and what ended it."""
    from gateway.store import Store

    folder = open_run(Store(store), run)
    summary = folder.summary()
    if as_json:
        show_json({**asdict(summary), "errors": folder.errors})
        return
    for name in ("run_id", "path", "site", "created_utc", "state", "machine", "software"):
        echo(f"{name.replace('_', ' '):12} {getattr(summary, name)}")
    echo(f"{'holds':12} {', '.join(summary.stages) or 'nothing yet'}")
    for error in folder.errors:
        echo(f"{'ended by':12} {error.get('code', '')}: {error.get('what', '')}")
    failed = folder.errors or summary.state == "failed" or not summary.stages
    show_next(next_command("failed", run=folder.path) if failed else f"report {folder.path}")


def latest_run_command(store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Show the latest run of a store."""
    show_run_command("latest", store, as_json)


def remove_run_command(
    run: RunArgument,
    store: StoreOption = Path("runs"),
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Remove a run's folder. What pushed a table stays: rollback, `tables verify` and the audit log rest on it."""
    from drivers.clock import LoopClock
    from gateway.cli.signals import run_to_end
    from gateway.store import Store
    from gateway.workflow.run.audit_trail import remove_run

    folder = open_run(Store(store), run)
    if not yes:
        typer.confirm(f"remove {folder.path} ({folder.state})?", abort=True, err=True)

    async def main() -> None:
        remove_run(folder, clock=LoopClock())

    run_to_end(main())
    echo(f"removed: {folder.run_id}")


# ---- logs

POLL_S = 0.5


def logs_command(
    run: Annotated[str, typer.Option(help="Only this run: id, unique prefix, or latest.")] = "",
    store: StoreOption = Path("runs"),
    last: Annotated[int, typer.Option(min=1, max=1_000_000, help="How many lines at most, the newest.")] = 200,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Follow new lines until Ctrl-C.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Print the full record of what happened: of one run, or as it happens; --json gives the lines as they are kept."""
    from drivers.errors import ConfigError
    from gateway.store import Store
    from gateway.store.log_book import LogBook, lines_of

    wanted = open_run(Store(store), run).run_id if run else ""
    lines = [line for line in lines_of(store) if wanted in ("", line.get("run"))]
    if not lines and not follow:
        raise ConfigError("E-LOG-NONE", str(store), store=str(store))
    for line in lines[-last:]:
        _print_log_line(line, as_json=as_json)
    if follow:
        _follow_log(LogBook.place(store), wanted, as_json=as_json)


def _follow_log(path: Path, run: str, *, as_json: bool) -> None:
    """Every whole line that is added, also after the log has turned over."""
    from drivers.clock import LoopClock
    from gateway.cli.signals import run_to_end
    from gateway.store.log_book import LogTail

    async def main() -> None:
        clock, tail = LoopClock(), LogTail(path)
        while True:
            for line in tail.new():
                if run in ("", line.get("run")):
                    _print_log_line(line, as_json=as_json)
            await clock.sleep(POLL_S)

    run_to_end(main())


def _print_log_line(line: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        echo(json.dumps(line))
        return
    utc, level, run, device = (str(line.get(key, "")) for key in ("utc", "level", "run", "device"))
    echo(f"{utc[:23]} {level:<7} {run[-4:]:<4} {device[:16]:<16} {line.get('code', '')}: {line.get('words', '')}")


# ---- replay: a recorded wire trace is played to its driver

SHOWN_EVENTS = 20

TraceArgument = Annotated[Path, typer.Argument(help="NAME.trace from a run's traces folder.", show_default=False)]
DriverOption = Annotated[str, typer.Option(help="Driver to replay to; default: the recorded one.", show_default=False)]
SettingOption = Annotated[
    list[str] | None, typer.Option("--set", help="KEY=VALUE of the driver, over the recorded ones.", show_default=False)
]
SessionOption = Annotated[int, typer.Option(min=1, help="Number of the session in the trace.")]
CsvOption = Annotated[Path | None, typer.Option("--csv", help="Also write every sample here.", show_default=False)]


def replay_command(
    trace: TraceArgument,
    driver: DriverOption = "",
    settings: SettingOption = None,
    session: SessionOption = 1,
    samples: CsvOption = None,
    as_json: JsonOption = False,
) -> None:
    """Play a wire trace to its driver in virtual time and print samples, gaps and events."""
    player = registry.load("replay", "replay")(trace)
    name = driver or player.driver
    if not name:
        raise ConfigError("E-REPLAY-DRIVER", str(trace))
    wanted = {**(player.settings if name == player.driver else {}), **_parse_settings(settings or [])}
    factory = registry.load(name, "instrument")
    if samples is None:
        found = player.play(factory, wanted, session)
    else:
        try:
            with samples.open("w", newline="", encoding="ascii") as file:
                found = player.play(factory, wanted, session, _SampleSheet(file).take)
        except OSError as error:
            raise ConfigError("E-CLI-WRITE", str(samples), why=str(error)) from error
    if as_json:
        show_json(_replay_record(found))
    else:
        _show_replay(found)


class _SampleSheet:
    """Samples as CSV lines, as they come."""

    def __init__(self, file: Any) -> None:
        self._lines = csv.writer(file)
        self._begun = False

    def take(self, block: Any) -> None:
        """A block's lines."""
        if not self._begun:
            self._lines.writerow(("time_s", *block.channels, "valid"))
            self._begun = True
        for at_s, values, valid in zip(block.time_s, block.values, block.valid, strict=True):
            self._lines.writerow((repr(float(at_s)), *(repr(float(value)) for value in values), int(valid)))


def _parse_settings(words: list[str]) -> dict[str, Any]:
    """KEY=VALUE words; whole numbers and decimals become numbers. Raises ConfigError (E-CLI-POSITION)."""
    found: dict[str, Any] = {}
    for word in words:
        key, mark, text = word.partition("=")
        if not mark:
            raise ConfigError("E-CLI-POSITION", "--set", text=word)
        found[key] = _parse_value(text)
    return found


def _parse_value(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _replay_record(found: Any) -> dict[str, Any]:
    names = ("session", "sessions", "channels", "samples", "lost", "invalid", "gaps", "events", "event_count")
    record = {name: getattr(found, name) for name in names}
    record |= {
        "first_s": found.span_s[0] if found.samples else None,
        "last_s": found.span_s[1] if found.samples else None,
    }
    record |= {"lowest": found.lowest, "highest": found.highest}
    record["serial"] = found.identity.serial if found.identity else None
    record["ended"] = found.ended.as_record() if found.ended else None
    return record


def _show_replay(found: Any) -> None:
    who = found.identity
    echo(f"session {found.session} of {found.sessions}: {who.model if who else 'not opened'}")
    echo(f"{found.samples} samples, {found.lost} lost in {found.gaps} gaps, {found.invalid} invalid")
    if found.samples:
        echo(Message.of("S-RUNS-SPAN", begin=found.span_s[0], end=found.span_s[1]))
        for name, low, high in zip(found.channels, found.lowest, found.highest, strict=True):
            echo(f"{name}: {low:.9g} .. {high:.9g}")
    for event in found.events[:SHOWN_EVENTS]:
        echo(Message.of("S-RUNS-EVENT", event=event))
    if found.event_count > SHOWN_EVENTS:
        echo(Message.of("S-RUNS-MORE", count=found.event_count - SHOWN_EVENTS))
    if found.ended is not None:
        echo(f"ended: {found.ended}")


# ---- the index


def reindex_command(site: SiteArgument, as_json: JsonOption = False) -> None:
    """Make the index of a site's runs anew; the run folders are the truth and are only read."""
    from gateway.index import SiteIndex
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    store = store_of(tree, site)
    count = SiteIndex(tree, site, store).rebuilt()
    if as_json:
        show_json({"runs": count})
        return
    echo(f"{store.root}: {count_words(count, 'run', 'runs')}")


def compare_command(
    site: SiteArgument,
    parameter: Annotated[str, typer.Argument(help="E, R, B, A or M of an axis, rms of the flank.")],
    subject: Annotated[str, typer.Option("--axis", help="The axis; flank for the tooth.")],
    before: Annotated[bool, typer.Option("--before", help="As found instead of as left.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare one error across the machines that the site's index knows: the newest figure of each, largest first."""
    from drivers.terms import shown
    from gateway.index import SiteIndex
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    index = SiteIndex(tree, site, store_of(tree, site))
    found = index.compared(parameter, subject=subject, phase="before" if before else "after")
    if as_json:
        show_json({"machines": found})
        return
    for one in found:
        sure = "" if one["expanded"] is None else f" +- {one['expanded']:.3g}"
        figure = f"{one['value']:.3g}{sure} {shown(one['unit'])}"
        echo(f"{one['serial']:<20} {one['site']:<20} {figure:<22} {one['phase']:<7} {one['created_utc'][:10]}")
    if not found:
        echo(Message.of("S-RUNS-NO-FIGURE", parameter=parameter, subject=subject))


def tables_command(
    site: SiteArgument,
    serial: Annotated[str, typer.Option("--machine", help="One machine only, by its serial number.")] = "",
    as_json: JsonOption = False,
) -> None:
    """List the tables that should act in every machine of the index, by what was pushed: id and date of each."""
    from gateway.index import SiteIndex
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    found = SiteIndex(tree, site, store_of(tree, site)).tables(serial=serial)
    if as_json:
        show_json({"tables": found})
        return
    for one in found:
        told = f"{one['serial']:<20} {one['site']:<20} "
        if one["problem"]:
            echo(told + one["problem"])
            continue
        switch = "on" if one["enabled"] else "off"
        echo(told + f"{one['name']:<12} {one['table_id']:<13} {one['utc'][:16].replace('T', ' ')} UTC  {switch}")
    if not found:
        echo(Message.of("S-RUNS-NO-TABLE", serial=serial) if serial else Message.of("S-RUNS-NO-TABLES"))
    else:
        show_next(f"tables verify {site}")
