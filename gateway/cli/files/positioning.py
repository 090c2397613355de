"""`evaluate` for positioning: figures by ISO 230-2 or another standard with U and verdicts; a table of many files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import typer

from drivers.errors import ConfigError, TrueflankError, words
from drivers.message import Message
from drivers.terms import shown
from gateway.cli.options import DateComparison, run_or_file
from gateway.cli.output import echo, show_error, show_json, show_table
from gateway.workflow.files.kind_records import KindQuestion, MeasuredFile
from gateway.workflow.run.outcome import of_verdicts


@dataclass(frozen=True, slots=True)
class EvaluationOptions:
    """How files are to be evaluated: None and "" leave things as the file has them.

    ``site`` is a whole site file: its tolerances are decided, and its register says U of the equipment; ``compared``
    then says how statements of files that differ from it are treated.
    """

    standard: str = "2014"
    unit: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)
    air: str = ""
    expansion_ppm_per_k: float | None = None
    material_degc: float | None = None
    seed: int = 1
    store: Path = Path("runs")
    axis: str = ""
    phase: str = ""
    plot: Path | None = None
    site: Any = None
    accepted: Mapping[str, str] = field(default_factory=dict)
    compared: Any = None
    columns: tuple[str, ...] = ()

    @property
    def recompensates(self) -> bool:
        """Whether the file's own correction is to be undone and made again."""
        return bool(self.air) or self.expansion_ppm_per_k is not None


def limits_of(texts: Sequence[str]) -> dict[str, float]:
    """Limits by parameter from "A=10". Raises ConfigError (E-CLI-LIMIT)."""
    found = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            found[name.strip()] = float(number)
        except ValueError:
            raise ConfigError("E-CLI-LIMIT", "--limit", text=text) from None
    return found


def list_standards(*, as_json: bool) -> None:
    """Print every standard by name with edition, certainty and parameters."""
    from gateway.evaluate.standards.registry import standards

    if as_json:
        show_json([_label(item) | {"parameters": item.parameters} for item in standards()])
        return
    rows = [(item.name, item.edition, item.certainty, str(item.says)) for item in standards()]
    show_table(Message.of("S-STANDARDS-TITLE"), ("standard", "edition", "certainty", Message.of("S-CLI-WHAT")), rows)


def _label(standard: Any) -> dict[str, Any]:
    return {
        "standard": standard.name,
        "edition": standard.edition,
        "certainty": standard.certainty,
        "formulas": f"ISO 230-2:{standard.iso}" if standard.iso else "its own",
    }


@dataclass(frozen=True, slots=True)
class BatchOptions:
    """Who evaluates many files, and the one table of all answers; by itself this process, and no table."""

    jobs: int = 1
    scheduler: str = ""
    table: Path | None = None

    def each_alone(self, files: Sequence[Path]) -> bool:
        """Whether files are a collection: of many machines, so that their statements are compared with a site alone.

        Nobody is asked then, and no answer depends on what else is evaluated, or where.
        """
        from gateway.cli.files.batch import is_collection

        return self.jobs > 1 or bool(self.scheduler) or self.table is not None or any(map(is_collection, files))


