# The two commands: `make demo` and `make test`. Each sets up its own virtual environment first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2
# Our matrices are small: BLAS threads of several processes only wait for each other.
export OPENBLAS_NUM_THREADS := 1
# Tests start many processes: each would compile the whole source again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test check long soak attacks interop bench clean

demo: $(VENV)/installed
	$(BIN)/trueflank demo

test: check
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "not soak and not interop and not long"

check: $(VENV)/developed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

# The same code with bigger numbers and on more machines than `make test` has time for.
long: $(VENV)/developed
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "long and not soak"

# `make soak N=200` sends that many seeded machines through the closing run; PROOF=folder keeps their document elsewhere.
N ?= 20
PROOF ?= docs
soak: $(VENV)/developed
	TRUEFLANK_MACHINES=$(N) TRUEFLANK_PROOF=$(PROOF) \
		$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "soak or long"

# Attacks on a push, counted into docs/reliability.md. PUSHES and N say how many seeded ones.
ATTACKS := .attacks
attacks: $(VENV)/developed
	rm -rf $(ATTACKS)
	TRUEFLANK_ATTACKS=$(ATTACKS) $(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m attack
	$(BIN)/python -m tests.attacks $(ATTACKS) docs/reliability.md "make attacks"

# Peers nobody here wrote: node-opcua, libmodbus, mbpoll, two parsers of structured text. What is not installed and cannot be is said and skipped.
interop: $(VENV)/developed
	tests/interop/prepare.sh $(abspath $(BIN)/python)
	$(BIN)/python -m pytest -q -n 0 -m interop tests/interop

bench: $(VENV)/developed
	$(BIN)/python benchmarks/flank.py
	$(BIN)/python benchmarks/dynamic.py
	$(BIN)/python benchmarks/sweep.py
	$(BIN)/python benchmarks/audit.py
	$(BIN)/python benchmarks/streams.py
	$(BIN)/python benchmarks/modbus.py
	$(BIN)/python benchmarks/push.py

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	touch $@

$(VENV)/developed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev,cluster]"
	touch $@ $(VENV)/installed

clean:
	rm -rf $(VENV) demo .mypy_cache .ruff_cache .pytest_cache
