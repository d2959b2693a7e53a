# Two commands matter: `make fly` and `make test`. Both start from a fresh checkout.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP_INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt

WHEN_IDLE = nice -n 19

.PHONY: fly test test-against-the-clock test-the-rest lint bench clean

fly: $(VENV)/.ground
	$(BIN)/clearway fly

# Flights against the clock need a core whenever they ask for one; all else takes what is left.
test: $(VENV)/.dev
	$(MAKE) --jobs 3 --keep-going --output-sync test-against-the-clock test-the-rest lint

test-against-the-clock: $(VENV)/.dev
	$(BIN)/pytest -m real_time

test-the-rest: $(VENV)/.dev
	$(WHEN_IDLE) $(BIN)/pytest --numprocesses 2 --dist worksteal -m 'not real_time'

lint: $(VENV)/.dev
	$(WHEN_IDLE) $(BIN)/ruff format --check .
	$(WHEN_IDLE) $(BIN)/ruff check .
	$(WHEN_IDLE) $(BIN)/mypy
	$(WHEN_IDLE) $(BIN)/mypy tests

bench: $(VENV)/.dev
	$(BIN)/python -m tests.bench $(if $(ONLY),--only $(ONLY)) --output build/bench.json

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.ground: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP_INSTALL) --editable '.[ground,sitl]'
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP_INSTALL) --editable '.[dev]'
	touch $@ $(VENV)/.ground

clean:
	rm -rf $(VENV) build flights .pytest_cache .mypy_cache .ruff_cache .hypothesis