def evaluate_files(
    files: list[Path], asked: EvaluationOptions, *, as_json: bool, crew: BatchOptions = BatchOptions()
) -> None:
    """Print each file's parameters by a standard; a file that cannot be read does not stop the others.

    With a table the answers stand in its rows, and only what cannot be read is printed.
    """
    from gateway.cli.files.batch import files_in, map_files, report_progress

    _refuse_unknown(asked.standard)
    if not files:
        raise ConfigError("E-CLI-NO-FILES", "evaluate")
    every = files_in(files)
    table = _table(crew.table, asked) if crew.table is not None else None
    held = [path for path in every if table is not None and table.holds(path)]
    there = set(held)
    left = [path for path in every if path not in there]
    results: list[dict[str, Any]] = []
    failures: list[TrueflankError] = []
    drawn: list[MeasuredFile] = []
    one_way: list[tuple[Path, MeasuredFile, dict[str, Any]]] = []
    if table is not None:
        table.begin(held)
    work = partial(_evaluate_safely, asked=asked, apart=crew.each_alone(files))
    found = report_progress(map_files(work, left, jobs=crew.jobs, scheduler=crew.scheduler), len(left))
    try:
        for path, (own, shapes, error) in zip(left, found, strict=True):
            if table is not None:
                table.add(path, [_table_cells(one) for one in own])
            results += own if table is None else [_verdicts_of(one) for one in own]
            one_way += [(path, shapes[0], own[0])] if table is None and len(shapes) == len(own) == 1 else []
            drawn += shapes if asked.plot is not None else ()
            failures += [error] if error is not None else ()
    finally:
        if table is not None:
            table.end()
    _flag_opposite_runs(one_way)
    if asked.plot is not None and drawn:
        _draw(tuple(drawn), asked.plot)
    if as_json:
        show_json(results if table is None else _batch_record(crew.table, every, held, failures))
    else:
        _show_all(results if table is None else [], failures, asked.plot if drawn else None)
        if table is not None:
            told_of = {"table": crew.table, "count": len(every), "held": len(held), "failed": len(failures)}
            echo(Message.of("W-EVALUATE-TABLE", **told_of))
    said = [one["verdict"] for result in results for one in result.get("verdicts", ())]
    said += ["not decidable" for result in results if result.get("blocked")]
    said += table.verdicts(held) if table is not None else []
    code = failures[0].exit_code if failures else of_verdicts(said)
    if code:
        raise typer.Exit(code)


def _flag_opposite_runs(files: Sequence[tuple[Path, MeasuredFile, dict[str, Any]]]) -> None:
    """Two files of one command with the same targets, each in one direction: what belongs together is no two tests."""
    ways = [(path, one.measured, told) for path, one, told in files if "error" not in told]
    for at, (path, one, told) in enumerate(ways):
        for other, two, _told in ways[:at] + ways[at + 1 :]:
            if one.axis_unit == two.axis_unit and _opposite(one, two):
                told["flags"] = [*told["flags"], words("W-EVALUATE-OPPOSITE", file=path.name, other=str(other))]


def _opposite(one: Any, two: Any) -> bool:
    """Whether sets were read at the same targets (within a thousandth of their range), each in another direction."""
    import numpy as np

    up, down = (np.isfinite(item.deviations).any(axis=(0, 1)).tolist() for item in (one, two))
    if [up, down] not in ([[True, False], [False, True]], [[False, True], [True, False]]):
        return False
    same = one.targets.shape == two.targets.shape
    return bool(same and np.max(np.abs(one.targets - two.targets)) <= 1e-3 * np.ptp(one.targets))


def _show_all(results: Sequence[dict[str, Any]], failures: Sequence[TrueflankError], plot: Path | None) -> None:
    for result in results:
        if "error" not in result:
            _show(result)
    if plot is not None:
        echo(f"picture: {plot}")
    for failure in failures:
        show_error(failure, as_json=False)


FileResult = tuple[list[dict[str, Any]], list[MeasuredFile], TrueflankError | None]
"""What a file's sets are evaluated to, what a picture shows of them, and what kept the file from being read."""


def _evaluate_safely(path: Path, *, asked: EvaluationOptions, apart: bool) -> FileResult:
    drawn: list[MeasuredFile] = []
    if apart and asked.compared is not None and not isinstance(asked.compared, DateComparison):
        asked = replace(asked, compared=replace(asked.compared, earlier=[], recent=False))
    try:
        return _evaluate_path(path, asked, drawn), drawn, None
    except TrueflankError as error:
        return [{"file": str(path), "error": error.as_record()}], drawn, error


def _table(path: Path, asked: EvaluationOptions) -> Any:
    """The table of these questions; what a person says only for the screen is none of them."""
    from gateway.cli.files.batch import ResultTable
    from gateway.evaluate.standards.registry import standard

    names = standard(asked.standard).parameters
    columns = ("set", "standard", "unit", "targets", "repetitions", *names, *(f"U_{name}" for name in names))
    own = replace(asked, plot=None, site=None, compared=None)
    site = asked.site.model_dump_json() if asked.site is not None else ""
    stated = tuple(asked.compared.accepted) if asked.compared is not None else ()
    return ResultTable(path, (*columns, "verdicts", "in_doubt", "error"), f"{own} {site} {stated}")


