"""`tables convert` for other controls and programs: tables and errors in their formats, both ways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import ConfigError, FileFormatError, TableError
from drivers.local.textfile import decode_text
from drivers.message import Message, words
from drivers.types.exchange import ErrorSet, ReadAs
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit
from gateway.cli.files.tables import table_data, table_format, write_text
from gateway.cli.options import open_run
from gateway.cli.output import echo, show_json
from gateway.table.limits import implausible_values

ZIPPED = b"PK\3\4"
"""How a workbook begins, whatever its name ends with."""
SHEETS = "cp1252"
"""What spreadsheet programs write where they say no encoding, and text is not UTF-8."""
ROUNDED = 1e-3  # um or arcsec: less is no rounding that anybody would see
TABLES, ERRORS, OWN = "table-exchange", "error-exchange", "tables"
WORDS = {TABLES: "compensation tables", ERRORS: Message.of("S-EXCHANGE-ERRORS")}


@dataclass(frozen=True, slots=True)
class ExchangeOptions:
    """What was typed: source and its format ("" a measured file or a run), target format, axis, form, output.

    ``simulated``: a double made the measured file; ``notes`` are what its readings leave in doubt; ``declared`` are the
    facts by name that the file of another control does not state.
    """

    source: Path
    origin: str
    to: str
    axis: str
    unit: AxisUnit
    form: str
    output: Path
    force: bool
    store: Path
    simulated: bool = False
    notes: tuple[str, ...] = ()
    declared: Mapping[str, Any] = field(default_factory=dict)


def is_exchange(name: str) -> bool:
    """Whether --to or --from names a format of another control or program, be it one that nobody has described."""
    unpublished = registry.load("unpublished-layouts", "unpublished")
    return name in unpublished or name in registry.known(TABLES) or name in registry.known(ERRORS)


def known_formats() -> str:
    """Names of all formats, for help and errors."""
    return ", ".join([*registry.known(TABLES), *registry.known(ERRORS)])


def convert_exchange(wish: ExchangeOptions, measured: CompensationTable | None, *, as_json: bool) -> None:
    """Write the file, read it back and say what differs; ``measured`` where the source is a result file.

    Raises ConfigError (E-EXCHANGE-NAME, E-EXCHANGE-KIND, E-CLI-EXISTS ...), FileFormatError, TableError.
    """
    role = _role(wish.to)
    from gateway.workflow.run.stages import DOUBLE

    if wish.origin and DOUBLE.upper().encode() in table_data(wish.source):
        wish = replace(wish, simulated=True)
    content = (measured,) if measured is not None else _content(wish)
    found = ERRORS if isinstance(content, ErrorSet) else TABLES
    if found != role:
        raise ConfigError(
            "E-EXCHANGE-KIND", str(wish.source), source=wish.source.name, found=WORDS[found], to=wish.to,
            wanted=WORDS[role],
        )  # fmt: skip
    if isinstance(content, ErrorSet):
        notes: tuple[str, ...] = ()
        text, rows, largest = _errors(wish, content)
    else:
        notes = (*wish.notes, *implausible_values(content))
        text, rows, largest = _tables(wish, content, _form_of(wish))
    write_text(wish.output, text, force=wish.force)
    if as_json:
        told = {"rows": rows, "rounding": largest, "notes": list(notes)}
        show_json({"file": str(wish.output), "format": wish.to, **told})
        return
    unit = (
        Message.of("S-UNIT-UM-ARCSEC")
        if isinstance(content, ErrorSet)
        else {"um": "µm", "arcsec": "arcsec"}[content[0].deviation_unit]
    )
    echo(Message.of("S-EXCHANGE-DONE", output=wish.output, to=wish.to, rows=rows, largest=largest, unit=unit))
    for note in notes:
        echo(Message.of("S-EXCHANGE-NOTE", note=note), colour="yellow")
    if not isinstance(content, ErrorSet) and largest > ROUNDED:
        _finer(wish, content, largest, unit)
    echo(Message.of("S-EXCHANGE-COMMENTS"))


def _finer(wish: ExchangeOptions, tables: Sequence[CompensationTable], largest: float, unit: str | Message) -> None:
    """Say that the difference is the rounding of the form, and which form of the same format keeps more."""
    forms = registry.load(wish.to, TABLES)().forms
    others = [(one, _tables(wish, tables, one)[2]) for one in forms if one not in ("", wish.form or forms[0])]
    echo(Message.of("S-EXCHANGE-FORM", to=wish.to, form=wish.form or forms[0]))
    for form, left in others:
        if left < largest:
            echo(Message.of("S-EXCHANGE-WITH-FORM", form=form, left=left, unit=unit))


def _role(name: str) -> str:
    for role in (TABLES, ERRORS):
        if name in registry.known(role):
            return role
    unpublished = registry.load("unpublished-layouts", "unpublished")
    if name in unpublished:
        raise ConfigError(unpublished[name], name, control=name)
    raise ConfigError("E-EXCHANGE-NAME", "--to", name=name, known=known_formats())


def _content(wish: ExchangeOptions) -> tuple[CompensationTable, ...] | ErrorSet:
    """What the source holds: a file of --from, or the errors of a run."""
    if wish.origin == OWN:
        tables = table_format().read(table_data(wish.source), str(wish.source)).tables
        return _of_axis(registry.load("paired-tables", "table-pairing")(tables), wish)
    if wish.origin:
        role = _role(wish.origin)
        driver = registry.load(wish.origin, role)()
        text = _text(wish.source)
        if role == ERRORS:
            errors: ErrorSet = driver.read(text, str(wish.source))
            return errors
        return _of_axis(_read(driver, text, wish), wish)
    from gateway.store import Store
    from gateway.workflow.errors21.error_file import errors_of_run

    return errors_of_run(open_run(Store(wish.store), str(wish.source), "errors"))


def _read(driver: Any, text: str, wish: ExchangeOptions) -> tuple[CompensationTable, ...]:
    form = wish.form if wish.form in driver.forms else driver.forms[0]
    found: tuple[CompensationTable, ...] = driver.read(
        text, str(wish.source), ReadAs(wish.axis, wish.unit, form, wish.declared)
    )
    return found


def _form_of(wish: ExchangeOptions) -> str:
    """The form to write: one word may name the form of the file that is read instead."""
    both = [registry.load(name, TABLES)().forms for name in (wish.origin, wish.to) if name in registry.known(TABLES)]
    return "" if len(both) == 2 and wish.form in both[0] and wish.form not in both[1] else wish.form


def _text(path: Path) -> str:
    """Text in whatever encoding a spreadsheet program saves. Raises ConfigError (E-CLI-READ), FileFormatError."""
    data = table_data(path)
    text = decode_text(data, SHEETS, str(path)) if not data.startswith(ZIPPED) else "\0"
    if "\0" in text:
        raise FileFormatError("E-EXCHANGE-NO-TEXT", str(path))
    return text


def _of_axis(tables: Sequence[CompensationTable], wish: ExchangeOptions) -> tuple[CompensationTable, ...]:
    names = sorted({table.output_axis for table in tables})
    if not wish.axis and (len(names) > 1 or "" in names):
        raise ConfigError("E-CLI-AXIS", str(wish.source))
    found = tuple(table for table in tables if table.output_axis == (wish.axis or names[0]))
    if not found:
        raise ConfigError("E-EXCHANGE-AXIS", str(wish.source), axis=wish.axis, known=", ".join(names) or "none")
    return found


def _comments(wish: ExchangeOptions) -> list[str]:
    from gateway.workflow.run.stages import SAID

    return [*((SAID,) if wish.simulated else ()), words("S-MADE-FROM", name=wish.source.name)]


def _tables(wish: ExchangeOptions, tables: Sequence[CompensationTable], form: str) -> tuple[str, int, float]:
    """Text, count of points and the largest difference after reading back, um or arcsec; form "" is the usual one."""
    driver = registry.load(wish.to, TABLES)()
    form = form or driver.forms[0]
    if form not in driver.forms:
        known = ", ".join(driver.forms)
        raise ConfigError("E-EXCHANGE-FORM", "--form", name=wish.to, form=form, known=known)
    text = driver.text(tables, form, _comments(wish))
    first = tables[0]
    # What the format cannot state (position of the first value, axis of the positions) is what was written.
    declared = {"start": float(first.positions[0]), "input": first.input_axis}
    back = driver.read(text, str(wish.output), ReadAs(first.output_axis, first.output_unit, form, declared))
    pairs = list(zip(_in_order(tables), _in_order(back), strict=True))
    if any(_shape(one) != _shape(other) for one, other in pairs):
        raise TableError("E-EXCHANGE-COUNT", wish.to, rows=len(back), least=len(tables), most=len(tables))
    apart = (abs(a - b) for one, other in pairs for a, b in zip(_values(one), _values(other), strict=True))
    return text, sum(len(table.deviations) for table in tables), max(apart)


def _in_order(tables: Sequence[CompensationTable]) -> list[CompensationTable]:
    return sorted(tables, key=lambda table: table.kind)


def _shape(table: CompensationTable) -> tuple[str, int]:
    return table.kind, len(table.deviations)


def _values(table: CompensationTable) -> tuple[float, ...]:
    return table.deviations + (table.reverse or table.deviations)


def _errors(wish: ExchangeOptions, errors: ErrorSet) -> tuple[str, int, float]:
    driver = registry.load(wish.to, ERRORS)()
    text = driver.text(errors, [*_comments(wish), *errors.notes])
    back: ErrorSet = driver.read(text, str(wish.output))
    again = {curve.name: curve for curve in back.curves}
    apart = [float(abs(again[one.name].values - one.values).max()) for one in errors.curves]
    apart += [abs(back.locations[name] - value) for name, value in errors.locations.items()]
    apart += [float(abs(a.values - b.values).max()) for a, b in zip(errors.fields, back.fields, strict=True)]
    points = sum(one.values.size for one in errors.curves) + sum(one.values.size for one in errors.fields)
    return text, points + len(errors.locations), max(apart, default=0.0)
