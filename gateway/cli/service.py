"""The commands `service` (the systemd unit that starts `serve`) and `service bundle` (one zip for remote support)."""

from __future__ import annotations

import io
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from drivers.local.names import is_name
from drivers.local.ownfiles import read_own
from drivers.local.scrub import masked, masked_text, without_secrets_text
from drivers.message import Message
from drivers.terms import shown
from gateway import audit
from gateway.audit import audit_files, read_entries
from gateway.broker import notice_of, token_path
from gateway.cli.next_steps import show_next
from gateway.cli.options import SiteArgument, load_site
from gateway.cli.output import echo
from gateway.cli.signals import run_to_end
from gateway.config import SiteFile
from gateway.push import JOURNALS
from gateway.store import Store
from gateway.store.log_book import FOLDER as LOGS
from gateway.users import first_token_path

SERVICE_NAME = "trueflank"
SYSTEM_UNITS = Path("/etc/systemd/system")
UserOption = Annotated[bool, typer.Option("--user", help="A service of this user, not of the system.")]
FolderOption = Annotated[
    Path | None, typer.Option(help="Folder of the units; default: that of systemd.", show_default=False)
]


def unit_text(sites: list[Path], *, host: str, port: int, user: str) -> str:
    """The unit: ready when the page answers, alive while the loop turns, with time to leave a machine in order."""
    words = [sys.executable, "-m", "gateway.cli", "serve", *map(str, sites), "--host", host, "--port", str(port)]
    command = " ".join(shlex.quote(word).replace("%", "%%").replace("$", "$$") for word in words)
    who = f"User={user}\n" if user else ""
    names, folder = (text.replace("%", "%%") for text in (", ".join(path.stem for path in sites), str(sites[0].parent)))
    return f"""[Unit]
Description=trueflank gateway for {names}
After=network-online.target
Wants=network-online.target
StartLimitIntervalSec=0

[Service]
Type=notify
NotifyAccess=main
{who}WorkingDirectory={folder}
ExecStart={command}
KillMode=mixed
KillSignal=SIGTERM
TimeoutStartSec=60
TimeoutStopSec=60
WatchdogSec=60
Restart=on-failure
RestartSec=5
LimitNOFILE=65536
NoNewPrivileges=true
PrivateTmp=true

[Install]
WantedBy={"multi-user.target" if user else "default.target"}
"""


def install_command(
    sites: Annotated[list[Path], typer.Argument(metavar="SITE...", help="Site files (TOML).", show_default=False)],
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8617,
    run_as: Annotated[
        str, typer.Option(help="System user that runs the service; default: you.", show_default=False)
    ] = "",
    user: UserOption = False,
    folder: FolderOption = None,
) -> None:
    """Write the unit, let it start with the computer, and start it now; exit code 3 where it does not run then."""
    from gateway.audit import os_user

    for site in sites:
        load_site(site)
    person = "" if user else run_as or os_user()
    if person and not is_name(person):
        raise ConfigError("E-SERVICE-USER", "--run-as", name=person[:60])
    unit = _unit_path(folder, user=user)
    text = unit_text([site.resolve() for site in sites], host=host, port=port, user=person)
    try:
        unit.parent.mkdir(parents=True, exist_ok=True)
        unit.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError("E-SERVICE-WRITE", str(unit), why=error.strerror or str(error)) from error
    echo(f"written: {unit}")
    _call_manager(("daemon-reload",), user=user)
    begun = _call_manager(("enable", "--now", SERVICE_NAME), user=user)
    if _call_manager(("status", "--no-pager", SERVICE_NAME), user=user) or begun:
        _not_running(user=user)


def status_command(user: UserOption = False, folder: FolderOption = None) -> None:
    """Say whether the unit is installed and how the service is; exit code 0 only while it runs."""
    unit = _unit_path(folder, user=user)
    echo(f"{unit}: {'installed' if unit.is_file() else 'not installed'}")
    if not unit.is_file():
        show_next("service install SITE")
        raise typer.Exit(3)
    if _call_manager(("status", "--no-pager", SERVICE_NAME), user=user):
        _not_running(user=user)