def _table_cells(result: Mapping[str, Any]) -> dict[str, object]:
    """A result as a row; what is not known is empty."""
    from gateway.evaluate.standards.registry import standard

    if "error" in result:
        return {"error": f"{result['error']['code']}: {result['error']['what']}"}
    own = {"set": result["file"], **{name: result[name] for name in ("standard", "unit", "targets", "repetitions")}}
    U = {f"U_{name}": value for name, value in result["U"].items()}
    values = {name: result[name] for name in standard(result["standard"]).parameters}
    verdicts = "; ".join(f"{one['parameter']}: {one['verdict']}" for one in result["verdicts"])
    doubts = "; ".join(one["code"] for one in result["doubts"] if one["blocking"])
    return {**own, **values, **U, "verdicts": verdicts, "in_doubt": doubts}


def _verdicts_of(result: Mapping[str, Any]) -> dict[str, Any]:
    """What the exit code needs of a result: a hundred thousand are not all held."""
    return {name: result[name] for name in ("verdicts", "blocked") if name in result}


def _batch_record(
    table: Path | None, every: Sequence[Path], held: Sequence[Path], failures: Sequence[TrueflankError]
) -> dict[str, Any]:
    errors = [one.as_record() for one in failures]
    return {"table": str(table), "files": len(every), "held": len(held), "errors": errors}


def _refuse_unknown(name: str) -> None:
    """Raise ConfigError (E-CLI-STANDARD) before any file is read."""
    from gateway.errors import ModelError
    from gateway.evaluate.standards.registry import standard

    try:
        standard(name)
    except ModelError as error:
        raise ConfigError("E-CLI-STANDARD", "--standard", standard=name, known=error.fields["known"]) from error


def _draw(files: tuple[MeasuredFile, ...], path: Path) -> None:
    """All sets on one scale. Raises ModelError (E-KIND-UNIT) for a linear one beside a rotary one, StoreError."""
    from gateway.report.drawings.kinds import draw
    from gateway.workflow.files.kinds import evaluate_kind

    draw(evaluate_kind("positioning", files, KindQuestion()), path)


def _evaluate_path(path: Path, asked: EvaluationOptions, drawn: list[MeasuredFile]) -> list[dict[str, Any]]:
    """Every set that a file or a run holds; what a picture shows of it is added to ``drawn``."""
    from gateway.store import Store
    from gateway.workflow.files.exporting import measured_items, sets_of_axis
    from gateway.workflow.files.headers import columns_of
    from gateway.workflow.files.reading import ReadOptions

    how = ReadOptions(asked.unit, columns=columns_of(asked.columns) or None)
    found = measured_items(run_or_file(asked.store, path), how, Store(asked.store), axis=asked.axis, phase=asked.phase)
    if path.is_file():
        found = sets_of_axis(found, asked.axis, str(path))
    accepted = accepted_statements(path, found, asked.compared, asked.store)
    return [_evaluate(item, asked, drawn, accepted) for item in found]


def accepted_statements(path: Path, found: Sequence[Any], compared: Any, store: Path) -> tuple[str, ...]:
    """What the file states otherwise than site and earlier files, accepted by a person; nothing of a measuring run."""
    from drivers.types.results import MeasuredSet

    measured = [one.content for one in found if one.capture is None and isinstance(one.content, MeasuredSet)]
    return accepted_of(measured, path, compared, store)


def accepted_of(measured: Sequence[Any], path: Path, compared: Any, store: Path) -> tuple[str, ...]:
    """The same of sets that a file holds, which all have its header."""
    if isinstance(compared, DateComparison):
        compared = compared.compared(measured[0].header) if measured else None
    if compared is None or not measured:
        return ()
    from gateway.cli.options import accepted_words
    from gateway.store import Maps, Store
    from gateway.workflow.files.statements import facts_of

    stated = compared.settled([facts_of(path.name, measured[0].header)], Maps(Store(store).root))
    return tuple(accepted_words(one) for one in stated.accepted)


