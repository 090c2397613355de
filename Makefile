# The two commands: `make demo` and `make test`. Each sets up its own virtual environment first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2
# Our matrices are small: BLAS threads of several processes only wait for each other.
export OPENBLAS_NUM_THREADS := 1
# Tests start many processes: each would compile the whole source again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test tests check rules types long soak families attacks interop services bench clean

demo: $(VENV)/installed
	$(BIN)/trueflank demo

# The types are checked beside the tests: both end sooner than one after the other.
test: rules
	$(MAKE) --no-print-directory -j2 types tests

tests: $(VENV)/developed
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "not soak and not interop and not long and not services"

# Both at a time: each takes one core. The words of one never stand in those of the other.
check: $(VENV)/developed
	$(MAKE) --no-print-directory -j2 --output-sync=target rules types

rules: $(VENV)/developed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(VENV)/developed
	$(BIN)/mypy

# The same code with bigger numbers and on more machines than `make test` has time for.
long: $(VENV)/developed
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "long and not soak"

# `make soak N=200` sends that many seeded machines, of the class and of each family, through the closing run;
# PROOF=folder keeps their document elsewhere.
N ?= 20
PROOF ?= docs
soak: $(VENV)/developed
	TRUEFLANK_MACHINES=$(N) TRUEFLANK_PROOF=$(PROOF) \
		$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "soak or long"

# Families of hard machines alone, N of each (20 at most): how honest the uncertainties are, into docs/families.md.
families: $(VENV)/developed
	TRUEFLANK_MACHINES=$(N) TRUEFLANK_PROOF=$(PROOF) \
		$(BIN)/python -m pytest -q -s -n 0 -m soak tests/closing/test_families.py

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

# The service with servers of others: PostgreSQL and mosquitto from Debian, started by the tests on loopback; every
# route fuzzed.
services: $(VENV)/developed
	tests/services/prepare.sh
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[services]"
	$(BIN)/python -m pytest -q -n 0 -m services tests/services

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

# What is imported is compiled then; most of what is installed never is.
$(VENV)/developed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e ".[dev,cluster,report]"
	touch $@ $(VENV)/installed

clean:
	rm -rf $(VENV) demo .mypy_cache .ruff_cache .pytest_cache
