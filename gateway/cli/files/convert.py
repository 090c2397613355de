"""`tables convert`: measured files, tables and errors into files that a control or another program reads."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers import registry
from drivers.errors import ConfigError, words
from drivers.message import digits, term
from drivers.tablefile import TableMachine
from drivers.terms import TableKind, spoken
from drivers.units import AxisUnit
from gateway.cli.files.exchange import TABLES, ExchangeOptions, convert_exchange, is_exchange, known_formats
from gateway.cli.files.tables import parse_number, show_findings, table_format, write_text
from gateway.cli.options import (
    AcceptOption,
    AskOption,
    ColumnOption,
    DateComparison,
    JsonOption,
    StatementOption,
    StoreOption,
    accepted_doubts,
)
from gateway.cli.output import echo, show_json

WORDS = spoken()


def convert_command(
    result: Annotated[
        Path, typer.Argument(help="Measured result file, a file in the format of --from, or a run.", show_default=False)
    ],
    to: Annotated[
        str,
        typer.Option(
            help=f"{WORDS.own_key} (mean of both directions), {WORDS.cross_key} (a pair by direction), linuxcnc, "
            "twincat, heidenhain, axeserr, aerotech, table-csv; errors of a machine: isg-volumetric, "
            "etalon-exchange, error-csv."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help=f"File to write: {WORDS.suffixes}.")],
    axis: Annotated[str, typer.Option(help=f"Machine axis name, {WORDS.axis_name}.", show_default=False)] = "",
    origin: Annotated[
        str,
        typer.Option(
            "--from",
            help="Format of the file: tables (of the control), fanuc, or one of the names of --to.",
            show_default=False,
        ),
    ] = "",
    reference: Annotated[
        float | None, typer.Option(help="Machine position where the table must be zero.", show_default=False)
    ] = None,
    datum: Annotated[
        list[str] | None,
        typer.Option(help="FILE=MACHINE position; twice if their directions are opposite.", show_default=False),
    ] = None,
    minimum: Annotated[float | None, typer.Option("--min", help="First point.", show_default=False)] = None,
    maximum: Annotated[float | None, typer.Option("--max", help="Last point.", show_default=False)] = None,
    step: Annotated[float | None, typer.Option(help="Distance of the points.", show_default=False)] = None,
    modulo: Annotated[bool, typer.Option("--modulo", help="Endless rotary axis, 0 to 360 deg.")] = False,
    unit: Annotated[str, typer.Option(help="Unit of the deviations, if the file does not state it.")] = "",
    column: ColumnOption = None,
    index: Annotated[
        int, typer.Option(min=0, help=f"Encoder ({WORDS.own_key}: 0 or 1) or first table number ({WORDS.cross_key}).")
    ] = 0,
    form: Annotated[
        str,
        typer.Option(
            help="program, ini, axis-ini, archive or numbered; linuxcnc: trims or positions; twincat: whole or real; "
            "fanuc, heidenhain: error or correction; aerotech: mean."
        ),
    ] = "",
    accept_doubt: AcceptOption = None,
    accept: StatementOption = None,
    ask: AskOption = True,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Make a table file of a measured result file (the datum must be given), or turn tables and errors into others."""

    wish = ConversionOptions(
        result=result,
        to=to,
        axis=axis,
        reference=reference,
        datum=tuple(datum or ()),
        minimum=minimum,
        maximum=maximum,
        step=step,
        modulo=modulo,
        unit=unit,
        index=index,
        form=form,
        output=output,
        force=force,
        origin=origin,
        store=store,
        accepted=accepted_doubts(accept_doubt),
        columns=tuple(column or ()),
        compared=DateComparison(tuple(accept or ()), ask and not as_json),
    )
    convert_file(wish, as_json=as_json)


# ---- a table file from a measured result file, once its datum is known

PLAIN_AXIS, ROTARY = re.compile(r"([ABCUVWXYZ])[0-9]*"), "ABC"
"""Names that say by their letter (ISO 841) what an axis is; AX1 and others say nothing."""
FORMS = {".ini": "ini", ".arc": "archive"}


@dataclass(frozen=True, slots=True)
class ConversionOptions:
    """What was typed: result file, layer, axis, datum words, grid, output."""

    result: Path
    to: str
    axis: str
    reference: float | None
    datum: tuple[str, ...]
    minimum: float | None
    maximum: float | None
    step: float | None
    modulo: bool
    unit: str
    index: int
    form: str
    output: Path
    force: bool
    origin: str = ""
    store: Path = Path("runs")
    accepted: Mapping[str, str] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    compared: Any = None


