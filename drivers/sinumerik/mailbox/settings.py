"""What a site file may say about a control behind a PLC mailbox."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from decimal import Decimal
from typing import Annotated, ClassVar, Literal
from urllib.parse import urlsplit

from pydantic import Field

from drivers.errors import words
from drivers.message import Message
from drivers.settings import WIRES, CertificatePathText, DriverSettings, FilePathText, Rule
from drivers.sinumerik.mailbox.codec.registers import WordOrder

_CHARACTER_BITS = 11.0
TLS = "tls"
_CABLES = ("", "usb")
_FAST_BAUD, _FAST_GAP_S = 19200, 0.00175


ADAPTER = ("local_echo", "leading_zeros")


class ModbusSettings(DriverSettings):
    """Keys under ``[controller.settings]``; docs/plc-mailbox.md has the same list."""

    addresses: ClassVar[tuple[str, ...]] = WIRES
    sources: ClassVar[str] = "MD32452: Siemens' own list of machine data (sublime-s840d, doc/en)"
    unit: int = Field(default=1, ge=1, le=247, description="unit number of the PLC; 0 is not allowed (broadcast)")
    framer: Literal["", "tcp", "rtu"] = Field(
        default="", description="tcp or rtu; left out: RTU for serial ports and socket://, TCP else"
    )
    security: Literal["None", "tls"] = Field(
        default="None",
        description="tls: Modbus/TCP Security, usually on port 802; None: plain Modbus",
    )
    server_certificate: CertificatePathText = Field(
        default="", description="the PLC's own certificate (PEM), or with server_name its authority's"
    )
    server_name: str = Field(default="", description="name that a certificate signed by that authority must have")
    client_certificate: CertificatePathText = Field(
        default="", description="this gateway's certificate (PEM), with the role that the PLC asks for"
    )
    client_key_file: FilePathText = Field(default="", description="its private key (PEM, without password)")
    word_order: WordOrder = Field(default="high-first", description="which half of a 32-bit number comes first")
    baudrate: int = Field(default=115_200, ge=1200, le=4_000_000, description="of a serial line, Bd")
    parity: Literal["N", "E", "O"] = Field(default="N", description="of a serial line")
    local_echo: bool = Field(
        default=False, description="the RS-485 adapter returns what this PC sends: its copy is passed over"
    )
    leading_zeros: bool = Field(
        default=False, description="zero bytes before an answer, of an RS-485 line without bias, are passed over"
    )
    reply_s: float = Field(default=1.0, ge=0.05, le=30.0, description="longest wait for one answer, s")
    poll_s: float = Field(default=0.2, ge=0.2, le=5.0, description="time between questions while idle, s")
    fast_poll_s: float = Field(
        default=0.001, ge=0.001, le=5.0, description="time between the first questions of a transfer, s; poll_s at most"
    )
    command_s: float = Field(
        default=30.0,
        ge=5.0,
        le=600.0,
        description="longest wait for a command to be done, s (its 60 s at the panel apart)",
    )
    release_s: float = Field(
        default=120.0, ge=1.0, le=900.0, description="longest wait for a person to give the release at the panel, s"
    )
    encoder: int = Field(default=0, ge=0, le=1, description="measuring system whose tables are read")
    needs_reference: bool = Field(
        default=True,
        description="a new table acts only after NCK reset and reference run; the push then waits for the operator",
    )
    axis_numbers: dict[str, Annotated[int, Field(ge=1, le=31)]] = Field(
        default_factory=dict,
        description="numbers by which the PLC calls all its machine axes, where they are not 1, 2, 3 in their order",
    )
    backlash_factors: dict[str, Annotated[float, Field(ge=0.01, le=100.0)]] = Field(
        default_factory=dict, description="MD32452 by machine axis, where it is not 1"
    )

    def rules(self) -> tuple[Rule, ...]:
        """A transfer asks no slower than an idle line; TLS has all its certificates, and nothing else has any."""
        files = {key: getattr(self, key) for key in ("server_certificate", "client_certificate", "client_key_file")}
        wanted = self.secured
        why = words("W-KEY-TLS-FILE" if wanted else "W-KEY-TLS-ONLY")
        return (
            (
                "axis_numbers",
                len(set(self.axis_numbers.values())) == len(self.axis_numbers),
                words("W-KEY-NUMBERED-TWICE"),
            ),
            ("fast_poll_s", self.fast_poll_s <= self.poll_s, words("W-KEY-FAST")),
            *((key, self.framer != "tcp", words("W-KEY-ADAPTER")) for key in ADAPTER if getattr(self, key)),
            ("framer", not wanted or self.framer != "rtu", words("W-KEY-FRAMER")),
            ("server_name", wanted or not self.server_name, words("W-KEY-TLS-ONLY")),
            *((key, bool(path) is wanted, why) for key, path in files.items()),
        )

    @property
    def secured(self) -> bool:
        """Whether both ends prove who they are, and what passes is encrypted."""
        return self.security == TLS

    def unprotected(self, url: str) -> Message | None:
        """Plain Modbus over a network; a serial port of this computer is a cable that nobody else is on."""
        scheme = urlsplit(url).scheme if "://" in url else ""
        return Message.of("W-MBX-UNPROTECTED") if not self.secured and scheme not in _CABLES else None

    def numbered(self, names: Iterable[str]) -> Mapping[str, tuple[int, Decimal]]:
        """Number and MD32452 of each machine axis, given in their order, as the site file says: what is printed."""
        return {
            name: (self.axis_numbers.get(name, place), Decimal(repr(self.backlash_factors.get(name, 1.0))))
            for place, name in enumerate(names, start=1)
        }

    @property
    def order(self) -> WordOrder:
        """The word order."""
        return self.word_order

    def framing(self, url: str) -> str:
        """tcp or rtu for this url."""
        scheme = urlsplit(url).scheme if "://" in url else ""
        return self.framer or ("tcp" if scheme in ("tcp", "memory") else "rtu")

    @property
    def gap_s(self) -> float:
        """Silence before a request on a serial line: 3.5 characters, fixed above 19200 Bd (Serial Line V1.02)."""
        return _FAST_GAP_S if self.baudrate > _FAST_BAUD else 3.5 * _CHARACTER_BITS / self.baudrate
