"""What a site file may say about a control behind OPC UA."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field

from drivers.errors import words
from drivers.message import Message
from drivers.settings import CertificatePathText, DriverSettings, FilePathText, FolderPathText, Rule, VariableText
from drivers.sinumerik.ncprogram.words import COUNT, SetupWord, Words
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.certificates import last_record

# Best first; both sign and encrypt. The last one is what every control has.
POLICIES = ("Aes256_Sha256_RsaPss", "Basic256Sha256")
BEST: Literal["best"] = "best"
NONE = "None"


class UaSettings(DriverSettings):
    """Keys under ``[controller.settings]``.

    The password is in ``password_file`` or in the environment variable ``password_env``; ``password`` itself is for
    programs, a site file may not hold it.
    """

    addresses: ClassVar[tuple[str, ...]] = ("opc.tcp",)
    user: str = Field(default="", description="user of the control's OPC UA server; left out: anonymous")
    password: str = Field(default="", description="for programs only: a site file names password_file or password_env")
    password_file: FilePathText = Field(default="", description="file that holds the password, one line")
    password_env: VariableText = Field(default="", description="environment variable that holds the password")
    writing_user: str = Field(
        default="",
        description="second user, for what writes: logged in before the first program or R parameter is written, and "
        "logged out with the end of the command; left out: user does all",
    )
    writing_password_file: FilePathText = Field(default="", description="file that holds its password, one line")
    writing_password_env: VariableText = Field(default="", description="environment variable that holds its password")
    security: Literal["best", "Aes256_Sha256_RsaPss", "Basic256Sha256", "None"] = Field(
        default=BEST,
        description="best: the better policy that the server offers; each but None signs and encrypts",
    )
    server_certificate: CertificatePathText = Field(
        default="", description="file of the control's certificate, written by `trueflank doctor certificate`"
    )
    client_folder: FolderPathText = Field(
        default="", description="folder of the gateway's own certificate; left out: the folder of server_certificate"
    )
    r_first: int = Field(
        default=80, ge=0, le=nodes.R_LAST - COUNT, description=f"first of {COUNT} R parameters that are ours alone"
    )
    r_setup: int = Field(
        default=-1,
        ge=-1,
        le=nodes.R_LAST - 2,
        description="first of three R parameters for a test part; -1: the three before r_first, or behind its 20",
    )
    channel: int = Field(default=1, ge=1, le=10, description="channel number of the control")
    two_programs: bool = Field(
        default=False, description="for controls that do not transfer files while a program waits"
    )
    poll_s: float = Field(default=0.05, ge=0.02, le=5.0, description="time between questions while waiting, s")
    fast_poll_s: float = Field(
        default=0.002, ge=0.001, le=5.0, description="time between the first questions after a step, s; poll_s at most"
    )
    plans_per_program: int = Field(
        default=80,
        ge=1,
        le=200,
        description="most stop plans in one program, each about 20 kB of text: what the control's memory for programs "
        "holds; more of them are fewer presses of NC START",
    )
    wait_limit_s: float = Field(default=14400.0, ge=60.0, description="time after which an abandoned program ends, s")
    stale_s: float = Field(
        default=1.0, ge=0.0, description="maximum age of the machine state by the server's time, s; 0: any"
    )
    serial_node: str = Field(default=nodes.SERIAL_NUMBER, description="node of the serial number")
    version_node: str = Field(default=nodes.NCK_VERSION, description="node of the NCK version")
    type_node: str = Field(
        default="", description="node of a further fact of the hardware: type or number of the NCU; left out: not read"
    )
    r_marker: int = Field(
        default=-1,
        ge=-1,
        le=nodes.R_LAST,
        description="R parameter in which a person typed this machine's own number; only read, -1: none",
    )
    marker_node: str = Field(
        default="", description="node of that number where it is a GUD, in place of r_marker; only read"
    )

    def rules(self) -> tuple[Rule, ...]:
        """What holds between keys: a pinned certificate, one password, free R parameters, nodes of this control."""
        pinned = not self.secured or bool(self.server_certificate)
        return (
            ("server_certificate", pinned, words("W-KEY-PINNED")),
            ("password_file", self._one_password(), words("W-KEY-ONE-PASSWORD")),
            ("user", bool(self.user) or not self._passwords(), words("W-KEY-WHO")),
            ("password_file", not self.user or self._answered(), words("W-KEY-NO-PASSWORD")),
            ("writing_user", self._apart(), words("W-KEY-WRITER")),
            ("r_setup", self._free(), words("W-KEY-R-SETUP", last=nodes.R_LAST - 2)),
            ("fast_poll_s", self.fast_poll_s <= self.poll_s, words("W-KEY-FAST")),
            ("serial_node", nodes.parse(self.serial_node) is not None, words("W-KEY-NODE")),
            ("version_node", nodes.parse(self.version_node) is not None, words("W-KEY-NODE")),
            ("type_node", not self.type_node or nodes.parse(self.type_node) is not None, words("W-KEY-NODE")),
            ("r_marker", not self.words.holds(self.r_marker), words("W-KEY-R-MARKER")),
            ("marker_node", not self.marker_node or nodes.parse(self.marker_node) is not None, words("W-KEY-NODE")),
            ("marker_node", not self.marker_node or self.r_marker < 0, words("W-KEY-ONE-MARKER")),
        )

    @classmethod
    def first(cls, settings: Mapping[str, Any], where: str) -> UaSettings:
        """As `read`, of a file that may name no certificate yet: who looks at the road says so in a line of its own."""
        if any(fault.key != "server_certificate" for fault in cls.faults(settings)):
            return cls.read(settings, where)
        return cls.model_validate(dict(settings))

    def unprotected(self, url: str) -> Message | None:
        """OPC UA without signature and encryption."""
        del url
        return None if self.secured else Message.of("W-UA-UNPROTECTED")

    def excused(self) -> tuple[str, str]:
        """As the record beside the pinned certificate has it; what cannot be read says nothing."""
        try:
            found = last_record(Path(self.server_certificate)) if self.secured and self.server_certificate else {}
        except (OSError, ValueError):
            return "", ""
        return (str(found.get("who", "")), str(found["reason"])) if found.get("reason") else ("", "")

    @property
    def plans_together(self) -> int:
        """As many as one program holds."""
        return self.plans_per_program

    @property
    def one_start(self) -> bool:
        """Unless each half is a program of its own."""
        return not self.two_programs

    @property
    def secured(self) -> bool:
        """Whether messages are signed and encrypted."""
        return self.security != NONE

    @property
    def policies(self) -> tuple[str, ...]:
        """Security policies that may be used, best first."""
        return POLICIES if self.security == BEST else (self.security,)

    def _one_password(self) -> bool:
        return self._passwords() <= 1

    def _answered(self) -> bool:
        """Whether a password is given; an empty one only where it is written."""
        return self._passwords() > 0 or "password" in self.model_fields_set

    def _passwords(self) -> int:
        """How many passwords are given."""
        return sum(map(bool, (self.password, self.password_file, self.password_env)))

    def _apart(self) -> bool:
        """Whether the writing account is another one, with one password; or there is none."""
        given = sum(map(bool, (self.writing_password_file, self.writing_password_env)))
        return self.writing_user != self.user and given == 1 if self.writing_user else not given

    def _free(self) -> bool:
        """Whether the set-up values have R parameters of their own."""
        first, count = self.words.setup, len(SetupWord)
        apart = first + count <= self.r_first or first >= self.r_first + COUNT
        return apart and 0 <= first <= nodes.R_LAST - 2 and self.r_setup >= -1

    @property
    def words(self) -> Words:
        """The R parameters of this site."""
        before = self.r_first - len(SetupWord)
        usual = before if before >= 0 else self.r_first + COUNT
        return Words(self.r_first, self.r_setup if self.r_setup >= 0 else usual)