def convert_file(wish: ConversionOptions, *, as_json: bool) -> None:
    """Write the table file and say what its reader must know; nothing is written unless all is known and right."""
    from gateway.evaluate.behaviour import doubts
    from gateway.table.conversion import convert

    if is_exchange(wish.to) or wish.origin:
        _exchange(wish, as_json=as_json)
        return
    _layer(wish.to)
    if not wish.axis:
        raise ConfigError("E-CLI-AXIS", str(wish.result))
    measured, notes = _read(wish)
    request = _request(wish, _complete(wish, measured))
    made = convert(measured, request)
    text = table_format().write(made.tables, wish.form or _form(wish.output), _comments(wish, measured))
    known = TableMachine(references={request.axis: request.reference}, units={request.axis: measured.axis_unit})
    findings = table_format().findings(text, str(wish.output), known)
    wrong = any(one.severity == "wrong" for one in findings)
    if not wrong:
        write_text(wish.output, text, force=wish.force, encoding="ascii")
    told = [
        *map(str, measured.warnings),
        *notes,
        *_conversion_doubts(measured),
        *(str(one.message) for one in made.findings),
    ]
    if as_json:
        records = [{"severity": one.severity, **one.error.as_record()} for one in findings]
        data = {"file": str(wish.output), "written": not wrong, "notes": told, "findings": records}
        show_json({**data, "doubts": doubts.as_data(measured.doubts)})
    else:
        _show_conversion(made, told)
        show_findings(wish.output, findings, as_json=False)
    if wrong:
        raise typer.Exit(7)


def _read(wish: ConversionOptions) -> tuple[Any, tuple[str, ...]]:
    """The readings, their doubts settled, by what is said now or was said before in the same store; and notes.

    Readings out of line are left out, as in the fit of a run; the doubts name them. Raises InDoubt (E-DOUBT-OPEN): no
    table comes of readings in doubt.
    """
    from gateway.cli.files.positioning import accepted_of
    from gateway.evaluate.behaviour.doubts import demand_settled, with_doubts
    from gateway.evaluate.behaviour.repetitions import consistent_readings
    from gateway.store import Maps
    from gateway.workflow.files.headers import columns_of
    from gateway.workflow.files.reading import ReadOptions, read_measured

    content, said = read_measured(
        wish.result, ReadOptions(wish.unit, columns=columns_of(wish.columns) or None), Maps(wish.store)
    )
    notes = (*map(str, said), *accepted_of((content,), wish.result, wish.compared, wish.store))
    measured = with_doubts(content, wish.accepted, modulo=wish.modulo)
    demand_settled(measured.doubts, str(wish.result))
    _check_kind(wish, measured)
    return replace(measured, deviations=consistent_readings(measured.targets, measured.deviations)), notes


def _check_kind(wish: ConversionOptions, measured: Any) -> None:
    """Raise ConfigError (E-CLI-AXIS-UNIT) where an axis by its letter turns, and the file holds lengths, or reverse."""
    found = PLAIN_AXIS.fullmatch(wish.axis.strip().upper())
    wanted = "deg" if found and found[1] in ROTARY else "mm"
    if found and wanted != measured.axis_unit:
        fields = {"found": measured.axis_unit, "wanted": wanted, "axis": wish.axis.strip()}
        raise ConfigError("E-CLI-AXIS-UNIT", str(wish.result), **fields)


def _conversion_doubts(measured: Any) -> tuple[str, ...]:
    """The doubts that concern whoever uses a table, and which readings it leaves out."""
    from gateway.evaluate.behaviour import doubts

    found = doubts.notable_doubts(measured.doubts, scatter=True)
    left_out = (words("S-EVAL-OUT-LEFT"),) if any(one.code in doubts.SCATTER for one in found) else ()
    return (*doubts.describe_doubts(found), *left_out)


def _exchange(wish: ConversionOptions, *, as_json: bool) -> None:
    """A measured file, a table file, a file of another control or a run into a format of another control."""
    unit: AxisUnit = "deg" if wish.axis.strip().upper()[:1] in ("A", "B", "C") else "mm"
    asked = ExchangeOptions(
        source=wish.result,
        origin=wish.origin,
        to=wish.to,
        axis=wish.axis.strip().upper(),
        unit=unit,
        form=wish.form,
        output=wish.output,
        force=wish.force,
        store=wish.store,
        declared=_declared(wish.columns) if wish.origin else {},
    )
    from_file = not wish.origin and wish.to in registry.known(TABLES)
    if not from_file:
        convert_exchange(asked, None, as_json=as_json)
        return
    table, simulated, notes = _measured_table(wish)
    convert_exchange(replace(asked, simulated=simulated, notes=notes), table, as_json=as_json)


