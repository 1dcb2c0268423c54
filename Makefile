# FTLab. `make run` serves the lab, `make test` checks it; both set up whatever is missing.
.DEFAULT_GOAL := help
PYTHON ?= python3
PORT ?= 8000
VENV := .venv
BIN := $(VENV)/bin
# Small matrices: more BLAS threads only get in each other's way.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help run test test-all bench lint types browser setup setup-dev clean

help:
	@echo "make run        serve the lab on http://127.0.0.1:$(PORT) (PORT=8001 changes it)"
	@echo "make test       lint, types, floors of the house, all tests (installs what is needed, browser included)"
	@echo "make test-all   the same with the long statistics"
	@echo "make bench      the benchmark table"

$(VENV)/.run: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("FTLab needs Python 3.11 or newer, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else None'
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

lint: setup-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: setup-dev
	$(BIN)/mypy

# Two processes share the machine; what measures time has it to itself afterwards, also where something failed before.
define stages
@failed=0; \
$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m "$(1)not alone" || failed=1; \
echo "alone on the machine: what measures time"; \
$(BIN)/python -m pytest -m "$(1)alone" || failed=1; \
exit $$failed
endef

test: setup-dev browser lint types
	$(call stages,not long and )

test-all: setup-dev browser lint types
	$(call stages,)

bench: setup-dev
	$(BIN)/python -m tests.bench

clean:
	rm -rf $(VENV) build *.egg-info
