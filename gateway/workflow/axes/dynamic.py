"""A dynamic capture of one instrument into a run of its own, and what it shows: vibrations and settling."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from drivers import registry
from drivers.clock import Clock
from drivers.errors import ConfigError, LimitPassed, TrueflankError, UnsupportedDevice
from drivers.local.ownfiles import open_own
from drivers.message import Message, digits, fixed
from drivers.ports.instruments import Instrument
from drivers.recordings import Recording
from gateway.broker import borrow_devices
from gateway.capture.dynamic import CaptureEnd, DynamicCapture, LiveView, Sink, StreamShape, Trigger, unit_of
from gateway.config import InstrumentSection, SiteFile
from gateway.errors import CaptureError, NotIdentifiable
from gateway.evaluate.behaviour.dynamics import DynamicSpectrum, SettlingResult, amplitude_spectrum, evaluate_settling
from gateway.events import RunStarted
from gateway.say import Say
from gateway.store import RunFolder
from gateway.store.raw_stream import RawRecorder, StreamFacts, open_stream
from gateway.workflow.run.folder import new_run, store_of

PICTURE, STATE = "dynamic.png", "captured"
# Settling looks at the whole record at once; a longer one is cut by its trigger or recorded shorter.
MOST_FOR_SETTLING = 20_000_000
DEFAULT_BAND = {"um": 1.0, "arcsec": 1.0}
ENDED = {"beam": "S-DYN-WHY-BEAM", "stream": "S-DYN-WHY-STREAM"}
"""Why a capture ended early, as people read it."""


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """What to capture: an instrument of the site, how long, from which trigger, of which axis (for the record)."""

    instrument: str
    seconds: float
    trigger: Trigger = field(default_factory=Trigger)
    axis: str = ""
    channel: str = ""
    wait_s: float = 60.0
    band: float | None = None


@dataclass(frozen=True, slots=True)
class RecordingFindings:
    """What a record shows. ``settling`` None with ``why_not`` where it shows no move."""

    spectrum: DynamicSpectrum | None
    settling: SettlingResult | None
    why_not: str = ""


@dataclass(frozen=True, slots=True)
class DynamicOutcome:
    """A record, what it shows, where it is kept and drawn; ``notes`` what must be known of it."""

    recording: Recording
    shown: RecordingFindings
    place: Path
    picture: Path
    notes: tuple[Message, ...] = ()

    def as_data(self) -> dict[str, Any]:
        """For --json and the run folder: everything but the samples and the spectrum's lines."""
        made, found = self.shown.spectrum, self.shown.settling
        record = self.recording
        data: dict[str, Any] = {"place": str(self.place), "picture": str(self.picture), "samples": len(record)}
        data |= {"rate_hz": record.rate_hz, "duration_s": record.duration_s, "unit": record.unit}
        data |= {"trigger": record.trigger, "gaps": len(record.gaps), "lost": sum(gap.lost for gap in record.gaps)}
        if made is not None:
            data["spectrum"] = {"rms": made.rms, "averages": made.averages, "peaks": [asdict(p) for p in made.peaks]}
        data["settling"] = asdict(found) if found is not None else None
        return data | {
            "settling_missing": self.shown.why_not,
            "notes": [*map(str, self.notes), *map(str, record.warnings)],
        }


def evaluate_recording(recording: Recording, band: float | None = None) -> RecordingFindings:
    """Spectrum and settling of a record; what it does not show is said in words."""
    try:
        made: DynamicSpectrum | None = amplitude_spectrum(recording)
    except NotIdentifiable:
        made = None
    try:
        if len(recording) > MOST_FOR_SETTLING:
            raise NotIdentifiable("E-DYN-LONG", "settling", samples=len(recording), limit=MOST_FOR_SETTLING)
        return RecordingFindings(made, evaluate_settling(recording, band or DEFAULT_BAND[recording.unit]))
    except NotIdentifiable as error:
        return RecordingFindings(made, None, error.what)


