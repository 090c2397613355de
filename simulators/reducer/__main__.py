"""`python -m simulators.reducer BENCH`: puts a reducer on the bench and writes what was read as a CSV file."""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path

from drivers.errors import ConfigError, TrueflankError
from simulators.reducer.bench import Bench, BenchFile, flanks_of, load_bench, packaged_benches
from simulators.reducer.parts import Flanks

TESTS = ("all", "running", "hysteresis")
FEWEST, MOST = 6, 240


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m simulators.reducer", description=__doc__)
    parser.add_argument("bench", nargs="?", default="rv-40e", help="a bench that comes with trueflank or a bench file")
    parser.add_argument("--list", action="store_true", help="print the benches that come with trueflank and end")
    parser.add_argument("--seed", type=int, help="draw another reducer of the same kind")
    parser.add_argument("--test", choices=TESTS, default="all", help="one turn both ways, a torque loop, or both")
    parser.add_argument("--torque", type=float, default=0.0, help="torque on the output while it turns, Nm")
    parser.add_argument("--rpm", type=float, default=5.0, help="speed of the output")
    parser.add_argument("--steps", type=int, default=24, help="readings in a turn of a crank")
    parser.add_argument("--turns", type=float, default=1.0, help="turns of the output each way")
    parser.add_argument(
        "--disc",
        type=Path,
        action="append",
        default=[],
        help="flanks of disc 1, 2 ...: CSV of space, profile angle in rad, height in mm, surplus in um",
    )
    parser.add_argument("-o", "--out", type=Path, help="where the record goes (default: NAME.csv)")
    options = parser.parse_args(given)
    if not FEWEST <= options.steps <= MOST or not 0.0 < options.turns <= 10.0 or not 0.0 < options.rpm <= 1000.0:
        parser.error(f"--steps is {FEWEST} to {MOST}, --turns and --rpm are more than 0, at most 10 and 1000")
    return options


def flanks_read(path: Path, spec: BenchFile) -> Flanks:
    """Flanks of a disc from a CSV file with one line of heading. Raises ConfigError (E-BENCH-FLANKS)."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:] if row]
    except (OSError, ValueError) as error:
        raise ConfigError("E-BENCH-FLANKS", str(path), why=str(error)) from error
    return flanks_of(rows, spec.gear, str(path))


def run(options: argparse.Namespace) -> Path:
    """Make the record; where it was written. A file that is there is never replaced (E-BENCH-FILE)."""
    spec = load_bench(options.bench)
    if len(options.disc) > spec.discs.count:
        raise ConfigError("E-BENCH-FILE", "--disc", why=f"the bench has {spec.discs.count} discs")
    given = {d: flanks_read(path, spec) for d, path in enumerate(options.disc)}
    bench = Bench(spec, options.seed, spec.reducer(options.seed, given))
    made = []
    if options.test != "hysteresis":
        made.append(bench.running(torque_nm=options.torque, rpm=options.rpm, steps=options.steps, turns=options.turns))
    if options.test != "running":
        made.append(bench.hysteresis())
    record = made[0].and_then(made[1]) if len(made) > 1 else made[0]
    path: Path = options.out or Path(f"{spec.name}.csv")
    try:
        with path.open("x", encoding="utf-8", newline="") as file:
            file.write(record.text())
    except OSError as error:
        raise ConfigError("E-BENCH-FILE", str(path), why=str(error)) from error
    return path


def main(given: list[str] | None = None) -> int:
    """Entry point: 0, or the error's own exit code."""
    options = arguments(given)
    try:
        answer = {"benches": packaged_benches()} if options.list else {"record": str(run(options).resolve())}
    except TrueflankError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    sys.stdout.write(json.dumps(answer) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