def _evaluate(
    item: Any, asked: EvaluationOptions, drawn: list[MeasuredFile], accepted: Sequence[str] = ()
) -> dict[str, Any]:
    from drivers.types.results import MeasuredSet
    from gateway.evaluate.behaviour import doubts, positioning
    from gateway.evaluate.optics import corrections
    from gateway.workflow.run.stages import SAID, simulated_set

    measured, path = item.content, Path(item.label)
    if not isinstance(measured, MeasuredSet):
        raise ConfigError("E-CLI-KIND", item.label, kind=type(measured).__name__)
    deviations, record = _deviations(measured, asked, path)
    drawn.append(MeasuredFile(path.name, replace(measured, deviations=deviations)))
    if item.capture is not None and not asked.recompensates:
        record = item.capture.corrections
    figured = positioning.evaluate_positioning(
        replace(item.capture or measured, deviations=deviations),
        asked.standard,
        known=_surroundings(measured, asked),
        limits=_limits(measured, asked),
        accepted=asked.accepted,
        seed=asked.seed,
    )
    found = figured.result
    return {
        "file": item.label,
        **_label(found.standard),
        "unit": found.unit,
        "targets": found.targets,
        "repetitions": found.repetitions,
        **found.values,
        "U": dict(found.U),
        "monte_carlo": {name: _outcome(outcome) for name, outcome in found.trials.items()},
        "contributions": dict(figured.contributions),
        "verdicts": [verdict(item) for item in figured.verdicts],
        "corrected": list(map(str, corrections.describe_steps(record))),
        "corrections": [_step(item) for item in record.chain],
        "flags": [
            *map(str, found.flags),
            *doubts.describe_doubts(figured.doubts),
            *map(str, measured.warnings),
            *map(str, item.notes),
            *accepted,
            *_site_limits_note(measured, asked),
            *((SAID,) if simulated_set(measured) else ()),
        ],
        "doubts": doubts.as_data(figured.doubts),
        "blocked": figured.blocked,
        "supposed": [
            # In --json units stay as every other key has them.
            line.replace("µ", "u").replace("°C", "degC")
            for line in (
                *(one.text for one in figured.supposed),
                str(positioning.describe_contributions(figured.contributions, found.unit)),
            )
        ],
    }


def _limits(measured: Any, asked: EvaluationOptions) -> dict[str, float]:
    """What was typed stands before the site's limits of this axis."""
    if asked.site is None:
        return dict(asked.limits)
    from gateway.workflow.results.conformity import limits_of_axis

    return {**limits_of_axis(asked.site, _axis(measured, asked), asked.standard), **asked.limits}


def _axis(measured: Any, asked: EvaluationOptions) -> str:
    return asked.axis or str(measured.header.get("Axis", "")).strip()


def _site_limits_note(measured: Any, asked: EvaluationOptions) -> tuple[str, ...]:
    """Why a site that was named decides nothing of this file: silence would be taken for a pass."""
    if asked.site is None:
        return ()
    from gateway.workflow.results.conformity import limited_axes, limits_of_axis

    axis = _axis(measured, asked)
    if limits_of_axis(asked.site, axis, asked.standard):
        return ()
    known = ", ".join(limited_axes(asked.site, asked.standard)) or "none"
    named = f"axis {axis}" if axis else Message.of("W-EVAL-NO-AXIS")
    return (words("S-EVAL-NO-TOLERANCE", named=named, known=known),)


def _deviations(measured: Any, asked: EvaluationOptions, path: Path) -> tuple[Any, Any]:
    """Deviations as they are, or re-compensated, with the record of what was done to them."""
    from gateway.evaluate.optics import corrections

    if not asked.recompensates:
        return measured.deviations, corrections.begin(measured.compensated_for)
    from gateway.errors import ModelError
    from gateway.evaluate.optics import air
    from gateway.evaluate.optics.displacement import recompensated_set

    if measured.axis_unit != "mm":
        raise ModelError("E-EVAL-NOT-LINEAR", str(path))
    equation: Any = asked.air or "edlen"
    if equation not in air.EQUATIONS:
        raise ConfigError("E-CLI-AIR", "--air", equation=equation, known=", ".join(air.EQUATIONS))
    return recompensated_set(
        measured,
        equation=equation,
        expansion_ppm_per_k=asked.expansion_ppm_per_k,
        material_degc=asked.material_degc,
    )


