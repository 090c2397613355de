"""TableFile -> text, in each form in which the control or a service engineer keeps compensation data.

Forms by name: "program" (part program, no header), "ini" (%_N_AX_EEC_INI or %_N_NC_CEC_INI, CHANDATA), "axis-ini"
(%_N_AXn_EEC_INI), "archive" (ASCII archive with ;$PATH=), "numbered" (block numbers, machine data by their own).
Values first, then parameters, as in the manual's example (K3, p. 242), or the other way round. No check sums
are written: how the control computes them is not public.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import groupby
from typing import Literal

from drivers.errors import ConfigError
from drivers.sinumerik.tablefile import tables
from drivers.sinumerik.tablefile.grammar import VARIABLES, grid_text, value_text
from drivers.tablefile import TableFile
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable

Values = Callable[[CompensationTable], Iterable[Decimal]]
_AXIS_NUMBER = re.compile(r"AX(\d{1,2})")


@dataclass(frozen=True, slots=True)
class TextForm:
    """How a text is laid out. ``comments`` stand before the first assignment; ``name`` is the archive's file."""

    wrapper: Literal["program", "ini", "axis-ini", "archive"] = "program"
    order: Literal["values-first", "parameters-first"] = "values-first"
    axes: Literal["parentheses", "quotes", "bare"] = "parentheses"
    numbered: bool = False
    end: Literal["M17", "M30", "M0"] = "M17"
    channel: int = 1
    name: str = "TFTABLES"
    comments: tuple[str, ...] = ()


FORMS: dict[str, TextForm] = {
    "program": TextForm(),
    "ini": TextForm(wrapper="ini"),
    "axis-ini": TextForm(wrapper="axis-ini"),
    "archive": TextForm(wrapper="archive"),
    "numbered": TextForm(numbered=True),
}


def find_form(name: str, comments: Iterable[str] = ()) -> TextForm:
    """A form by its name. Raises ConfigError (E-TABLE-FORM)."""
    if name not in FORMS:
        raise ConfigError("E-TABLE-FORM", "form", form=name, known=", ".join(FORMS))
    return replace(FORMS[name], comments=tuple(comments))


def write_tables(listed: Iterable[CompensationTable], proofs: Iterable[SignProof] = (), *, header: bool = False) -> str:
    """The canonical text of tables for a machine whose CEC sign is proven; EEC needs no proof.

    Raises TableError (E-TABLE-NO-PROOF, E-TABLE-SIGN), ValueOutOfRange (E-TABLE-FINITE).
    """
    known = {(proof.kind, proof.output_axis): proof for proof in proofs}

    def values(table: CompensationTable) -> Iterable[Decimal]:
        return tables.stored_values(table, known.get((table.kind, table.output_axis)))

    return _text(TableFile(tuple(listed)), FORMS["ini" if header else "program"], values)


def render_file(content: TableFile, form: TextForm = FORMS["program"]) -> str:
    """The canonical text of a file as it was read, or made offline: CEC values carry the EEC convention, unproven.

    ``reader.read`` of the text gives the content back. Raises ValueOutOfRange (E-TABLE-FINITE), ConfigError
    (E-TABLE-FORM-AXIS) if the form needs an axis number that the tables' axis does not have.
    """
    return _text(content, form, tables.stored_as_read)


def _text(content: TableFile, form: TextForm, values: Values) -> str:
    sections = _sections(content, form)
    lines: list[str] = []
    for place, (opening, listed) in enumerate(sections):
        settings = content.settings if place == len(sections) - 1 else {}
        body = [line for table in listed for line in _table(table, form, values)] + list(_settings(settings))
        comments = [f"; {comment}" for comment in form.comments] if place == 0 else []
        lines += [*opening, *comments, *(_numbered(body) if form.numbered else body), form.end]
    return "\n".join([*lines, ""])


def _sections(content: TableFile, form: TextForm) -> list[tuple[list[str], list[CompensationTable]]]:
    """One file of an ASCII transfer for each run of tables with the same header; one only in other forms."""
    if form.wrapper == "program":
        return [([], list(content.tables))]
    if form.wrapper == "archive":
        return [([f"%_N_{form.name}_SPF", ";$PATH=/_N_SPF_DIR"], list(content.tables))]
    channel = f"CHANDATA({form.channel})"
    if not content.tables:
        return [([f"%_N_{form.name}_INI", channel], [])]
    runs = groupby(content.tables, key=lambda table: _header(table, form))
    return [([header, channel], list(run)) for header, run in runs]


def _header(table: CompensationTable, form: TextForm) -> str:
    if table.kind == "cross":
        return "%_N_NC_CEC_INI"
    if form.wrapper == "ini":
        return "%_N_AX_EEC_INI"
    number = _AXIS_NUMBER.fullmatch(table.output_axis)
    if number is None:
        raise ConfigError("E-TABLE-FORM-AXIS", "form", form=form.wrapper, axis=table.output_axis)
    return f"%_N_AX{number[1]}_EEC_INI"


def _table(table: CompensationTable, form: TextForm, values: Values) -> list[str]:
    points = tables.point_lines(table, values(table))
    parameters = [_axis_form(line, form) for line in tables.parameter_lines(table)]
    return points + parameters if form.order == "values-first" else parameters + points


def _axis_form(line: str, form: TextForm) -> str:
    name, _, value = line.partition("=")
    if form.axes == "parentheses" or not value.startswith("("):
        return line
    axis = value.strip("()")
    return f'{name}="{axis}"' if form.axes == "quotes" else f"{name}={axis}"


def _settings(settings: Mapping[str, Decimal]) -> Iterator[str]:
    for place, value in settings.items():
        shape = VARIABLES[place.partition("[")[0]].shape
        whole = shape in ("integer", "flag")
        text = f"{value:f}".partition(".")[0] if whole else _setting_text(value, shape)
        yield f"{place}={text}"


def _setting_text(value: Decimal, shape: str) -> str:
    return grid_text(float(value)) if shape == "position" else value_text(value)


def _numbered(body: Iterable[str]) -> list[str]:
    """N10, N20, ...; a machine or setting datum has its own number, as back-ups print it (MD11230)."""
    out = []
    for place, line in enumerate(body, start=1):
        number = VARIABLES[line.partition("[")[0]].number or 10 * place
        out.append(f"N{number} {line}")
    return out