def remove_command(user: UserOption = False, folder: FolderOption = None) -> None:
    """Stop the service and take its unit away; site files, runs and accounts stay."""
    unit = _unit_path(folder, user=user)
    if unit.is_file():
        _call_manager(("disable", "--now", SERVICE_NAME), user=user)
        unit.unlink()
        _call_manager(("daemon-reload",), user=user)
    echo(f"{unit}: not installed")


def _not_running(*, user: bool) -> NoReturn:
    echo(Message.of("S-SERVICE-NOT-RUNNING", user="--user " if user else "", service_name=SERVICE_NAME), err=True)
    raise typer.Exit(3)


def _unit_path(folder: Path | None, *, user: bool) -> Path:
    own = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "systemd" / "user"
    return (folder or (own if user else SYSTEM_UNITS)) / f"{SERVICE_NAME}.service"


def _call_manager(words: tuple[str, ...], *, user: bool) -> int:
    """Tell the service manager; where there is none, what would be told. Its exit code."""
    program = shutil.which("systemctl")
    shown = " ".join(("systemctl", *(("--user",) if user else ()), *words))
    if program is None:
        echo(Message.of("S-SERVICE-NO-MANAGER", shown=shown))
        return 0
    echo(shown)
    call = (program, *(("--user",) if user else ()), *words)
    return subprocess.run(call, check=False).returncode  # noqa: S603 - the words are ours


# ---- service bundle

DOCTOR_S = 60.0


def support_bundle_command(
    site: SiteArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="The zip to write.")] = Path("trueflank-support.zip"),
    runs: Annotated[int, typer.Option(min=0, max=100, help="How many of the newest runs.")] = 3,
    doctor: Annotated[bool, typer.Option(help="Also check the connection to the control.")] = True,
) -> None:
    """Write site file, versions, logs, newest runs, wire traces and doctor into one zip, without secrets."""
    from drivers.local.ownfiles import open_own
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    store = store_of(tree, site)
    told = run_to_end(_doctor_record(tree, site), at=site) if doctor else {"left out": "--no-doctor"}
    data = make_bundle(tree, site, store, runs=runs, doctor=told)
    try:
        with open_own(output, "xb", secret=True) as file:
            file.write(data)
    except OSError as error:
        raise ConfigError("E-BUNDLE-WRITE", str(output), why=error.strerror or str(error)) from error
    size = f"{len(data) / 1e6:.1f} MB" if len(data) >= 1e6 else f"{-(-len(data) // 1000)} kB"
    echo(Message.of("S-SERVICE-LOOK", output=output, size=size))


async def _doctor_record(tree: Any, site: Path) -> dict[str, Any]:
    """The doctor's lines; why there are none where the control does not answer or somebody else is at work."""
    from gateway.acceptance.control import examine_control
    from gateway.broker import borrow_devices
    from gateway.workflow.run.folder import store_of

    clock = LoopClock()
    try:
        async with clock.deadline(DOCTOR_S, "doctor"), borrow_devices(store_of(tree, site).root, "doctor", clock):
            lines = await examine_control(tree, site, clock)
    except TrueflankError as error:
        return {"error": error.as_record()}
    return {"lines": [line.as_record() for line in lines]}


# A bundle leaves the house, so secrets are kept out twice: only these places are read, none of which contains a secret
# of ours; and in what is taken, every secret that the site file names or the store keeps is replaced by stars.

MOST_FILE, MOST_ALL = 8_000_000, 200_000_000
AUDIT_RECORDS = 1000
LEFT_OUT = (".npy", ".f64", ".bin", ".html", ".pdf", ".png", ".svg", ".db")
"""Raw recordings, and pages that are made of what is taken."""
_TRACE = re.compile(r"\.trace(\.\d+)?$")
_POINTER = re.compile(r"_(file|env)$")


def make_bundle(site: SiteFile, path: Path, store: Store, *, runs: int, doctor: Mapping[str, Any]) -> bytes:
    """The zip as bytes: site file, versions, doctor, logs, audit records, journals, newest runs with their traces."""
    secrets = frozenset(_spellings(secrets_of(site, path, store.root)))
    left, told, out = MOST_ALL, list[str](), io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in _bundle_members(site, path, store, runs, doctor):
            if len(data) > min(MOST_FILE, left):
                told.append(f"{name}: left out, {len(data)} bytes")
                continue
            left -= len(data)
            made.writestr(name, _without_secrets(name, data, secrets))
        made.writestr(
            "contents.txt", _without_secrets("contents.txt", "\n".join([*made.namelist(), *told]).encode(), secrets)
        )
    return out.getvalue()


