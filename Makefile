# FTLab. `make run` serves the lab, `make test` checks it; both set up whatever is missing.
.DEFAULT_GOAL := help
PYTHON ?= python3
PORT ?= 8000
VENV := .venv
BIN := $(VENV)/bin
# Small matrices: more BLAS threads only get in each other's way.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help run test test-all bench probabilities lint types browser setup setup-dev clean

help:
	@echo "make run        serve the lab on http://127.0.0.1:$(PORT) (PORT=8001 changes it)"
	@echo "make test       lint, types, floors of the house, all tests (installs what is needed, browser included)"
	@echo "make test-all   the same with the long statistics"
	@echo "make bench      the benchmark table"
	@echo "make probabilities   the table of stated and measured false-alarm probabilities"

$(VENV)/.run: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(None if (3, 11) <= sys.version_info < (3, 15) else "FTLab needs Python 3.11 to 3.14 (numpy has no wheels for others yet), this is " + sys.version.split()[0] + "; make PYTHON=python3.13 takes another")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q -c constraints.txt -e .
	@$(BIN)/pip install -q -c constraints.txt -e '.[jsbsim]' || \
	echo "JSBSim cannot be installed on this machine: its F-16 will say so when it is asked for, all else flies"
	@touch $@

$(VENV)/.dev: $(VENV)/.run
	$(BIN)/pip install -q -c constraints.txt -e '.[dev]'
	@touch $@

setup: $(VENV)/.run
setup-dev: $(VENV)/.dev

run: setup
	$(BIN)/ftlab serve --port $(PORT)

browser:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || command -v chromium-browser >/dev/null || \
	{ echo "installing Chromium for the browser tests"; \
	  SUDO=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	  $$SUDO apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$SUDO apt-get install -y -qq chromium fonts-dejavu-core >/dev/null; } || \
	{ echo "no Chromium here and none could be installed: the browser tests will be skipped by name"; }

# Runs $(2) as the stage $(1), and says how long it took.
define stage
@begun=$$(date +%s); echo "-- $(1)"; $(2); status=$$?; echo "-- $(1): $$(( $$(date +%s) - begun )) s"; exit $$status
endef

lint: setup-dev
	$(call stage,lint and floors of the house,$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/lint-imports)

types: setup-dev
	$(call stage,types of Python,$(BIN)/mypy)
	$(call stage,types of the page,.ci/page-types)

# Two processes share the tests; a file's tests stay in one of them, for they share what is made once.
PYTEST := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test: setup-dev browser lint types
	$(call stage,tests,$(PYTEST) -m "not long")

test-all: setup-dev browser lint types
	$(call stage,all tests,$(PYTEST) --hypothesis-profile search -m "long or not long")

bench: setup-dev
	$(BIN)/python -m tests.bench

probabilities: setup-dev
	@$(BIN)/python -m tests.papers.probabilities

clean:
	rm -rf $(VENV) build *.egg-info
