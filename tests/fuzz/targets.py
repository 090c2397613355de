"""The parsers of bytes that others wrote, each as one function of bytes, with seeds that it reads.

A parser of a stream is given its bytes in pieces too: where they are cut must make no difference to what is raised.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.attocube.codec import AttocubeCodec
from drivers.bridge.codec import BridgeCodec
from drivers.exchange.recognise import recognise
from drivers.files.circles import CircleColumns, parse_b5r, parse_circle
from drivers.files.drives import DriveColumns, parse_drive
from drivers.files.gear import GearColumns, read_gear_table
from drivers.files.klingelnberg import read_contour, read_mew, read_mka
from drivers.gauge.codec import GaugeCodec
from drivers.linuxcnc.codec import AgentCodec
from drivers.local.textfile import decode_text
from drivers.replay.recorder import read_trace
from drivers.sinumerik.mailbox.codec.frames import decode_picture, decode_status
from drivers.sinumerik.mailbox.wire import READ, Adapter, ModbusCodec, Question
from drivers.sinumerik.tablefile.container import read_texts
from drivers.sinumerik.tablefile.listing import read_listing
from drivers.sinumerik.tablefile.reader import read_sources
from drivers.types.exchange import ReadAs
from drivers.umd.codec import UmdCodec
from gateway.config import load_site
from gateway.shadow.reading import ProgramReader
from tests.fuzz.answers import recorded, talk
from tests.unit.drivers.test_drive_files import text as drive_text
from tests.unit.drivers.test_gear_measuring_files import MEW, SCAN, TRACE_COLUMNS, TRACES, mka
from tests.unit.drivers.test_mutated_files import PARSERS
from tests.unit.exchange.test_formats import (
    ERRORS_TYPED,
    PRINTED_ETALON,
    PRINTED_ISG,
    PRINTED_LIST,
    PRINTED_TRIMS,
    TYPED,
)
from tests.unit.exchange.test_other_controls import AXESERR, BLOCKS, CAL, COM, FACTS, LISTING, OLDER, VOLUME
from tests.unit.shadow.test_copies import AXES, PROGRAM

Read = Callable[[bytes], object]
ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/golden"
DECLARED = {"start": -30, "axis_number": 1, **FACTS}
FORMS = {"linuxcnc": "trims", "twincat": "real", "fanuc": "error", "heidenhain": "error"}
PIECES = 7
WORDS_READ = (0, 15), (200, 102), (302, 86)


def _text(data: bytes) -> str:
    return decode_text(data, "cp1252", "x")


def _exchange(name: str, role: str) -> Read:
    reader: Any = registry.load(name, role)()
    if role == "error-exchange":
        return lambda data: reader.read(_text(data), "x")
    return lambda data: reader.read(_text(data), "x", ReadAs("X", "mm", FORMS.get(name, ""), DECLARED))


def _stream(*codecs: Callable[[], Any]) -> Read:
    """Every codec with the whole, and with its pieces."""

    def read(data: bytes) -> None:
        for codec in codecs:
            tuple(codec().receive(data))
            cut = codec()
            for at in range(0, len(data), PIECES):
                tuple(cut.receive(data[at : at + PIECES]))

    return read


def _asked(framer: str, adapter: Adapter, address: int, count: int) -> Callable[[], ModbusCodec]:
    def made() -> ModbusCodec:
        codec = ModbusCodec(1, framer, adapter)
        codec.send(Question(READ, address, count))
        return codec

    return made


def _modbus(data: bytes) -> None:
    """The answer to each of our reads, and what is then made of its registers."""
    for framer, adapter in (("tcp", Adapter()), ("rtu", Adapter()), ("rtu", Adapter(True, True))):
        for address, count in WORDS_READ:
            _stream(_asked(framer, adapter, address, count))(data)


def _registers(data: bytes) -> None:
    words = [int.from_bytes(data[at : at + 2], "big") for at in range(0, 2 * 86, 2)]
    decode_status(words[:15], "high-first")
    decode_picture(words, "low-first")
    decode_picture(words, "high-first")


def _modbus_answer(address: int, count: int) -> bytes:
    body = bytes([1, READ, 2 * count]) + bytes(2 * count)
    return b"\0\1\0\0" + len(body).to_bytes(2, "big") + body


def _site(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "site.toml"
        path.write_bytes(data)
        load_site(path)


def _program(data: bytes) -> None:
    reader = ProgramReader(AXES, frames={"G54": {"X": -160.0}}, subprogram={"DEEPER": "G1 X=IC(-1) F500\nM17\n"}.get)
    reader.read(_text(data))


def _tables(data: bytes) -> None:
    read_sources(read_texts(data, "x"))


def _golden(*patterns: str) -> list[bytes]:
    return [path.read_bytes() for pattern in patterns for path in sorted(GOLDEN.glob(pattern))]


def _texts(*texts: str) -> list[bytes]:
    return [text.encode("utf-8") for text in texts]


def _b5r() -> list[bytes]:
    head = b'<?xml version="1.0"?><R><TEST><PLANE TEST_PLANE="XY"/><MACHINE_TESTED NAME="Mill 7"/>'
    one = b'<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_UM">8.3</FEATURE>'
    return [head + one + b'<FEATURE NAME="AF_SCALE" DT="UT_LENGTH_MM">0.004</FEATURE></TEST></R>']


def _circles() -> list[bytes]:
    turns = [0.1 * number for number in range(70)]
    rows = [f"{150 * math.cos(turn):.4f},{150 * math.sin(turn):.4f}" for turn in turns]
    return _texts("\n".join(("# Radius mm,150", "x_mm,y_mm", *rows, "")))


def targets(*, recording: bool = True) -> Mapping[str, tuple[Read, list[bytes]]]:
    """Every parser by its name, with its seeds; without ``recording`` without those that are recorded first."""
    found: dict[str, tuple[Read, list[bytes]]] = {name: (read, bases) for name, (bases, read, _) in PARSERS.items()}
    found |= {
        "mka": (lambda data: read_mka(_text(data), "x"), _texts(mka(24))),
        "mew": (lambda data: read_mew(_text(data), "x"), _texts(MEW)),
        "contour": (lambda data: read_contour(_text(data), "x"), _texts(SCAN)),
        "gear traces": (
            lambda data: read_gear_table(_text(data), GearColumns.read(TRACE_COLUMNS, "x"), "x"),
            _texts(TRACES),
        ),
        "ballbar": (lambda data: parse_b5r(data, "x"), _b5r()),
        "circle": (lambda data: parse_circle(_text(data), CircleColumns(), "x"), _circles()),
        "drive": (lambda data: parse_drive(_text(data), DriveColumns(), "x"), _texts(drive_text())),
        "840D tables": (_tables, _golden("tables/*.ini", "tables/*.spf", "tables/*.txt", "sinumerik/*.ini")),
        "840D listing": (
            lambda data: read_listing(_text(data), "x"),
            _golden("tables/control_data.ini", "tables/*.ini"),
        ),
        "NC program": (_program, [PROGRAM.encode(), *_golden("sinumerik/*.mpf")]),
        "PLC frames": (_modbus, [_modbus_answer(*one) for one in WORDS_READ] + [b"\0\1\0\0\0\3\1\x83\2"]),
        "PLC registers": (_registers, [bytes(172), bytes(range(172))]),
        "uMD lines": (
            _stream(lambda: UmdCodec("client"), lambda: UmdCodec("client", join_late=True)),
            [b"0 0 -1 -1 0 1 10 126\r\n0 0 12 13 0 2 8 100000\r\n", b"0 0 5 1 0 13 20 1027 0 -6 -2 0 0 700 3 0\n"],
        ),
        "bridge messages": (
            _stream(lambda: BridgeCodec("client"), lambda: BridgeCodec("server")),
            _bridge_exchange(),
        ),
        "attocube": (_stream(AttocubeCodec), [b'{"jsonrpc":"2.0","id":1,"result":[0,12]}\r\n']),
        "gauge": (_stream(GaugeCodec), [b"+1.234 mm\r"]),
        "LinuxCNC agent": (_stream(lambda: AgentCodec("token")), [b'{"id":1,"result":{"state":"idle"}}\n']),
        "trace": (
            lambda data: read_trace([data], "x"),
            [b'{"trueflank_trace":1,"url":"x"}\n<\0\0\0\0\0\0\0\0\1\0\0\0a'],
        ),
        "site TOML": (_site, [path.read_bytes() for path in sorted((ROOT / "examples/sites").glob("*.toml"))[:4]]),
        "recognised": (lambda data: recognise(_text(data)), _texts(LISTING, COM, CAL, AXESERR, PRINTED_LIST, VOLUME)),
        "OPC UA answers": (talk, [recorded()] if recording else []),
    }
    seeds = {
        "linuxcnc": [PRINTED_TRIMS], "twincat": [PRINTED_LIST], "fanuc": [LISTING], "heidenhain": [COM, OLDER],
        "axeserr": [AXESERR], "aerotech": [CAL], "table-csv": [TYPED],
    }  # fmt: skip
    for name, texts in seeds.items():
        found[f"tables of {name}"] = (_exchange(name, "table-exchange"), _texts(*texts))
    for name, texts in {
        "isg-volumetric": [PRINTED_ISG, BLOCKS, VOLUME],
        "etalon-exchange": [PRINTED_ETALON],
        "error-csv": [ERRORS_TYPED],
    }.items():
        found[f"errors of {name}"] = (_exchange(name, "error-exchange"), _texts(*texts))
    return found


def _bridge_exchange() -> list[bytes]:
    lines = (GOLDEN / "bridge/exchange.txt").read_text(encoding="utf-8").splitlines()
    said = [line.partition(" ")[2] for line in lines if line[:1] in "<>"]
    return [f"{one}\n".encode() for one in said if one.startswith("{")][:12] or [
        b'{"jsonrpc":"2.0","id":1,"result":{}}\n'
    ]
