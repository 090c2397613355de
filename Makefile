# The two commands: `make demo` and `make test`. Each sets up its own virtual environment first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2
# Our matrices are small: BLAS threads of several processes only wait for each other.
export OPENBLAS_NUM_THREADS := 1
# Tests start many processes: each would compile the whole source again.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test fast structure tests slowest check rules types long soak families attacks interop kernel services browser page-check bench clean \
	lock package sbom vulnerabilities bundle docs mutants coverage fuzz

demo: $(VENV)/installed
	$(BIN)/trueflank demo

# The types are checked beside the tests: both end sooner than one after the other.
test: rules
	$(MAKE) --no-print-directory -j2 types tests

QUICK := not soak and not interop and not long and not services and not browser and not release
tests: $(VENV)/developed
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "$(QUICK)"

# Rules, types and unit tests of one package while it is changed: make fast PACKAGE=gateway/interlocks
PACKAGE ?= gateway/interlocks
fast: $(VENV)/developed
	$(BIN)/ruff check $(PACKAGE)
	$(BIN)/lint-imports > /dev/null || $(BIN)/lint-imports
	$(BIN)/mypy $(PACKAGE)
	$(BIN)/python -m pytest -q -m "$(QUICK)" $(or $(wildcard tests/unit/$(notdir $(PACKAGE))),$(error no tests/unit/$(notdir $(PACKAGE))))

# What of the source can be counted, and what one push executes: before and after a restructuring.
structure: $(VENV)/developed
	$(BIN)/python -m benchmarks.structure

# The same tests, and what they cost: the ten slowest, sums by file and by folder, in processor time. `make slowest
# WHICH=long` for those of `make long`.
WHICH ?= $(QUICK)
slowest: $(VENV)/developed
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal --slowest -m "$(WHICH)"

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
		$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m "(soak or long) and not interop"
	$(MAKE) --no-print-directory coverage mutants fuzz

# Families of hard machines alone, N of each (20 at most): how honest the uncertainties are, into docs/families.md. What
# a machine gave is kept in .families: stopped, it goes on from there as long as the code is the same.
families: $(VENV)/developed
	TRUEFLANK_MACHINES=$(N) TRUEFLANK_PROOF=$(PROOF) \
		$(BIN)/python -m pytest -q -s -n 0 -m soak tests/closing/test_families.py

# Seeded small faults in the code that decides about a write, and what of them the tests find, into docs/reliability.md.
MUTANTS ?= 20
SEED ?= 1
mutants: $(VENV)/developed
	$(BIN)/python -m tests.mutants $(SEED) $(MUTANTS) docs/reliability.md

# Which branches of that code the quick tests take, into docs/reliability.md, with what none takes.
coverage: $(VENV)/developed
	nice -n 10 $(BIN)/python -m tests.branches docs/reliability.md

# Every parser of foreign bytes searched for so many seconds of the processor each; what is found is kept in .fuzz.
SECONDS ?= 600
TARGETS ?=
fuzz: $(VENV)/developed
	nice -n 10 $(BIN)/python -m tests.fuzz $(SECONDS) .fuzz $(TARGETS)

