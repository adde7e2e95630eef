# armgate: the commands of this repository. `make` lists them.

PYTHON ?= python3
ARGS ?=
RUNS ?= 100000
STEPS ?= 20000
MUTANTS ?=
SEEDS ?= 20
PAIRS ?= 100000
CASES ?= 1000
SEED ?= 0

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check --no-input
PORTIONS := protocol/armgate sim/armgate server/armgate client/armgate

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install demo test test-all lint spec reference words docs docs-serve release-check pictures fuzz fuzz-valid fuzz-recordings conformance coverage adversary certificates mutants simulate simulate-bugs fuzz-meshes soak bench-gate bench-wire bench-rsi bench-record bench-view bench-control bench-monitor bench-demo bench-campaign bench-world bench-env lock sbom clean

help:  ## list the commands
	@echo "armgate: a gate between experimental controllers and robot arms"
	@echo
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-15s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo
	@echo "ARGS are passed on:  make demo ARGS=\"--duration 10\"   make test ARGS=\"tests/protocol -x\""
	@echo "PYTHON names the interpreter (3.11 or newer):  make install PYTHON=python3.12"

install: $(VENV)/.installed  ## make .venv with armgate in it (editable), the cell's libraries and the plots
	@echo "armgate: installed; try $(BIN)/armgate --help"

demo: $(VENV)/.viewed  ## run the demo: daemon, leader, follower and a web page, about a minute
	@$(BIN)/armgate demo $(ARGS)

# Three tests run at a time, because many wait for processes. Tests that depend on elapsed time run one at a time
# (marked "alone" in tests/conftest.py).
PYTEST := $(BIN)/python -m pytest
THREE := -n 3 --dist worksteal

test: $(VENV)/.system $(VENV)/.tested  ## run the daily tests, some minutes; a browser is installed if there is none
ifeq ($(strip $(ARGS)),)
	@$(BIN)/python -m tools.kernels
	@$(PYTEST) -m "not slow and not alone" $(THREE)
	@$(PYTEST) -m "not slow and alone"
else
	@$(PYTEST) $(ARGS)
endif

test-all: test  ## run the daily tests and then the slow ones, a quarter of an hour
	@$(PYTEST) -m "slow and not alone" $(THREE)
	@$(PYTEST) -m "slow and alone"

lint: $(VENV)/.linted  ## check style, types, import rules and English
	@for f in $(PORTIONS:=/__init__.py); do if [ -e $$f ]; then \
		echo "$$f: remove it; armgate is a namespace, and this file hides the other portions" >&2; exit 1; fi; done
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/python -m tools.words

spec: $(VENV)/.installed  ## write the specification's tables, the JSON Schema and the vectors from the code
	@$(BIN)/python -m tools.spec $(ARGS)

reference: $(VENV)/.installed  ## write the reference pages and the map of packages from the code
	@$(BIN)/python -m tools.reference $(ARGS)
	@$(BIN)/python -m tools.packages $(ARGS)

words: $(VENV)/.made  ## find idioms, bare clauses and long sentences: make words ARGS="docs README.md"
	@$(BIN)/python -m tools.words $(ARGS)

docs: $(VENV)/.documented reference  ## build the documentation's site into build/site, without network
	@NO_MKDOCS_2_WARNING=1 $(VENV)/docs/bin/python -m mkdocs build --quiet --strict
	@$(BIN)/python -m tools.site.check build/site
	@echo "armgate: open build/site/index.html"

docs-serve: $(VENV)/.documented  ## show the site on this machine, and renew it while pages change
	@NO_MKDOCS_2_WARNING=1 $(VENV)/docs/bin/python -m mkdocs serve

pictures: $(VENV)/.system $(VENV)/.tested  ## draw the pictures: the viewer's page, the experiments, the map of packages
	@$(BIN)/python -m tools.pictures docs
	@$(BIN)/python -m tools.packages

fuzz: $(VENV)/.fuzzed  ## search for bytes that break the protocol's reader: make fuzz RUNS=1000000
	@$(BIN)/python -m tools.fuzz $(RUNS)

