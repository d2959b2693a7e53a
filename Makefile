# The two main commands, `make fly` and `make test`, start from a fresh checkout.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt

# Dozens of processes import the same modules: keep the bytecode that one of them compiles.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: fly test test-in-any-time lint docs bench verify companion quick-start clean

fly: $(VENV)/.ground
	$(BIN)/clearway fly

# Flights in real time need a core each; everything else runs before them, in parallel.
# Those that mostly wait run along with each other: for a vehicle that is slow to answer, or silent,
# and for checks that listen for some seconds.
REAL_TIME = $$(grep -rl real_time tests --include='test_*.py')
test: $(VENV)/.dev
	$(MAKE) --jobs 2 --keep-going lint test-in-any-time
	$(BIN)/pytest --numprocesses 6 --dist worksteal -m 'real_time and waiting' $(REAL_TIME)
	$(BIN)/pytest --numprocesses 2 --maxschedchunk 1 -m 'real_time and not waiting' $(REAL_TIME)

# One process reads all tests first, besides `lint`, and keeps their bytecode for the other three.
test-in-any-time: $(VENV)/.dev
	$(BIN)/pytest --collect-only --quiet >/dev/null
	$(BIN)/pytest --numprocesses 3 --dist worksteal -m 'not real_time'

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy
	$(BIN)/mypy tests examples docs/hooks.py

bench: $(VENV)/.dev
	$(BIN)/python -m tests.benchmarks $(if $(ONLY),--only $(ONLY)) $(if $(PAGE),--page $(PAGE)) \
	    --output build/bench.json

# All long shows in sequence, hours on two cores; what was interrupted goes on where it stopped.
# `make verify QUICK=1` is the short form; DATA names the folder of the public benchmarks' scenes.
verify: $(VENV)/.dev
	$(BIN)/python -m tests.tools.verify $(if $(QUICK),--short) $(if $(DATA),--data $(DATA)) \
	    $(if $(JOBS),--jobs $(JOBS))

# The API pages and all of docs/, for a browser, in build/site.
docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# What the vehicle's computer needs and nothing else: the package without extras, without pip, the
# libraries' own tests and the dialects of MAVLink 1.  Run this on the vehicle's computer.
COMPANION ?= build/companion
companion: | $(VENV)/bin/python
	rm -rf build/lib build/bdist.* $(COMPANION)
	$(PYTHON) -m venv --without-pip $(COMPANION)
	$(BIN)/python -m pip --python $(COMPANION) install --quiet --disable-pip-version-check --no-compile \
	    --constraint constraints.txt .
	find $(COMPANION)/lib -type d -name tests -prune -exec rm -r {} +
	rm -r $(COMPANION)/lib/python3*/site-packages/pymavlink/dialects/v10
	$(COMPANION)/bin/clearway-onboard --help >/dev/null
	du -sm $(COMPANION)

# docs/quick_start.md from the built wheel, in an environment and a folder of its own: two minutes.
quick-start: $(VENV)/.dev
	$(BIN)/python -m tests.tools.quick_start

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.ground: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP_INSTALL) --editable '.[ground,sitl]'
	touch $@

# Two processes unpack the packages; pip then has little left to do, which leaves time to compile
# the simulator, once instead of in every test process.
$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	grep -v '^#' constraints.txt | xargs -P 2 -n 12 $(PIP_INSTALL) --no-deps
	$(BIN)/python -c 'from sitl.vehicle.vehicle import warm_up; warm_up()' & \
	$(PIP_INSTALL) --editable '.[dev]' && wait
	touch $@ $(VENV)/.ground

clean:
	rm -rf $(VENV) build flights .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