def _without_secrets(name: str, data: bytes, secrets: frozenset[bytes]) -> bytes:
    found = masked(data, secrets)
    if _TRACE.search(name):
        return found  # hidden when it was kept; the lengths in it must stay
    if name.endswith(".toml"):
        return without_secrets_text(found.decode("utf-8", "replace")).encode("utf-8")
    return masked_text(found)


def _bundle_members(
    site: SiteFile, path: Path, store: Store, runs: int, doctor: Mapping[str, Any]
) -> Iterator[tuple[str, bytes]]:
    yield f"sites/{path.name}", read_own(path)
    yield "site-as-read.json", _json_bytes(site.model_dump(mode="json"))
    yield "versions.json", _json_bytes(versions())
    yield "doctor.json", _json_bytes(doctor)
    for found in sorted((store.root / LOGS).glob("trueflank.log*")):
        yield f"logs/{found.name}", read_own(found)
    records = list(read_entries(store.root))[-AUDIT_RECORDS:] if audit_files(store.root / audit.AUDIT) else []
    yield "audit.json", _json_bytes({"newest": records, "problem": str(audit.check_log(store.root).problem or "")})
    for found in _plain_files(store.root / JOURNALS):
        yield f"journal/{found.relative_to(store.root / JOURNALS).as_posix()}", read_own(found)
    for run_id in reversed(store.newest(runs)):
        for found in _plain_files(store.root / run_id):
            yield f"runs/{run_id}/{found.relative_to(store.root / run_id).as_posix()}", read_own(found)


def _plain_files(folder: Path) -> Iterator[Path]:
    """Files of a folder but for pictures and raw recordings; no link is followed."""
    for found in sorted(folder.rglob("*")):
        if found.is_file() and not found.is_symlink() and found.suffix not in LEFT_OUT:
            yield found


def _json_bytes(data: object) -> bytes:
    return json.dumps(data, indent=1, default=str).encode("utf-8")


def versions() -> dict[str, Any]:
    """Python, system, and every installed package."""
    packages = {str(one.metadata["Name"]): one.version for one in metadata.distributions()}
    return {
        "trueflank": metadata.version("trueflank"),
        "python": sys.version,
        "system": shown(platform.platform()),
        "packages": dict(sorted(packages.items())),
    }


def secrets_of(site: SiteFile, path: Path, root: Path) -> Iterator[str]:
    """Every secret that the site file points to, or that the store keeps."""
    yield from _secrets_named(site.model_dump(mode="json"), path.parent)
    for place in (token_path(root), first_token_path(root)):
        yield from _secret_lines(place)
    notice = notice_of(root)
    if notice is not None:
        yield notice.token
    yield from (value for value in _account_hashes(root) if value)


def _account_hashes(root: Path) -> Iterator[str]:
    """Hashes of accounts are no secrets, and still nobody else's business."""
    try:
        kept = read_own(root / "service" / "users.json").decode("utf-8", "replace")
    except OSError:
        return
    yield from re.findall(r"\$argon2[^\"\s]+", kept)
    yield from re.findall(r"\b[0-9a-f]{64}\b", kept)


def _secrets_named(section: Mapping[str, Any], beside: Path) -> Iterator[str]:
    for key, value in section.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, Mapping):
                yield from _secrets_named(one, beside)
        if isinstance(value, str) and value and _POINTER.search(key):
            yield from _secret_lines(beside / value) if key.endswith("_file") else (os.environ.get(value, ""),)
        elif isinstance(value, str) and value and key in ("password", "key"):
            yield from _secret_lines(beside / value) if key == "key" else (value,)


def _secret_lines(place: Path) -> Iterator[str]:
    """A secret's file, whole and line by line; of an address its password as well."""
    try:
        text = read_own(place).decode("utf-8", "replace").strip()
    except OSError:
        return
    yield text
    yield from text.splitlines()
    yield from re.findall(r"//[^/@\s:]*:([^/@\s]+)@", text)


def _spellings(values: Iterator[str]) -> Iterator[bytes]:
    """As it is, and as JSON spells it."""
    for value in values:
        if len(value) >= 4:
            yield value.encode("utf-8")
            yield json.dumps(value)[1:-1].encode("ascii")
