"""The commands `tables lint` and `tables diff` on compensation table files; no hardware is touched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers import registry
from drivers.errors import ConfigError, FileFormatError, TrueflankError
from drivers.message import Message
from drivers.tablefile import ArchiveMember, TableFile, TableFinding, TableMachine
from drivers.terms import spoken
from drivers.units import AxisUnit
from gateway.cli.options import JsonOption
from gateway.cli.output import echo, show_error, show_json

SEVERITY_WORDS = {"wrong": ("error", "red"), "doubtful": ("warning", "yellow"), "note": ("note", "")}
LARGEST_FILE = 500_000_000  # bytes: no archive of a control is larger
SEVERITIES = ("wrong", "doubtful", "note")


def table_format() -> Any:
    """The table file driver, by name."""
    return registry.load("sinumerik-tables", "table-file")()


def table_data(file: Path) -> bytes:
    """A table file as it is: text, or an NC archive. Raises ConfigError (E-CLI-READ)."""
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise ConfigError("E-CLI-READ", str(file), why=f"larger than {LARGEST_FILE // 1_000_000} MB")
        return file.read_bytes()
    except OSError as error:
        raise ConfigError("E-CLI-READ", str(file), why=str(error)) from error


def write_text(output: Path, text: str, *, force: bool, encoding: str = "utf-8") -> None:
    """Write a new file; an old one only with ``force``. Raises ConfigError (E-CLI-EXISTS, E-CLI-WRITE)."""
    try:
        with output.open("w" if force else "x", encoding=encoding, newline="\n") as file:
            file.write(text)
    except FileExistsError as error:
        raise ConfigError("E-CLI-EXISTS", str(output)) from error
    except OSError as error:
        raise ConfigError("E-CLI-WRITE", str(output), why=str(error)) from error


def parse_positions(words: Sequence[str], option: str) -> dict[str, float]:
    """AXIS=POSITION or POSITION alone (for every axis, key ""). Raises ConfigError (E-CLI-POSITION)."""
    found: dict[str, float] = {}
    for word in words:
        axis, _, text = word.rpartition("=")
        found[axis.strip().upper()] = parse_number(text, option)
    return found


def parse_number(text: str, option: str) -> float:
    """A finite number of an option. Raises ConfigError (E-CLI-POSITION)."""
    try:
        value = float(text)
    except ValueError as error:
        raise ConfigError("E-CLI-POSITION", option, text=text) from error
    if not -1e6 < value < 1e6:
        raise ConfigError("E-CLI-POSITION", option, text=text)
    return value


def parse_units(rotary: Sequence[str], linear: Sequence[str] = ()) -> Mapping[str, AxisUnit]:
    """The units that --rotary and --linear say. Raises ConfigError (E-CLI-BOTH-UNITS)."""
    turning, sliding = ({axis.upper() for axis in axes} for axes in (rotary, linear))
    if turning & sliding:
        raise ConfigError("E-CLI-BOTH-UNITS", "--rotary", axis=", ".join(sorted(turning & sliding)))
    return {**dict.fromkeys(turning, "deg"), **dict.fromkeys(sliding, "mm")}


def _members(driver: Any, data: bytes, where: str) -> tuple[ArchiveMember, ...]:
    """What an archive holds; nothing of one that is damaged: a finding says where."""
    try:
        found: tuple[ArchiveMember, ...] = driver.members(data, where)
    except FileFormatError:
        return ()
    return found


def show_findings(
    file: Path, findings: Sequence[TableFinding], *, as_json: bool, members: Sequence[ArchiveMember] = ()
) -> None:
    """The members of an archive, findings as lines, the gravest first, and their count; or as data."""
    counts = {kind: sum(one.severity == kind for one in findings) for kind in SEVERITIES}
    if as_json:
        records = [{"severity": one.severity, **one.error.as_record()} for one in findings]
        inside = [{"name": one.name, "folder": one.folder, "size": one.size} for one in members]
        show_json({"file": str(file), **counts, "findings": records, **({"members": inside} if inside else {})})
        return
    for member in members:
        echo(f"{member.size:10d}  {member.folder}{member.shown or member.name}")
    if members:
        echo(Message.of("S-TABLES-ARCHIVE", file=file, count=len(members)))
    for one in sorted(findings, key=lambda item: SEVERITIES.index(item.severity)):
        word, colour = SEVERITY_WORDS[one.severity]
        echo(f"{word}: {one.error}", colour=colour or None)
    told = ", ".join(
        f"{count} {SEVERITY_WORDS[kind][0]}{'s' * (count != 1)}" for kind, count in counts.items() if count
    )
    echo(f"{file}: {told or 'no findings'}")


def _read_both(paths: Sequence[Path], units: Mapping[str, AxisUnit]) -> list[TableFile]:
    """Both files; what the machine data of one say of the axes holds for the other too."""
    driver, data = table_format(), [table_data(path) for path in paths]
    files = [driver.read(one, str(path), units) for one, path in zip(data, paths, strict=True)]
    known = {**files[1].units, **files[0].units, **units}
    again = bool(known) and any(file.unknown for file in files)
    return [driver.read(one, str(path), known) for one, path in zip(data, paths, strict=True)] if again else files


def _show_difference(first: Path, second: Path, difference: Any) -> None:
    if difference.same:
        echo(Message.of("S-TABLES-SAME", first=first, second=second))
        return
    for path, labels in ((first, difference.only_first), (second, difference.only_second)):
        for label in labels:
            echo(f"only in {path}: {label}")
    for pair in difference.tables:
        _show_pair(pair)
    for setting in difference.settings:
        change = "" if setting.change is None else f" ({setting.change:+.4f} {setting.unit})"
        echo(f"{setting.name}: {_setting_value(setting.first)} -> {_setting_value(setting.second)}{change}")
    if difference.largest:
        label, position, change, unit = difference.largest
        echo(f"largest: {label} at {position:g}: {change:+.4f} {unit}")


def _show_pair(pair: Any) -> None:
    points = pair.points
    echo(Message.of("S-TABLES-DIFFER", label=pair.label, size=points.positions.size, count=pair.count))
    for name, one, two in pair.parameters:
        echo(f"  {name}: {one} -> {two}")
    for position, old, new, change in zip(points.positions, points.old, points.new, points.change, strict=True):
        echo(f"  {position:12g} {pair.input_unit}: {old:+10.4f} -> {new:+10.4f}  {change:+10.4f} {pair.unit}")


def _setting_value(value: object) -> str:
    return "not set" if value is None else str(value)


def _difference_record(first: Path, second: Path, difference: Any, notes: Sequence[str]) -> dict[str, Any]:
    largest = difference.largest
    return {
        "first": str(first),
        "second": str(second),
        "same": difference.same,
        "largest": dict(zip(("table", "position", "change", "unit"), largest, strict=True)) if largest else None,
        "only_first": difference.only_first,
        "only_second": difference.only_second,
        "tables": [_pair_record(pair) for pair in difference.tables],
        "settings": [
            {"name": one.name, "first": one.first, "second": one.second, "change": one.change, "unit": one.unit}
            for one in difference.settings
        ],
        "notes": list(notes),
    }


def _pair_record(pair: Any) -> dict[str, Any]:
    points = pair.points
    rows = zip(points.positions, points.old, points.new, points.change, strict=True)
    return {
        "table": pair.label,
        "unit": pair.unit,
        "input_unit": pair.input_unit,
        "points": pair.count,
        "parameters": [{"name": name, "first": one, "second": two} for name, one, two in pair.parameters],
        "differences": [
            {"position": float(at), "first": float(old), "second": float(new), "change": float(change)}
            for at, old, new, change in rows
        ],
    }


# ---- the commands

WORDS = spoken()


def lint_command(
    file: Annotated[Path, typer.Argument(help="Compensation table as text, or an NC archive.", show_default=False)],
    control: Annotated[str, typer.Option(help=f"Size limits of a control: {WORDS.controls}.")] = "",
    points: Annotated[
        int | None, typer.Option(min=0, help=f"Reserved {WORDS.own} points, {WORDS.own_reserve}.", show_default=False)
    ] = None,
    cross_points: Annotated[
        int | None,
        typer.Option(
            f"--{WORDS.cross_key}-points",
            min=0,
            help=f"Reserved {WORDS.cross} points, {WORDS.cross_reserve}.",
            show_default=False,
        ),
    ] = None,
    velocity: Annotated[
        float | None, typer.Option(min=0, help="Velocity of the input axis, mm/min or deg/min.", show_default=False)
    ] = None,
    reference: Annotated[
        list[str] | None, typer.Option(help="[AXIS=]POSITION where tables must be zero.", show_default=False)
    ] = None,
    rotary: Annotated[list[str] | None, typer.Option(help="An axis that is rotary.", show_default=False)] = None,
    linear: Annotated[list[str] | None, typer.Option(help="An axis that is linear.", show_default=False)] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Count warnings as errors.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Say everything that is wrong or doubtful in a compensation table file; exit code 7 when something is wrong."""
    from gateway.workflow.files.reading import refuse_tables

    known = TableMachine(
        control=control.upper().removesuffix("SL").strip(),
        own_points=points,
        cross_points=cross_points,
        velocity=velocity,
        references=parse_positions(reference or [], "--reference"),
        units=parse_units(rotary or [], linear or []),
    )
    refuse_tables(file)
    data, driver = table_data(file), table_format()
    findings = driver.findings(data, str(file), known)
    show_findings(file, findings, as_json=as_json, members=_members(driver, data, str(file)))
    if any(one.severity == "wrong" or (strict and one.severity == "doubtful") for one in findings):
        raise typer.Exit(7)


def diff_command(
    first: Annotated[Path, typer.Argument(help="Table file or back-up.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="The second file.", show_default=False)],
    rotary: Annotated[list[str] | None, typer.Option(help="An axis that is rotary.", show_default=False)] = None,
    linear: Annotated[list[str] | None, typer.Option(help="An axis that is linear.", show_default=False)] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare two table files as diff(1) does: exit code 0 the same, 1 different, 2 trouble."""
    from gateway.table.file_comparison import compare_files

    try:
        files = _read_both((first, second), parse_units(rotary or [], linear or []))
    except TrueflankError as error:
        show_error(error, as_json=as_json)
        raise typer.Exit(2) from error
    difference = compare_files(*files)
    if as_json:
        show_json(_difference_record(first, second, difference, [str(note) for file in files for note in file.notes]))
    else:
        _show_difference(first, second, difference)
        for path, file in zip((first, second), files, strict=True):
            for note in file.notes:
                echo(Message.of("S-TABLES-NOTE", path=path, note=note))
    if not difference.same:
        raise typer.Exit(1)