# Attacks on a push, counted into docs/reliability.md. PUSHES and N say how many seeded ones.
ATTACKS := .attacks
attacks: $(VENV)/developed
	rm -rf $(ATTACKS)
	TRUEFLANK_ATTACKS=$(ATTACKS) $(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m attack
	$(BIN)/python -m tests.attacks $(ATTACKS) docs/reliability.md "make attacks"

# Meaning that nobody here gave: node-opcua, open62541, libmodbus, mbpoll, two parsers of structured text, LinuxCNC's
# kernel; the PLC text in a strict interpreter; files of a real control where they lie beside this checkout. What is not
# there and cannot be had is said and skipped.
interop: $(VENV)/developed
	tests/interop/prepare.sh $(abspath $(BIN)/python)
	$(BIN)/python -m pytest -q -n 0 -rs -m "(interop or not long) and not soak" tests/interop \
		tests/unit/mailbox/test_plc_text_whole.py tests/unit/sinumerik/test_genuine_files.py

# A whole run on LinuxCNC's own kernel with its mill in HAL; half an hour at most, for the kernel keeps its own time.
kernel: $(VENV)/developed
	tests/interop/prepare.sh $(abspath $(BIN)/python)
	$(BIN)/python -m pytest -q -n 0 -m "interop and soak" tests/interop

# The service with servers of others: PostgreSQL and mosquitto from Debian, started by the tests on loopback; every
# route fuzzed.
services: $(VENV)/developed
	tests/services/prepare.sh
	locks/install.sh $(BIN)/python locks/peers.lock
	$(BIN)/python -m pytest -q -n 0 -p schemathesis.pytest.plugin -m services tests/services

# The operator's page in Debian's Chromium, from the first sign-in to the report, on a cell over real wires; its pictures
# are kept in .browser. Ten minutes on two cores.
browser: $(VENV)/developed
	tests/browser/prepare.sh
	locks/install.sh $(BIN)/python locks/peers.lock
	$(BIN)/python -m pytest -q -n 0 -m browser tests/browser

# The page's scripts: form, rules, types, and unit tests of what decides in them. Tools come from npm by their lock; neither
# the page nor `make test` needs them.
page-check:
	tests/page/check.sh

bench: $(VENV)/developed
	$(BIN)/python -m benchmarks --page docs/benchmarks.md

# What builds, counts and checks what is handed out; it stands apart from what the program needs.
TOOLS := .tools
$(TOOLS)/installed: locks/tools.lock
	$(PYTHON) -m venv $(TOOLS)
	$(TOOLS)/bin/$(PIP) --require-hashes -r locks/tools.lock
	touch $@

# Every lock from pyproject.toml: what is pinned stays pinned, unless `make lock UPGRADE=--upgrade`. The largest first: the
# others take its versions. Hashes of all files of a version, so that another system finds its own.
UPGRADE ?=
LOCK := $(TOOLS)/bin/uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-header --no-annotate
lock: $(TOOLS)/installed
	$(LOCK) $(UPGRADE) pyproject.toml --all-extras --group build -o locks/peers.lock
	$(LOCK) -c locks/peers.lock pyproject.toml --extra sim --extra report -o requirements.lock
	$(LOCK) -c locks/peers.lock pyproject.toml --extra dev --extra cluster --extra report --extra browser --group build -o locks/dev.lock
	$(LOCK) -c locks/peers.lock --group build -o locks/build.lock
	$(LOCK) -c locks/peers.lock $(UPGRADE) --group tools -o locks/tools.lock

# A wheel and a source archive, installed outside this folder; the demo starts from there.
package: $(VENV)/developed
	$(BIN)/python -m pytest -q -n 0 -m release tests/release/test_package.py

# What the shop-floor PC gets, as CycloneDX, and its licences as a page.
sbom: $(TOOLS)/installed
	$(PYTHON) -m venv --clear --without-pip $(TOOLS)/floor
	$(TOOLS)/bin/python -m pip --python $(TOOLS)/floor/bin/python install --quiet --require-hashes -r requirements.lock
	mkdir -p dist
	$(TOOLS)/bin/cyclonedx-py environment --pyproject pyproject.toml --mc-type application --output-reproducible \
		--of JSON -o dist/trueflank.cdx.json $(TOOLS)/floor
	$(PYTHON) -m release.vendored dist/trueflank.cdx.json
	$(PYTHON) -m release.licences dist/trueflank.cdx.json docs/licences.md

# An archive for each system that installs without a network; the one for Linux is tried with the network cut.
bundle: $(VENV)/developed sbom
	rm -f dist/trueflank-*
	$(BIN)/python -m hatchling build -t wheel -d dist
	$(TOOLS)/bin/python -m release.bundle linux-x86_64 dist dist/trueflank.cdx.json
	$(TOOLS)/bin/python -m release.bundle windows-amd64 dist dist/trueflank.cdx.json
	cd dist && sha256sum trueflank-*-py*.* trueflank.cdx.json > SHA256SUMS
	$(if $(TRUEFLANK_RELEASE_KEY),$(BIN)/python -m release.signing sign $(TRUEFLANK_RELEASE_KEY) dist/SHA256SUMS,@echo "bundle: NOT SIGNED: TRUEFLANK_RELEASE_KEY names no key")
	$(BIN)/python -m pytest -q -n 0 -m release tests/release/test_bundle.py

# The handbook into dist/handbook: it opens without a network (only its search wants a server: python3 -m http.server). A
# broken link or a page that nobody finds ends the build; --quiet would hide it.
docs: $(VENV)/developed $(TOOLS)/installed
	NO_MKDOCS_2_WARNING=1 $(TOOLS)/bin/mkdocs build --clean
	$(BIN)/python -m pytest -q -n 0 -m release tests/release/test_handbook.py

# Known weaknesses of what is pinned, as a public data base tells them; where none could be reached it fails, unless
# TRUEFLANK_VULNERABILITIES=offline.
vulnerabilities: $(TOOLS)/installed
	$(PYTHON) -m release.vulnerabilities $(TOOLS) requirements.lock

PIP := python -m pip install --quiet --disable-pip-version-check
$(VENV)/installed: pyproject.toml requirements.lock locks/build.lock
	$(PYTHON) -m venv $(VENV)
	locks/install.sh $(BIN)/python requirements.lock locks/build.lock
	$(BIN)/$(PIP) --no-deps --no-build-isolation -e .
	touch $@

$(VENV)/developed: pyproject.toml locks/dev.lock
	$(PYTHON) -m venv $(VENV)
	locks/install.sh $(BIN)/python locks/dev.lock
	$(BIN)/$(PIP) --no-deps --no-build-isolation -e .
	touch $@ $(VENV)/installed

clean:
	rm -rf $(VENV) $(TOOLS) dist demo .browser .families .fuzz .mypy_cache .ruff_cache .pytest_cache