def _declared(columns: tuple[str, ...]) -> Mapping[str, Any]:
    """Facts that the file of another control does not state, from NAME=VALUE words."""
    from gateway.workflow.files.headers import columns_of

    return columns_of(columns)


def _measured_table(wish: ConversionOptions) -> tuple[Any, bool, tuple[str, ...]]:
    """The table of a measured file, at its own targets and with a curve for each direction; of a double?; and notes."""
    from gateway.table.conversion import convert_as_measured, datum_of
    from gateway.workflow.run.stages import simulated_set

    if not wish.axis:
        raise ConfigError("E-CLI-AXIS", str(wish.result))
    measured, notes = _read(wish)
    reference = _complete(wish, measured)
    datum = datum_of([_pair(word) for word in wish.datum])
    table = convert_as_measured(measured, wish.axis.strip().upper(), reference, datum)
    return table, simulated_set(measured), (*map(str, measured.warnings), *notes, *_conversion_doubts(measured))


def _request(wish: ConversionOptions, reference: float) -> Any:
    from gateway.table.conversion import TableRequest, datum_of

    return TableRequest(
        to=_layer(wish.to),
        axis=wish.axis.strip().upper(),
        reference=reference,
        datum=datum_of([_pair(word) for word in wish.datum]),
        minimum=wish.minimum,
        maximum=wish.maximum,
        step=wish.step,
        modulo=wish.modulo,
        index=wish.index,
    )


def _complete(wish: ConversionOptions, measured: Any) -> float:
    """The reference, once reference and datum are given. Raises ConfigError (E-CLI-DATUM) saying what is needed."""
    if wish.reference is None or not wish.datum:
        low, high = float(measured.targets[0]), float(measured.targets[-1])
        missing = [
            name for name, given in (("--reference", wish.reference), ("--datum", wish.datum or None)) if given is None
        ]
        raise ConfigError(
            "E-CLI-DATUM",
            str(wish.result),
            missing=" and ".join(missing),
            low=digits(low, 6),
            high=digits(high, 6),
            unit=measured.axis_unit,
        )
    return parse_number(str(wish.reference), "--reference")


def _layer(to: str) -> TableKind:
    kinds: dict[str, TableKind] = {spoken().own_key: "axis", spoken().cross_key: "cross"}
    if to.lower() not in kinds:
        raise ConfigError("E-CLI-LAYER", "--to", to=to, known=", ".join((*kinds, known_formats())))
    return kinds[to.lower()]


def _pair(word: str) -> tuple[float, float]:
    file, mark, machine = word.partition("=")
    if not mark:
        raise ConfigError("E-CLI-POSITION", "--datum", text=word)
    return parse_number(file, "--datum"), parse_number(machine, "--datum")


def _form(output: Path) -> str:
    return FORMS.get(output.suffix.lower(), "program")


def _comments(wish: ConversionOptions, measured: Any) -> list[str]:
    """What stands in the file for its next reader; the control takes plain ASCII."""
    from gateway.workflow.run.stages import SAID, simulated_set

    datum = ", ".join(wish.datum)
    lines = [
        *((SAID,) if simulated_set(measured) else ()),
        words("S-MADE-FROM", name=wish.result.name),
        *(f"doubt {one.code} accepted: {one.settled}" for one in measured.doubts if one.settled),
        words("S-CONVERT-DATUM", datum=datum, reference=wish.reference),
        words("S-CONVERT-REPLACES"),
    ]
    if wish.to.lower() == spoken().cross_key:
        lines += [str(term(spoken().sign_doubt))]
        lines += [words("S-CONVERT-PROVE")]
    return ["".join(char if " " <= char <= "~" else "?" for char in line)[:180] for line in lines]


def _show_conversion(made: Any, told: list[str]) -> None:
    for table in made.tables:
        way = {0: "both directions", 1: "+ direction", -1: "- direction"}[table.direction]
        largest = max(abs(value) for value in table.deviations)
        grid = f"{table.minimum:g} .. {table.maximum:g} step {table.step:g} {table.input_unit}"
        echo(
            f"{spoken().kind(table.kind)} {table.name}, {way}: {len(table.deviations)} points, {grid}, "
            f"largest {largest:.3f} {table.deviation_unit}"
        )
    for line in told:
        echo(f"note: {line}")
