"""The command `replay`: a recorded wire is played to its driver at a desk, to see what it made of every byte."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers import registry
from drivers.errors import ConfigError
from gateway.cli.options import JsonOption
from gateway.cli.show import echo, show_json

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
    wanted = {**(player.settings if name == player.driver else {}), **_typed(settings or [])}
    factory = registry.load(name, "instrument")
    if samples is None:
        found = player.play(factory, wanted, session)
    else:
        try:
            with samples.open("w", newline="", encoding="ascii") as file:
                found = player.play(factory, wanted, session, _Sheet(file).take)
        except OSError as error:
            raise ConfigError("E-CLI-WRITE", str(samples), why=str(error)) from error
    if as_json:
        show_json(_record(found))
    else:
        _tell(found)


class _Sheet:
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


def _typed(words: list[str]) -> dict[str, Any]:
    """KEY=VALUE words; whole numbers and decimals become numbers. Raises ConfigError (E-CLI-POSITION)."""
    found: dict[str, Any] = {}
    for word in words:
        key, mark, text = word.partition("=")
        if not mark:
            raise ConfigError("E-CLI-POSITION", "--set", text=word)
        found[key] = _value(text)
    return found


def _value(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _record(found: Any) -> dict[str, Any]:
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


def _tell(found: Any) -> None:
    who = found.identity
    echo(f"session {found.session} of {found.sessions}: {who.model if who else 'not opened'}")
    echo(f"{found.samples} samples, {found.lost} lost in {found.gaps} gaps, {found.invalid} invalid")
    if found.samples:
        echo(f"from {found.span_s[0]:.6f} s to {found.span_s[1]:.6f} s of the instrument")
        for name, low, high in zip(found.channels, found.lowest, found.highest, strict=True):
            echo(f"{name}: {low:.9g} .. {high:.9g}")
    for event in found.events[:SHOWN_EVENTS]:
        echo(f"event: {event}")
    if found.event_count > SHOWN_EVENTS:
        echo(f"... and {found.event_count - SHOWN_EVENTS} more events")
    if found.ended is not None:
        echo(f"ended: {found.ended}")
