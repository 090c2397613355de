"""Wire traces: every byte kept with its time, bounded, without secrets; played again they give the same samples."""

from __future__ import annotations

import random
import struct
from contextlib import aclosing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers import registry
from drivers.clock import LoopClock
from drivers.errors import ConfigError, FileFormatError
from drivers.local.scrub import without_secrets
from drivers.replay.player import Player, ReplayResult
from drivers.replay.recorder import Record, TraceRecorder, encode_head, encode_record, read_trace
from drivers.transport import serve
from drivers.types.sensing import SampleBlock
from tests.contract.servers import ScriptedBridge, ScriptedFrames, ScriptedUmd
from tests.unit.drivers.loops import run_clean

SCRIPTS: dict[str, Any] = {"umd": ScriptedUmd, "bridge": ScriptedBridge, "bridge in frames": ScriptedFrames}


def recorded(script: str, folder: Path, **more: Any) -> tuple[list[SampleBlock], Path]:
    """A short capture with a gap and, in the middle, other questions; its blocks and its trace."""
    driver = script.split(maxsplit=1)[0]
    blocks: list[SampleBlock] = []
    files: list[Path] = []

    async def main() -> None:
        clock = LoopClock()
        double = SCRIPTS[script](clock)
        listener = await serve("memory://traced", double.converse, clock)
        device = registry.load(driver, "instrument")("laser", listener.url, more, clock)
        about = {"driver": driver, "url": listener.url, "settings": more}
        trace = registry.load("wire-trace", "trace")(folder, "laser", clock, about)
        device.trace = trace
        for _ in range(2):
            trace.session()
            await device.open(5.0)
            blocks.clear()
            if driver == "bridge":
                await device.hold()
                await device.ambient()
            async with aclosing(device.blocks()) as stream:
                async for block in stream:
                    blocks.append(block)
                    if len(blocks) == 10:
                        double.skip = 17
                    if len(blocks) == 30:
                        break
            await device.close()
        await listener.close()
        trace.close()
        assert not trace.failure
        files.append(trace.path)

    run_clean(main, virtual=True)
    return blocks, files[0]


