"""The commands below `service`: a systemd unit that starts `serve` with the computer and restarts it when it dies."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from drivers.errors import ConfigError
from drivers.local.names import is_name
from gateway.cli.onward import next_step
from gateway.cli.options import load_site
from gateway.cli.show import echo

NAME = "trueflank"
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
    unit = _place(folder, user=user)
    text = unit_text([site.resolve() for site in sites], host=host, port=port, user=person)
    try:
        unit.parent.mkdir(parents=True, exist_ok=True)
        unit.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError("E-SERVICE-WRITE", str(unit), why=error.strerror or str(error)) from error
    echo(f"written: {unit}")
    _manager(("daemon-reload",), user=user)
    begun = _manager(("enable", "--now", NAME), user=user)
    if _manager(("status", "--no-pager", NAME), user=user) or begun:
        _not_running(user=user)


def status_command(user: UserOption = False, folder: FolderOption = None) -> None:
    """Say whether the unit is installed and how the service is; exit code 0 only while it runs."""
    unit = _place(folder, user=user)
    echo(f"{unit}: {'installed' if unit.is_file() else 'not installed'}")
    if not unit.is_file():
        next_step("service install SITE")
        raise typer.Exit(3)
    if _manager(("status", "--no-pager", NAME), user=user):
        _not_running(user=user)


def remove_command(user: UserOption = False, folder: FolderOption = None) -> None:
    """Stop the service and take its unit away; site files, runs and accounts stay."""
    unit = _place(folder, user=user)
    if unit.is_file():
        _manager(("disable", "--now", NAME), user=user)
        unit.unlink()
        _manager(("daemon-reload",), user=user)
    echo(f"{unit}: not installed")


def _not_running(*, user: bool) -> NoReturn:
    echo(f"the service does not run; its words: journalctl {'--user ' if user else ''}-u {NAME}", err=True)
    raise typer.Exit(3)


def _place(folder: Path | None, *, user: bool) -> Path:
    own = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "systemd" / "user"
    return (folder or (own if user else SYSTEM_UNITS)) / f"{NAME}.service"


def _manager(words: tuple[str, ...], *, user: bool) -> int:
    """Tell the service manager; where there is none, what would be told. Its exit code."""
    program = shutil.which("systemctl")
    shown = " ".join(("systemctl", *(("--user",) if user else ()), *words))
    if program is None:
        echo(f"no service manager here; on the machine's computer: {shown}")
        return 0
    echo(shown)
    call = (program, *(("--user",) if user else ()), *words)
    return subprocess.run(call, check=False).returncode  # noqa: S603 - the words are ours
