"""The command `day`: a folder of one calibration day to error model, forecast of the tooth and calibration report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError, catalogue, words
from drivers.message import Message, fixed, prose
from gateway.cli.next_steps import next_command, show_next
from gateway.cli.options import JsonOption, load_site
from gateway.cli.output import echo, echo_folded, show_json, show_table
from gateway.cli.progress import progress
from gateway.cli.signals import run_to_end
from gateway.workflow.run.outcome import of_verdicts

YES, NO = ("yes", "y", "ja", "j", "是"), ("no", "n", "nein", "否")
ACCEPT = "accept "
NUMBERS = {"datum": "W-DAY-NUMBER", "material_degc": "W-DAY-NUMBER", "park": "W-DAY-NUMBER", "own_angle": "W-DAY-ANGLE"}


def day_command(
    folder: Annotated[Path, typer.Argument(help="Folder with the files of one calibration day.", show_default=False)],
    site: Annotated[Path, typer.Option(help="Site file of the machine (TOML).", show_default=False)],
    answers: Annotated[
        Path | None, typer.Option(help="File of answers; default: next to the folder.", show_default=False)
    ] = None,
    ask: Annotated[bool, typer.Option("--ask/--no-ask", help="Ask for facts missing in the files, or refuse.")] = True,
    connect: Annotated[bool, typer.Option("--connect", help="Read the control's tables: a proposal to push.")] = False,
    language: Annotated[str, typer.Option(help="en, de or zh; default: the site file's language.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Turn the files of a calibration day into set-ups, error model, plan for the tooth and calibration report."""
    from drivers.clock import LoopClock
    from gateway.store import Maps
    from gateway.workflow.day.folder import DayFolder, answers_path, read_answers
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    said = read_answers(answers or answers_path(folder))
    gathering = DayFolder(folder, tree.site.name, Maps(store_of(tree, site).root), LoopClock().utc)
    spoken = language or tree.report.language
    sorted_day, said = _answer_questions(gathering, tree, said, spoken if ask and not as_json else "")
    if not as_json:
        _tell_files(sorted_day)
    if not sorted_day.setups:
        raise ConfigError("E-DAY-NO-RESULTS", str(folder), known=", ".join(axis.name for axis in tree.axes))
    _process_day(sorted_day, gathering, said, site=site, connect=connect, language=spoken, as_json=as_json)


# ---------------------------------------------------------------------------------------------------- the questions


def _answer_questions(gathering: Any, site: Any, said: Any, language: str) -> tuple[Any, Any]:
    """Ask until nothing is open; without a language nobody is asked. Raises ConfigError (E-DAY-OPEN)."""
    from drivers.clock import LoopClock
    from gateway.workflow.day.folder import write_answers
    from gateway.workflow.day.sorting import sort_day

    while True:
        found = sort_day(gathering.files(said), site, said, LoopClock().utc().date())
        needed = [one for one in found.open if not one.optional]
        if not found.open or not (needed or language):
            return found, said
        if not language:
            raise _refusal(needed, said)
        one = (needed or found.open)[0]
        said = _with_answer(said, one, _answer(one, language, found.open, said))
        write_answers(said)


def _with_answer(said: Any, one: Any, value: Any) -> Any:
    """The answers with one more; a statement that does not belong here leaves its files out."""
    if not one.key.startswith(ACCEPT):
        # Whoever does not answer for a doubt leaves the file out.
        return said.plus(one.place, "use" if value is False else one.key, value)
    if value:
        known = said.said.get("all", {}).get("accept", [])
        return said.plus("all", "accept", [*known, one.key.removeprefix(ACCEPT)])
    for name in one.fields["files"]:
        said = said.plus(f"files.{name}", "use", value)
    return said


