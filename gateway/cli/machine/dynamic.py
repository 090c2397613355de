"""The command `dynamic`: capture a stream fast, or open one that was captured; vibrations, settling, picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError
from drivers.message import Message
from gateway.cli.options import JsonOption, StoreOption
from gateway.cli.screen.telling import progress
from gateway.cli.show import echo, show_json, show_table
from gateway.cli.stopping import run_to_end

KINDS = ("none", "value", "level", "external")


def dynamic_command(
    source: Annotated[
        Path, typer.Argument(metavar="SITE|FILE", help="Site file, .rtx, or a run's .f64.", show_default=False)
    ],
    instrument: Annotated[str, typer.Option(help="Instrument of the site.")] = "",
    seconds: Annotated[float, typer.Option(min=0.001, help="Duration after the trigger.")] = 20.0,
    trigger: Annotated[str, typer.Option(help="none, value=UM moved, level=UM crossed, external.")] = "none",
    pre: Annotated[float, typer.Option(min=0.0, help="Seconds kept from before the trigger.")] = 0.1,
    wait: Annotated[float, typer.Option(min=0.0, help="Seconds to wait for the trigger.")] = 60.0,
    axis: Annotated[str, typer.Option(help="Axis under observation, for the record.")] = "",
    channel: Annotated[str, typer.Option(help="Channel of the instrument (default: its first).")] = "",
    unit: Annotated[str, typer.Option(help="Unit of an .rtx's samples: mm, um, mrad, urad, arcsec or deg.")] = "",
    band: Annotated[
        float | None, typer.Option(min=1e-6, help="Settling band, um or arcsec.", show_default=False)
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="PNG to write for a file.", show_default=False)] = None,
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Record an instrument's stream to disk, or open a dynamic file, and show vibrations and settling."""
    if source.suffix.lower() == ".toml":
        from gateway.workflow.axes.dynamic import RecordingOptions

        start = trigger_of(trigger, pre)
        wish = RecordingOptions(instrument, seconds, trigger=start, axis=axis, channel=channel, wait_s=wait, band=band)
        outcome = _captured(source, wish, as_json=as_json)
    else:
        outcome = _opened(source, unit, plot, band, store)
    if as_json:
        show_json(outcome.as_data())
    else:
        tell(outcome.as_data())


def trigger_of(text: str, pre_s: float) -> Any:
    """A trigger from "value=0.5". Raises ConfigError (E-CLI-TRIGGER)."""
    from gateway.capture.dynamic import Trigger

    kind, mark, number = text.strip().partition("=")
    try:
        at = float(number) if mark else 0.0
    except ValueError:
        at = math.nan
    needs = kind in ("value", "level")
    if kind not in KINDS or needs != bool(mark) or not math.isfinite(at) or (kind == "value" and at <= 0.0):
        raise ConfigError("E-CLI-TRIGGER", "--trigger", text=text)
    return Trigger(kind, at, pre_s)  # type: ignore[arg-type]


def _captured(site: Path, wish: Any, *, as_json: bool) -> Any:
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.axes.dynamic import capture_dynamic

    tree = load_site(site)
    with progress(quiet=as_json, at=(tree, site)) as say:
        return run_to_end(capture_dynamic(tree, site, wish, clock=LoopClock(), say=say), at=site)


def _opened(path: Path, unit: str, plot: Path | None, band: float | None, store: Path) -> Any:
    from drivers.recordings import Recording
    from gateway.store import Maps
    from gateway.store.raw_stream import open_stream
    from gateway.workflow.axes.dynamic import outcome_of
    from gateway.workflow.files.reading import ReadOptions, read_file

    notes: tuple[Message, ...] = ()
    if path.suffix == ".f64":
        recording: Any = open_stream(path)
    else:
        read = read_file(path, ReadOptions(unit), Maps(store))
        recording, notes = read.content, read.notes
    if not isinstance(recording, Recording):
        raise ConfigError("E-CLI-NOT-DYNAMIC", str(path))
    return outcome_of(recording, path, plot or _free(path), band=band, notes=notes)


def _free(path: Path) -> Path:
    """NAME.png beside the working folder, numbered where it exists: a picture never replaces another."""
    number, found = 2, Path(f"{path.stem}.png")
    while found.exists():
        found, number = Path(f"{path.stem}-{number}.png"), number + 1
    return found


def tell(data: dict[str, Any]) -> None:
    """A record's results in words."""
    unit = data["unit"]
    head = f"{data['place']}: {data['samples']} samples at {data['rate_hz']:g} Hz, {data['duration_s']:.4g} s"
    echo(f"{head}, gaps: {data['gaps']}, samples lost in them: {data['lost']}")
    if "spectrum" in data:
        made = data["spectrum"]
        rows = [(f"{peak['frequency_hz']:.2f}", f"{peak['amplitude']:.4g}") for peak in made["peaks"]]
        title = f"vibrations ({made['averages']} averages, rms {made['rms']:.4g} {unit})"
        show_table(title, ("frequency Hz", f"amplitude {unit}"), rows)
    found = data["settling"]
    if found is None:
        echo(f"settling: not shown; {data['settling_missing']}")
    else:
        time = "never" if found["time_s"] is None else f"after {1000.0 * found['time_s']:.2f} ms"
        echo(f"settling: step {found['step']:.4g} {unit}, within {found['band']:g} {unit} {time}")
        echo(f"  overshoot {found['overshoot']:.4g} {unit}")
        if found["ringing"]:
            ringing = found["ringing"]
            echo(f"  ringing {ringing['frequency_hz']:.4g} Hz, {ringing['amplitude']:.4g} {unit}")
    echo(f"picture: {data['picture']}")
    for note in data["notes"]:
        echo(f"  note: {note}")