def outcome_of(
    recording: Recording, place: Path, picture: Path, band: float | None, notes: tuple[Message, ...] = ()
) -> Any:
    """Evaluate and draw a record. Raises ConfigError (E-CLI-EXISTS, E-CLI-WRITE) for the picture."""
    shown = evaluate_recording(recording, band)
    try:
        draw_recording(recording, shown.spectrum, picture)
    except FileExistsError as error:
        raise ConfigError("E-CLI-EXISTS", str(picture)) from error
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(picture), why=error.strerror or str(error)) from error
    return DynamicOutcome(recording=recording, shown=shown, place=place, picture=picture, notes=notes)


async def capture_dynamic(
    site: SiteFile, site_path: Path, wish: RecordingOptions, clock: Clock, say: Say
) -> DynamicOutcome:
    """Record, evaluate, draw and keep. Whatever fails, what was recorded before stays readable.

    While a gateway serves this site, it lends the devices. Raises ConfigError (E-DYN-INSTRUMENT), CaptureError
    (E-CAP-TRIGGER, E-CAP-CLOCK), what the instrument and `gateway.broker.borrow_devices` raise.
    """
    section = _section(site, wish.instrument)
    folder = new_run(site, site_path, utc=clock.utc)
    RunStarted(str(folder.path)).tell(say)
    try:
        async with borrow_devices(store_of(site, site_path).root, folder.run_id, clock, say) as told:
            ended, path, notes = await _record(section, wish, clock, folder, told)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    found = outcome_of(open_stream(path), path, picture=folder.path / PICTURE, band=wish.band, notes=notes)
    folder.write_text("dynamic.json", json.dumps({**found.as_data(), "ended": ended.why}, indent=1, default=str))
    folder.adopt(*(one for one in folder.path.iterdir() if one.stem == path.stem or one.name == PICTURE))
    folder.set_state(STATE)
    return found


def _section(site: SiteFile, name: str) -> InstrumentSection:
    for section in site.instruments:
        if section.name == name:
            return section
    known = ", ".join(section.name for section in site.instruments)
    raise ConfigError("E-DYN-INSTRUMENT", site.site.name, name=name, known=known or "none")


async def _record(
    section: InstrumentSection, wish: RecordingOptions, clock: Clock, folder: RunFolder, say: Say
) -> tuple[CaptureEnd, Path, tuple[Message, ...]]:
    factory = registry.load(section.driver, "instrument")
    instrument = cast(Instrument, factory(section.name, section.url, section.settings, clock))
    try:
        identity = await instrument.open(section.timeout_s)
        if section.serial and identity.serial != section.serial:
            raise UnsupportedDevice("E-SUP-SERIAL", section.name, found=identity.serial, wanted=section.serial)
        header = {"Machine": folder.facts["site"], "Serial No": identity.serial, "Axis": wish.axis}
        header |= {"Owner": f"{identity.driver} {identity.model}", "Date": clock.utc().isoformat(timespec="seconds")}
        maker = _Recorders(folder, section.name, wish, header, say)
        ended = await _follow(instrument, wish, clock, maker, say)
    finally:
        await instrument.close()
    if maker.path is None:
        raise CaptureError("E-DYN-NOTHING", section.name, why=ended.why)
    return ended, maker.path, _notes(instrument, ended)


class _Recorders:
    """Opens the one recorder when the signal is known, and closes it."""

    def __init__(self, folder: RunFolder, name: str, wish: RecordingOptions, header: dict[str, str], say: Say) -> None:
        self._folder = folder
        self._name = name
        self._wish = wish
        self._header = header
        self._say = say
        self._recorder: RawRecorder | None = None

    @property
    def path(self) -> Path | None:
        """Where the samples are; None before the first."""
        return self._recorder.path if self._recorder else None

    def begin(self, stretch: StreamShape) -> Sink:
        """The recorder of a signal."""
        facts = StreamFacts(
            rate_hz=stretch.rate_hz,
            unit=stretch.unit,
            scale=stretch.scale,
            trigger=stretch.trigger,
            header=self._header,
        )
        label = f"dynamic-{self._wish.axis or stretch.channel}"
        self._recorder = RawRecorder(self._folder.path, label, facts)
        said = {"instrument": self._name, "rate_hz": f"{stretch.rate_hz:g}", "file": str(self._recorder.path)}
        self._say("P-CAP-DYNAMIC", channel=stretch.channel, **said)
        return self._recorder

    def close(self) -> None:
        """Let go of the file."""
        if self._recorder is not None:
            self._recorder.close()