def _answer(one: Any, language: str, questions: Any, said: Any) -> Any:
    told = {**catalogue(), **catalogue(language)}
    text, fields = told[one.code], _fields(one, told["W-FACTS-SITE"]["what"])
    echo(f"\n{text['what'].format_map(fields)}", bold=True)
    echo_folded(f"  {text['do'].format_map(fields)}", 2)
    if one.choices:
        echo(f"  ({', '.join(one.choices)})")
    while True:
        try:
            typed = str(
                typer.prompt(f"  {one.key.partition(' ')[0]}", default=one.default, show_default=bool(one.default))
            ).strip()
        except typer.Abort as error:
            if one.optional:
                return one.default
            raise _refusal(questions, said) from error
        value = _parse_answer(one, typed)
        if value is not None:
            return value
        wrong = NUMBERS.get(one.key, "W-DAY-AGAIN")
        again = catalogue(language).get(wrong) or catalogue()[wrong]
        known = ", ".join(one.choices) or one.fields.get("columns", "-")
        echo(f"  {again['what'].format_map({'typed': typed, 'known': known})}", colour="yellow")


def _fields(one: Any, site: str) -> Mapping[str, object]:
    """The fields of a question; the site file by its name in the language."""
    from gateway.workflow.files.statements import SITE

    return {**one.fields, "source": site} if one.fields.get("source") == SITE else one.fields


def _parse_answer(one: Any, typed: str) -> Any:
    """An answer as the file keeps it; None where it will not do."""
    from gateway.workflow.day.folder import COLDEST, FARTHEST, HOTTEST, SQUAREST, UNKNOWN

    if one.key == "accept_doubts":
        reason = {**one.fields["accepted"], one.fields["named"]: typed} if typed else None
        return False if typed.lower() in NO else reason
    if one.key == "material_degc":
        found = _number(typed, HOTTEST)
        return UNKNOWN if typed.lower() == UNKNOWN else found if found is None or found >= COLDEST else None
    if one.key == "use" or one.key.startswith(ACCEPT):
        left = typed.lower() in NO
        return not left if (left or (typed.lower() in YES and "yes" in one.choices)) else None
    if one.key == "own_angle" and typed.lower() not in one.choices:
        return _number(typed, SQUAREST)
    if one.key in ("datum", "park"):
        return _number(typed, FARTHEST)
    if one.key == "columns":
        return typed if _are_columns(typed) else None
    if one.choices:
        return next((choice for choice in one.choices if choice.lower() == typed.lower()), None)
    return typed or None


def _are_columns(typed: str) -> bool:
    """Whether words say columns: they are kept only then, and else asked for again."""
    from gateway.workflow.files.headers import columns_of

    try:
        return bool(columns_of(typed.split()))
    except ConfigError:
        return False


def _number(typed: str, most: float) -> float | None:
    try:
        number = float(typed.replace(",", "."))
    except ValueError:
        return None
    return number if abs(number) <= most else None


def _refusal(questions: Any, said: Any) -> ConfigError:
    """Every open question as the lines that would answer it."""
    from gateway.workflow.day.folder import section

    lines: dict[str, list[str]] = {}
    differ = [one for one in questions if one.key.startswith(ACCEPT)]
    if differ:
        known = said.said.get("all", {}).get("accept", [])
        lines[section("all")] = _accept_lines(differ, known)
    for one in (item for item in questions if item not in differ):
        asked = catalogue()[one.code]["what"].format_map(one.fields).split("\n")[0]
        able = f" ({', '.join(one.choices)})" if one.choices else ""
        value = "false" if one.key == "use" else one.default if one.key in NUMBERS else f'"{one.default}"'
        if one.key == "accept_doubts":
            value = f"{{ {one.fields['named']} = ? }}"
        lines.setdefault(section(one.place), []).append(f"{one.key} = {value or '?'}  # {asked}{able}")
    text = "\n".join("\n".join((head, *own)) for head, own in lines.items())
    return ConfigError("E-DAY-OPEN", said.where, count=len(questions), lines=text)


def _accept_lines(questions: Any, known: Any) -> list[str]:
    """One line that accepts every statement that differs, and above it what each of them is."""
    from gateway.config import toml_value

    site = catalogue()["W-FACTS-SITE"]["what"]
    asked = [f"# {catalogue()[one.code]['what'].format_map(_fields(one, site))}" for one in questions]
    return [*asked, f"accept = {toml_value([*known, *(one.key.removeprefix(ACCEPT) for one in questions)])}"]


# ------------------------------------------------------------------------------------------------------ what is told


