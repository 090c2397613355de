"""Commands on files alone: evaluate results, lint tables."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import typer

from drivers import registry
from drivers.errors import ConfigError, TrueflankError
from gateway.cli.show import show_error, show_json, show_table

PARAMETERS = ("E", "E_up", "E_down", "R", "R_up", "R_down", "B", "B_mean", "A", "A_up", "A_down", "M")
EDITIONS = ("1988", "1997", "2006", "2014")


def evaluate_files(files: list[Path], standard: str, unit: str, *, as_json: bool) -> None:
    """Print the ISO 230-2 parameters of each file; a file that cannot be read does not stop the others."""
    edition = standard.removeprefix("ISO230-2:").removeprefix("ISO 230-2:")
    if edition not in EDITIONS:
        raise ConfigError("E-CLI-STANDARD", "--standard", standard=standard, known=", ".join(EDITIONS))
    results, failures = [], []
    for path in files:
        try:
            results.append(_evaluate(path, edition, unit))
        except TrueflankError as error:
            failures.append(error)
            results.append({"file": str(path), "error": error.as_record()})
    if as_json:
        show_json(results)
    else:
        for result in results:
            if "error" not in result:
                _show(result)
        for failure in failures:
            show_error(failure, as_json=False)
    if failures:
        raise typer.Exit(failures[0].exit_code)


def _evaluate(path: Path, edition: str, unit: str) -> dict[str, Any]:
    from drivers.units import deviation_unit
    from gateway.evaluate.iso230_2 import evaluate

    measured = reader(path, unit).read(path)
    result = evaluate(measured.targets, measured.deviations, deviation_unit(measured.axis_unit), edition=edition)
    values = {name: getattr(result, name) for name in PARAMETERS}
    return {
        "file": str(path),
        "standard": result.standard,
        "unit": result.unit,
        "targets": len(result.targets),
        "repetitions": int(measured.deviations.shape[1]),
        **values,
        "U": dict(result.U),
        "flags": [*result.flags, *measured.warnings],
    }


def reader(path: Path, unit: str = "") -> Any:
    """The driver for a result file by its ending. Raises ConfigError (E-CLI-FILE) for unknown endings."""
    name = path.suffix.lower().lstrip(".")
    known = registry.known("file")
    if name not in known:
        endings = ", ".join(f".{ending}" for ending in sorted(known))
        raise ConfigError("E-CLI-FILE", str(path), ending=path.suffix or "(none)", known=endings)
    factory = known[name].load()
    return factory(unit=unit) if unit and "unit" in inspect.signature(factory).parameters else factory()


def _show(result: dict[str, Any]) -> None:
    title = f"{result['file']}: {result['standard']}, {result['targets']} targets x {result['repetitions']}"
    rows = [
        (name, "-" if result[name] is None else f"{result[name]:.3f}", _uncertainty(result, name), result["unit"])
        for name in PARAMETERS
    ]
    show_table(title, ("parameter", "value", "U (k=2)", "unit"), rows)
    for flag in result["flags"]:
        typer.echo(f"  note: {flag}")


def _uncertainty(result: dict[str, Any], name: str) -> str:
    value = result["U"].get(name)
    return "-" if value is None else f"{value:.3f}"


def lint_file(file: Path, *, as_json: bool) -> None:
    """Print every finding of a table file; exit code 7 when there is one."""
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ConfigError("E-CLI-READ", str(file), why=str(error)) from error
    findings = registry.load("sinumerik-tables", "table-file")().findings(text, str(file))
    if as_json:
        show_json({"file": str(file), "findings": list(findings)})
    elif findings:
        for finding in findings:
            typer.echo(finding)
    else:
        typer.echo(f"{file}: no findings")
    if findings:
        raise typer.Exit(7)