async def _follow(
    instrument: Instrument, wish: RecordingOptions, clock: Clock, maker: _Recorders, say: Say
) -> CaptureEnd:
    made = DynamicCapture(
        instrument.channels,
        wish.seconds,
        maker.begin,
        channel=wish.channel,
        trigger=wish.trigger,
        view=_live_display(say, wish.channel or instrument.channels[0]),
    )
    stream = instrument.blocks()
    try:
        async with clock.deadline(wish.wait_s + wish.seconds, instrument.name):
            return await made.follow(stream)
    except LimitPassed as error:
        if maker.path is None:
            raise CaptureError("E-CAP-TRIGGER", instrument.name, timeout_s=wish.wait_s + wish.seconds) from error
        raise
    finally:
        maker.close()
        closer = getattr(stream, "aclose", None)
        if closer is not None:
            await closer()


def _live_display(say: Say, channel: str) -> Callable[[LiveView], None]:
    unit, _scale = unit_of(channel)

    def view(seen: LiveView) -> None:
        say(
            "P-CAP-LIVE",
            state="waiting" if seen.waiting else "at",
            time_s=fixed(seen.time_s),
            low=digits(seen.low, 4),
            high=digits(seen.high, 4),
            mean=digits(seen.mean, 4),
            unit=unit,
            samples=seen.samples,
            lost=seen.lost,
        )

    return view


def _notes(instrument: Instrument, ended: CaptureEnd) -> tuple[Message, ...]:
    notes = [*ended.notes, *map(Message.stored, instrument.notices)]
    if ended.why != "complete":
        notes.append(Message.of("S-DYN-ENDED", why=Message.of(ENDED[ended.why])))
    if instrument.compensated_for == "nothing" and instrument.channels[0].endswith("mm"):
        notes.append(Message.of("S-DYN-VACUUM"))
    return tuple(notes)


# The picture of a dynamic record: its envelope over time and its spectrum, however many samples it has.

INK, QUIET, FILL = "#22282e", "#6d757d", "#1f4e79"
SIGN = {"um": "µm", "arcsec": "arcsec"}
POINTS = 1500


def draw_recording(recording: Recording, spectrum: DynamicSpectrum | None, path: Path) -> Path:
    """Write a PNG of 1500 x 1050 pixels; the file must not exist."""
    figure = Figure(figsize=(10.0, 7.0), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1)
    _envelope(above, recording)
    _spectrum(below, spectrum, SIGN[recording.unit])
    with open_own(path, "xb") as file:
        figure.savefig(file, format="png")
    return path


def _envelope(panel: Axes, recording: Recording) -> None:
    time_s, low, high = recording.envelope(POINTS)
    if len(time_s) < len(recording):
        panel.fill_between(time_s, low, high, color=FILL, lw=0.3)
    else:
        panel.plot(time_s, low, color=FILL, lw=0.8)
    for gap in recording.gaps[:POINTS]:
        panel.axvline(float(recording.times(gap.index, gap.index + 1).sum()), color=QUIET, lw=0.6, ls=":")
    if recording.trigger:
        panel.axvline(float(recording.times(recording.trigger, recording.trigger + 1)[0]), color=INK, lw=0.8, ls="--")
    panel.set_xlabel("time  s")
    panel.set_ylabel(f"{SIGN[recording.unit]}")
    panel.set_title(f"{len(recording)} samples at {recording.rate_hz:g} Hz", loc="left", fontsize=9)


def _spectrum(panel: Axes, spectrum: DynamicSpectrum | None, unit: str) -> None:
    panel.set_xlabel("frequency  Hz")
    panel.set_ylabel(f"amplitude  {unit}")
    if spectrum is None:
        return
    shown = spectrum.frequency_hz > 0.0
    panel.loglog(spectrum.frequency_hz[shown], np.maximum(spectrum.amplitude[shown], 1e-9), color=FILL, lw=0.7)
    for peak in spectrum.peaks[:5]:
        panel.annotate(f"{peak.frequency_hz:.4g} Hz", (peak.frequency_hz, peak.amplitude), fontsize=7, color=INK)
    panel.grid(True, which="major", color="#e4e7e9", lw=0.5)