def _tell_files(found: Any) -> None:
    rows = [_row(one) for one in found.placed]
    show_table(
        Message.of("S-DAY-FILES"), ("file", Message.of("S-CLI-WHAT"), "told by", "targets", "date, environment"), rows
    )
    notes: dict[Message, list[str]] = {}
    for one in found.placed:
        for note in one.file.notes:
            notes.setdefault(note, []).append(one.file.name)
    for note, names in notes.items():
        echo_folded(f"  note: {', '.join(names)}: {note}", 4)


def _row(one: Any) -> tuple[str, ...]:
    measured = one.file.measured
    if one.setup and measured is not None:
        sense = "-" if one.setup.get("file_axis_sense") == -1 else "+"
        at = "".join(f", {axis} at {place:g}" for axis, place in one.setup.get("park", {}).items())
        return (one.file.name, f"{one.error} on {one.axis} ({sense}){at}", one.by, *_facts(measured))
    code, fields = one.why or ("W-DAY-LEFT-OUT", {})
    return one.file.name, words(code, **fields), "", *(_facts(measured) if measured is not None else ("", ""))


def _facts(measured: Any) -> tuple[str, str]:
    """Targets with the unit of their deviations, date with environment of a measured set."""
    first, last, count = measured.targets[0], measured.targets[-1], len(measured.targets)
    ways = 2 if (measured.deviations[:, :, 1] == measured.deviations[:, :, 1]).any() else 1
    targets = f"{count} x {measured.deviations.shape[1]} x {ways}: {first:g} .. {last:g}"
    start = measured.ambient_start
    air = [f"{start.air_degc:.1f} degC"] if start.air_degc is not None else []
    sensors = start.material_degc
    material = [f"material {sum(sensors) / len(sensors):.1f} degC"] if sensors else []
    date = [measured.header["Date"].strip()] if measured.header.get("Date", "").strip() else []
    unit = "um" if measured.axis_unit == "mm" else "arcsec"
    return f"{targets}, {unit}", ", ".join(date + air + material) or "-"


def _process_day(
    found: Any, gathering: Any, said: Any, *, site: Path, connect: bool, language: str, as_json: bool
) -> None:
    from drivers.clock import LoopClock
    from gateway.config import by_files
    from gateway.workflow.day.making import at_the_control, from_files, keep_day, keys_of, write_site
    from gateway.workflow.results.conformity import data_of, line_of

    path = write_site(site, gathering.folder, found.setups)
    tree = load_site(path)
    keys, now = keys_of(tree, found.setups), LoopClock().utc()
    with progress(quiet=as_json, at=(tree, path)) as say:
        if connect:

            async def main() -> Any:
                return await at_the_control(tree, path, found.setups, answers=said, clock=LoopClock(), say=say)

            outcome = run_to_end(main(), at=site)
        else:
            outcome = from_files(tree, path, found.setups, folder=gathering, answers=said, utc=now, say=say)
    data = _data(found, outcome)
    keep_day(outcome, data)
    report, judged = _report(outcome.run_folder, language)
    code = of_verdicts([one.decision.verdict for one in judged])
    if as_json:
        show_json({**data, "report": report, "setups": list(keys), "conformity": [data_of(one) for one in judged]})
        raise typer.Exit(code)
    _show_day_result(outcome, report)
    for one in judged:
        echo_folded(line_of(one), 2)
    show_next(after_day(outcome, None if connect or by_files(tree) else gathering.folder, site))
    raise typer.Exit(code)


def _report(folder: Path, language: str) -> tuple[Mapping[str, object], Any]:
    """The run's report and the calibration report, where its library is there; and the site's limits as decided."""
    from drivers.clock import LoopClock
    from gateway.store import RunFolder
    from gateway.workflow.results.report import material_of, write_report

    run = RunFolder(folder)
    material = material_of(run)
    told: dict[str, object] = {"html": str(write_report(run, material).html)}
    try:
        from gateway.workflow.results.document import DocumentOptions, with_options, write_document
    except ModuleNotFoundError as error:
        return {**told, "missing": str(error.name)}, material.judged
    made = write_document(with_options(material, DocumentOptions(language=language)), folder, LoopClock().utc())
    run.adopt(*made.files)
    return {**told, "number": made.number, "pdf": str(made.pdf)}, material.judged