def _surroundings(measured: Any, asked: EvaluationOptions) -> Any:
    """What was typed, and what the site's register states of equipment."""
    from gateway.evaluate.behaviour.positioning import Surroundings
    from gateway.evaluate.optics import air

    given = asked.material_degc
    material = None if given is None else air.require_reading("material_degc", given, "--material-degc")
    return Surroundings(material, asked.expansion_ppm_per_k, _stated_uncertainty(measured, asked))


def _stated_uncertainty(measured: Any, asked: EvaluationOptions) -> dict[str, float]:
    if asked.site is None:
        return {}
    from gateway.workflow.axes.measure import stated_uncertainties_of

    return stated_uncertainties_of(asked.site, _axis(measured, asked))


def _outcome(outcome: Any) -> dict[str, Any]:
    names = ("mean", "u", "symmetric", "shortest", "probability", "trials", "seed", "tolerance", "converged")
    return {name: getattr(outcome, name) for name in names}


def show_verdicts(verdicts: Sequence[Mapping[str, Any]], unit: str, *, rule: bool = True) -> None:
    """Each limit with its verdict and reason, then the rule that decided."""
    for item in verdicts:
        said = f" ({item['why']})" if item["why"] else ""
        echo(f"  {item['parameter']} <= {item['limit']:g} {shown(unit)}: {item['verdict'].upper()}{said}")
    if verdicts and rule:
        echo(f"  rule: {verdicts[0]['rule']}")


def verdict(item: Any) -> dict[str, Any]:
    data = {name: getattr(item, name) for name in ("parameter", "value", "U", "limit", "verdict", "why", "rule")}
    return {**data, "why": str(item.why or "")}


def _step(item: Any) -> dict[str, Any]:
    names = ("step", "by", "words", "coefficients", "undone")
    return {name: getattr(item, name) for name in names}


def _show(result: dict[str, Any]) -> None:
    from gateway.evaluate.standards.registry import standard

    asked = standard(result["standard"])
    formulas = f" (formulas of {result['formulas']})" if asked.iso and not asked.name.startswith("ISO") else ""
    title = f"{result['file']}: {result['standard']}{formulas}, {result['targets']} targets x {result['repetitions']}"
    rows = [_row(result, name) for name in asked.parameters]
    show_table(title, ("parameter", "value", "U (k=2)", "95.45 % of repeats", "unit"), rows)
    echo(f"  edition {result['edition']}, formulas {result['certainty']}")
    show_verdicts(result["verdicts"], result["unit"])
    for one in result["doubts"]:
        if one["blocking"]:
            echo(f"  IN DOUBT {one['code']}: {one['what']}; {one['do']}", colour="yellow")
    for outcome in list(result["monte_carlo"].values())[:1]:
        echo(f"  Monte Carlo: {outcome['trials']} trials, seed {outcome['seed']}")
    shown_above = tuple(f"{one['code']}: " for one in result["doubts"] if one["blocking"])
    for flag in (*result["flags"], *result["corrected"], *result["supposed"]):
        if not flag.startswith(shown_above):
            echo(f"  note: {flag}")


def _row(result: dict[str, Any], name: str) -> tuple[str, str, str, str, str]:
    value, U, trials = result[name], result["U"].get(name), result["monte_carlo"].get(name)
    missing = trials is None or value is None
    interval = "-" if missing else " .. ".join(_figure(end) for end in trials["symmetric"])
    return name, _figure(value), _figure(U), interval, result["unit"]


def _figure(value: float | None) -> str:
    """Three decimals, or three digits where those would show little."""
    if value is None:
        return "-"
    return f"{value:.3f}" if abs(value) >= 0.1 or value == 0.0 else f"{value:.3g}"