fuzz-valid: $(VENV)/.tested  ## search for valid messages that break the daemon: make fuzz-valid RUNS=1000000
	@$(BIN)/python -m tools.fuzz.valid $(RUNS) $(SEED)

fuzz-recordings: $(VENV)/.tested  ## use the offline tools on CASES damaged recordings: make fuzz-recordings CASES=10000
	@CASES=$(CASES) PYTHONPATH=tests:. $(BIN)/python tests/audit/damage.py

conformance: $(VENV)/.installed  ## try the daemon against its specification, by the wall clock and in lock-step
	@$(BIN)/armgate conformance --start "$(BIN)/armgate serve configs/conformance.yaml --port 0" $(ARGS)
	@$(BIN)/armgate conformance --participants kit-a,kit-b $(ARGS) --start \
		"$(BIN)/armgate serve configs/conformance.yaml configs/conformance-lockstep.yaml --port 0"

coverage: $(VENV)/.system $(VENV)/.tested  ## run the tests and write what they cover to htmlcov/
	@$(BIN)/python -m pytest --cov --cov-report=term --cov-report=html $(ARGS)

adversary: $(VENV)/.tested  ## attack the gate for STEPS commands: make adversary STEPS=1000000
	@STEPS=$(STEPS) $(BIN)/python tests/gate/adversary.py

certificates: $(VENV)/.tested  ## compare PAIRS proofs of distance with a second method
	@PAIRS=$(PAIRS) $(BIN)/python tests/gate/certificates.py

fuzz-meshes: $(VENV)/.tested  ## try RUNS mesh files of each format, half of them damaged: make fuzz-meshes RUNS=10000
	@RUNS=$(RUNS) SEED=$(SEED) PYTHONPATH=tests $(BIN)/python tests/cell/mesh_fuzz.py

simulate: $(VENV)/.tested  ## simulate the stack under faults, from SEEDS seeds: make simulate SEEDS=1000
	@$(BIN)/python -m tools.simulate --seeds $(SEEDS) --jobs 2 $(ARGS)

simulate-bugs: $(VENV)/.tested  ## find every seeded bug by simulation, each within 200 seeds
	@$(BIN)/python -m tools.simulate --bugs --seeds 200 --jobs 2

mutants: $(VENV)/.tested  ## put faults into the gate and count those that the tests catch: make mutants MUTANTS=100
	@$(BIN)/python -m tools.mutants $(MUTANTS) --seed $(SEED) $(ARGS)

soak: $(VENV)/.tested  ## abuse the daemon for 10000 ticks, and watch its memory over 100000
	@ARMGATE_SOAK=1 $(BIN)/python -m pytest -s tests/e2e/test_abuse.py $(ARGS)

bench-gate: $(VENV)/.benched  ## measure the gate's decisions against a bare loop of the distance engine
	@$(BIN)/python benchmarks/bench_gate.py $(ARGS)

bench-wire: $(VENV)/.installed  ## measure command to verdict against a bare echo, and 50 observers
	@$(BIN)/python benchmarks/bench_wire.py $(ARGS)

bench-rsi: $(VENV)/.installed  ## measure a reply by RSI against a bare UDP echo
	@$(BIN)/python benchmarks/bench_rsi.py $(ARGS)

bench-record: $(VENV)/.installed  ## measure the cost of recording for the daemon's loop and the disk
	@$(BIN)/python benchmarks/bench_record.py $(ARGS)

bench-view: $(VENV)/.system $(VENV)/.tested  ## measure the cost of a viewer with a browser, and the states that reach its page
	@$(BIN)/python benchmarks/bench_view.py $(ARGS)

bench-control: $(VENV)/.benched  ## measure the camera law against a step of pink
	@$(BIN)/python benchmarks/bench_control.py $(ARGS)

bench-monitor: $(VENV)/.installed  ## measure the cost of the monitor, and its effect on the lateness of ticks
	@$(BIN)/python benchmarks/bench_monitor.py $(ARGS)