def _data(found: Any, outcome: Any) -> dict[str, Any]:
    """The day for --json and for the run's folder."""
    files = []
    for one in found.placed:
        code, fields = one.why or ("", {})
        said = words(code, **fields) if code else ""
        files.append({"file": one.file.name, "sha256": one.file.sha256, "error": one.error, "axis": one.axis})
        files[-1] |= {
            "told_by": one.by,
            "setup": dict(one.setup),
            "left_out": said,
            "notes": list(map(str, one.file.notes)),
        }
    data = {"site_file": str(outcome.site_file), "files": files, **outcome.plan.as_data()}
    data["forecast"] = outcome.forecast.as_data() if outcome.forecast is not None else None
    return data | ({"proposal": outcome.proposal.as_data()} if outcome.proposal is not None else {})


def _show_day_result(outcome: Any, report: Mapping[str, object]) -> None:
    from gateway.workflow.day.making import ERRORS_FILE

    change = {one.name: one.change_um for one in outcome.plan.open}
    rows = [
        (row.name, row.state, f"{row.low:+.2f} .. {row.high:+.2f}", f"{row.U:.2f}", row.unit, _size(change, row.name))
        for row in outcome.plan.rows
    ]
    headings = ("error", "state", "range", "U (k=2)", "unit", Message.of("S-DAY-MAY-CHANGE"))
    show_table(Message.of("S-MACHINE-ERRORS"), headings, rows)
    measured, machine = outcome.plan.model.measured, outcome.plan.machine
    missing = [name for name in machine if name not in measured]
    known = len(machine) - len(missing)
    echo(Message.of("S-DAY-KNOWN", known=known, all=len(machine), missing=", ".join(missing) or "-"))
    for line in outcome.plan.model.said:
        echo_folded(f"  note: {line}", 4)
    echo_folded(prose(outcome.plan.advice), 0)
    _tell_tooth(outcome)
    echo(Message.of("S-DAY-SITE", site_file=outcome.site_file))
    echo(f"run folder: {outcome.run_folder}")
    echo(Message.of("S-DAY-ETALON", file=outcome.run_folder / ERRORS_FILE))
    echo(f"calibration report: {report.get('pdf', report['html'])}")


def after_day(outcome: Any, folder: Path | None, site: Path) -> str:
    """What comes next: the look at a proposal, the set-ups that are missing, the control's tables, or the run.

    ``folder`` is that of the day where the site's control can be asked for its tables; None for a site of files.
    """
    state = "proposed" if outcome.proposal is not None else "to-measure" if outcome.plan.remaining else "to-connect"
    place = outcome.site_file if state == "to-measure" else site
    return next_command(state, run=outcome.run_folder, site=place, folder=folder)


def _size(change: Mapping[str, float], name: str) -> str:
    return f"{change[name]:.2f}" if name in change else "-"


def tell_forecast(one: Any) -> None:
    """A forecast of the tooth as lines, and the tables that would be proposed."""
    from gateway.workflow.tooth.messages import drive_forecast_messages

    steps = {
        "before": (one.before_um, one.before_u_um),
        "own": (one.with_own_um, one.with_own_u_um),
        "after": (one.after_um, one.after_u_um),
    }
    figures = {name: f"{value:.2f} +- {u:.2f}" for name, (value, u) in steps.items()}
    sources = {name: fixed(size) for name, size in one.sources_um.items()}
    echo_folded(Message.of("S-DAY-FORECAST", **figures, **sources, largest=", ".join(one.largest) or "-"), 0)
    for line in drive_forecast_messages(one.drive):
        echo_folded(str(line), 0)
    rows = [(t.name, t.layer, str(t.points), f"{t.low:+.2f} .. {t.high:+.2f}", t.unit) for t in one.tables]
    show_table(Message.of("S-DAY-TABLES"), ("table", "layer", "points", "range", "unit"), rows)


def _tell_tooth(outcome: Any) -> None:
    if outcome.forecast is not None:
        tell_forecast(outcome.forecast)
    elif outcome.proposal is not None:
        show_table("tables", ("table", "what", Message.of("S-POINTS-VALUES")), outcome.proposal.tables)
    else:
        echo(Message.of("S-DAY-NO-WORK"))
