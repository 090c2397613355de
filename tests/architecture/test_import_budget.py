"""What a command loads: modules, records and libraries, counted in processes of their own.

A command that reads one file answers at once only while it loads nothing that pushes, borrows devices or draws. The
limits are a tenth above what is needed today; whoever passes one asks first whether the import is needed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RTL = ROOT / "tests" / "golden" / "files" / "basic.rtl"
SITE = ROOT / "examples" / "sites" / "files-only.toml"
GRINDER = ROOT / "examples" / "sites" / "opcua-grinder.toml"
OURS = ("gateway", "drivers", "simulators", "trueflank")
HEAVY = ("asyncua", "pymodbus", "matplotlib", "pandas", "SALib", "sqlalchemy", "fastapi", "scipy.stats", "dask")
MOST_OF_OTHERS = 470
PUSHES = ("gateway.push", "gateway.audit", "gateway.broker", "gateway.daemon", "gateway.web", "gateway.supervisor")

COUNT = """
import contextlib, dataclasses, io, json, sys
made = 0
process = dataclasses._process_class
def counted(*given, **named):
    global made
    made += 1
    return process(*given, **named)
dataclasses._process_class = counted
sys.argv = ["trueflank", *json.loads(sys.argv[1])]
from gateway.cli import app
with contextlib.redirect_stdout(io.StringIO()):
    try:
        app(standalone_mode=False)
    except BaseException as error:
        if getattr(error, "code", getattr(error, "exit_code", None)) != 0:
            print(repr(error), file=sys.stderr)
print(json.dumps({"modules": sorted(sys.modules), "records": made}), file=sys.__stdout__)
"""


def loaded(folder: Path, *words: str) -> tuple[list[str], int, str]:
    """Names of all modules after a command, how many records were made, and what it said went wrong."""
    done = subprocess.run(
        [sys.executable, "-c", COUNT, json.dumps(words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    return found["modules"], found["records"], done.stderr


@pytest.mark.parametrize(
    ("words", "most_ours", "most_records", "never"),
    [
        (("--help",), 17, 13, (*HEAVY, *PUSHES, "numpy", "pydantic", "asyncio")),
        (("evaluate", str(RTL)), 100, 135, (*HEAVY, *PUSHES, "asyncio", "gateway.config", "gateway.report")),
        (("runs", "list"), 38, 80, (*HEAVY, *PUSHES, "asyncio", "gateway.config")),
        (("check", str(SITE)), 134, 168, (*HEAVY, *PUSHES, "scipy.special")),
    ],
)
def test_a_command_loads_what_it_needs(
    tmp_path: Path, words: tuple[str, ...], most_ours: int, most_records: int, never: tuple[str, ...]
) -> None:
    judge(tmp_path, words, most_ours=most_ours, most_records=most_records, never=never)


def test_the_check_of_a_site_that_grinds_loads_no_push_and_no_scipy(tmp_path: Path) -> None:
    """The plan of its part and the program for it are made, with nothing of what sends it."""
    site = tmp_path / "site.toml"
    gears = str(ROOT / "examples" / "gears")
    site.write_text(GRINDER.read_text(encoding="utf-8").replace("../gears", gears), encoding="utf-8")
    (tmp_path / "password.txt").write_text("secret\n", encoding="utf-8")
    (tmp_path / "password.txt").chmod(0o600)
    (tmp_path / "control.der").write_bytes(b"\x30\x82")
    never = (*HEAVY, *PUSHES, "scipy.special", "scipy.linalg", "numpy.f2py")
    judge(tmp_path, ("check", str(site)), most_ours=195, most_records=274, never=never)


def judge(folder: Path, words: tuple[str, ...], *, most_ours: int, most_records: int, never: tuple[str, ...]) -> None:
    """Compare what a command loads with its budget."""
    modules, records, said = loaded(folder, *words)
    ours = [name for name in modules if name.split(".")[0] in OURS]
    found = [one for one in never if one in modules]
    assert not found, f"{words[0]} loads {found}"
    assert len(ours) <= most_ours, f"{words[0]} loads {len(ours)} modules of ours"
    assert records <= most_records, f"{words[0]} makes {records} records"
    assert len(modules) <= most_ours + MOST_OF_OTHERS, f"{words[0]} loads {len(modules)} modules"
    assert not said, said