bench-demo: $(VENV)/.installed  ## measure the speed of the whole stack in lock-step
	@$(BIN)/python benchmarks/bench_demo.py $(ARGS)

bench-campaign: $(VENV)/.benched  ## measure campaigns on Dask: two workers against one, and losses: ARGS=10000 trials
	@$(BIN)/python benchmarks/bench_campaign.py $(ARGS)

bench-world: $(VENV)/.benched  ## measure a step of the demo cell in one process
	@$(BIN)/python benchmarks/bench_world.py $(ARGS)

bench-env: $(VENV)/.benched  ## measure a step of the environments, and the speed of two workers
	@$(BIN)/python benchmarks/bench_env.py $(ARGS)

lock: $(VENV)/.locking  ## renew the lock files: exact versions and hashes for services, development and site
	@$(BIN)/python -m tools.lock $(VENV)/lock/bin/uv $(ARGS)

sbom: $(VENV)/.made  ## write bills of materials (CycloneDX) of the lock files to dist/
	@$(BIN)/python -m tools.sbom dist

release-check: $(VENV)/.tested sbom  ## build sdist and wheel, and try the wheel in an empty environment
	@$(BIN)/python -m tools.release dist

clean:  ## remove .venv, caches and build products (runs/ stays)
	rm -rf $(VENV) build dist htmlcov .coverage .coverage.* coverage.xml
	rm -rf .hypothesis .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find $(PORTIONS) tests -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp file marks a finished step; an interrupted step is repeated.

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "armgate needs Python 3.11 or newer; '$(PYTHON)' is: $$($(PYTHON) --version 2>&1)." >&2; \
		echo "Name another one: make install PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "armgate needs Python's venv with pip, which '$(PYTHON)' lacks." >&2; \
		echo "On Debian or Ubuntu: sudo apt-get install python3-venv" >&2; exit 1; }
	@$(PYTHON) -m venv --clear $(VENV)
	@touch $@

$(VENV)/.installed: $(VENV)/.made pyproject.toml
	@echo "armgate: installing into $(VENV) (the first time takes a minute or two)"
	@$(PIP) install --editable ".[cell,plots]"
	@touch $@

$(VENV)/.viewed: $(VENV)/.installed
	@echo "armgate: installing the viewer"
	@$(PIP) install --editable ".[cell,plots,view]"
	@touch $@

$(VENV)/.tested: $(VENV)/.installed
	@echo "armgate: installing the requirements of the tests"
	@$(PIP) install --editable ".[cell,plots,test]"
	@touch $@

$(VENV)/.system: $(VENV)/.made
	@tools/system_needs.sh $(VENV)/browser
	@touch $@

$(VENV)/.fuzzed: $(VENV)/.tested
	@echo "armgate: installing the fuzzer"
	@$(PIP) install --editable ".[cell,plots,test,fuzz]" || \
		echo "armgate: no atheris for this Python; hypothesis searches blindly" >&2
	@touch $@

$(VENV)/.linted: $(VENV)/.installed
	@echo "armgate: installing the linters"
	@$(PIP) install --editable ".[cell,plots,lint]"
	@touch $@

$(VENV)/.locking: $(VENV)/.made
	@echo "armgate: installing uv, which resolves requirements"
	@$(BIN)/python -m venv $(VENV)/lock
	@$(VENV)/lock/bin/python -m pip --quiet --disable-pip-version-check --no-input install "uv>=0.9,<1"
	@touch $@

$(VENV)/.documented: $(VENV)/.made tools/site/requirements.lock
	@echo "armgate: installing MkDocs, which builds the site"
	@$(BIN)/python -m venv $(VENV)/docs
	@$(VENV)/docs/bin/python -m pip --quiet --disable-pip-version-check --no-input install --require-hashes -r tools/site/requirements.lock
	@touch $@

$(VENV)/.benched: $(VENV)/.installed
	@echo "armgate: installing the references of the benchmarks"
	@$(PIP) install --editable ".[cell,plots,bench]"
	@touch $@