def joined(blocks: list[SampleBlock]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([block.time_s for block in blocks]), np.concatenate([block.values for block in blocks])


@pytest.mark.parametrize("script", sorted(SCRIPTS))
def test_a_trace_gives_the_same_samples_gaps_and_values_at_a_desk(script: str, tmp_path: Path) -> None:
    before, path = recorded(script, tmp_path)
    player = Player(path)
    assert len(player.sessions) == 2
    heard: list[SampleBlock] = []
    driver = registry.load(player.driver, "instrument")
    found: ReplayResult = player.play(driver, player.settings, 2, heard.append)
    time_s, values = joined(heard)
    wanted_s, wanted = joined(before)
    begin = int(np.searchsorted(time_s, wanted_s[0] - 1e-9))
    assert np.array_equal(time_s[begin : begin + len(wanted_s)], wanted_s)
    assert np.array_equal(values[begin : begin + len(wanted_s)], wanted)
    assert (found.lost, found.gaps, found.invalid, found.sessions) == (17, 1, 0, 2)
    assert found.samples == len(time_s)
    assert found.identity is not None
    assert found.ended is not None
    assert found.ended.code in ("E-LINK-CLOSED", "E-LINK-STALE", "E-LINK-BROKEN")
    assert found.highest[0] == values[:, 0].max()
    again = Player(path).play(driver, player.settings, 2)
    assert (again.samples, again.lowest, again.highest, again.events) == (
        found.samples,
        found.lowest,
        found.highest,
        found.events,
    )


def test_the_command_prints_what_the_driver_made_of_it(tmp_path: Path) -> None:
    from gateway.cli import app

    _blocks, path = recorded("umd", tmp_path)
    sheet = tmp_path / "samples.csv"
    result = CliRunner().invoke(app, ["runs", "replay", str(path), "--csv", str(sheet)])
    assert result.exit_code == 0, result.output
    assert "17 lost in 1 gaps, 0 invalid" in result.output
    assert "displacement_mm:" in result.output
    assert sheet.read_text().splitlines()[0] == "time_s,displacement_mm,valid"
    result = CliRunner().invoke(
        app, ["runs", "replay", str(path), "--set", "counts_per_cycle=16", "--json", "--session", "2"]
    )
    assert result.exit_code == 0
    assert '"lost": 17' in result.output
    assert isinstance(CliRunner().invoke(app, ["runs", "replay", str(path), "--session", "3"]).exception, ConfigError)
    assert isinstance(CliRunner().invoke(app, ["runs", "replay", str(path), "--set", "x"]).exception, ConfigError)


def put(recorder: TraceRecorder, pieces: list[bytes]) -> None:
    for piece in pieces:
        recorder("<", piece)


def in_loop(work: Any) -> None:
    async def main() -> None:
        work()

    run_clean(main, virtual=True)


def test_files_are_bounded_and_read_in_their_order(tmp_path: Path) -> None:
    def work() -> None:
        recorder = TraceRecorder(tmp_path, "laser", LoopClock(), {}, file_bytes=1000, files=3)
        put(recorder, [b"%04d" % number for number in range(1000)])
        recorder.close()
        put(recorder, [b"too late"])

    in_loop(work)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["laser.trace", "laser.trace.1", "laser.trace.2"]
    assert all(file.stat().st_size < 1100 for file in tmp_path.iterdir())
    data = [record.data for record in Player(tmp_path / "laser.trace").trace.records]
    assert data == [b"%04d" % number for number in range(1000 - len(data), 1000)]
    assert len(data) > 100


def test_a_disk_that_refuses_ends_the_trace_and_not_the_measuring(tmp_path: Path) -> None:
    place = tmp_path / "file"
    place.write_text("")

    def work() -> None:
        recorder = TraceRecorder(place, "laser", LoopClock(), {})
        assert recorder.failure
        put(recorder, [b"x"])

    in_loop(work)


def test_secrets_are_never_in_a_trace(tmp_path: Path) -> None:
    settings = {"password": "geheim", "user": "ann", "tls": {"client_token": "geheim"}, "baudrate": 9600}
    assert without_secrets(settings) == {
        "password": "***",
        "user": "ann",
        "tls": {"client_token": "***"},
        "baudrate": 9600,
    }

    def work() -> None:
        about = {"url": "tcp://ann:geheim@host:1", "settings": settings}
        recorder = TraceRecorder(tmp_path, "laser", LoopClock(), about)
        recorder(">", b'{"jsonrpc":"2.0","id":1,"params":{"Password":"geheim","sessionToken" : "geheim","x":"y"}}\n')
        recorder.close()

    in_loop(work)
    raw = (tmp_path / "laser.trace").read_bytes()
    assert b"geheim" not in raw
    assert b'"x":"y"' in raw


@pytest.mark.parametrize("data", [b"", b"{}\n", b"hello\n", b'{"trueflank_trace":2}\n', encode_head({}) + b"?" * 20])
def test_what_is_no_trace_is_refused(data: bytes, tmp_path: Path) -> None:
    file = tmp_path / "x.trace"
    file.write_bytes(data)
    with pytest.raises(FileFormatError, match="E-REPLAY-FILE"):
        Player(file)
    with pytest.raises(FileFormatError):
        Player(tmp_path / "none.trace")


def refused(data: bytes) -> bool:
    try:
        read_trace([data], "x").sessions()
    except FileFormatError as error:
        return bool(error.fields["why"])
    return False


def test_mutated_traces_are_refused_in_our_words_or_read() -> None:
    chance = random.Random(5)
    whole = encode_head({"driver": "umd"}) + b"".join(
        encode_record(Record("<", at * 0.1, b"0 0 1 0 0 1 0 0\r\n")) for at in range(4)
    )
    outcomes = {"read": 0, "refused": 0}
    for _ in range(20_000):
        bent = bytearray(whole)
        at = chance.randrange(len(bent))
        if chance.random() < 0.5:
            bent[at] ^= 1 << chance.randrange(8)
        else:
            del bent[at : at + chance.randrange(1, 9)]
        outcomes["refused" if refused(bytes(bent)) else "read"] += 1
    assert min(outcomes.values()) > 2000, outcomes


def test_a_torn_last_record_is_left_out() -> None:
    whole = (
        encode_head({"driver": "umd"})
        + encode_record(Record("<", 1.5, b"abc"))
        + encode_record(Record("<", 2.0, b"def"))
    )
    for cut in range(1, 16):
        assert [record.data for record in read_trace([whole[:-cut]], "x").records] == [b"abc"]
    assert read_trace([whole], "x").about["driver"] == "umd"
    assert struct.calcsize("<cdI") == 13
