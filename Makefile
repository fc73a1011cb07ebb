# Stancekit: everything a newcomer types. A plain `make` lists the targets.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

PYTHON ?= python3
VENV ?= .venv
WORKERS ?= 2
PINS ?= constraints.txt
BIN := $(VENV)/bin
DEMO := $(VENV)/.stancekit-demo-installed
STAMP := $(VENV)/.stancekit-installed
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check --no-input
LINKS := .editable/stancekit
BENCHMARKS := $(filter-out benchmarks/_%,$(wildcard benchmarks/*.py))

# One thread a process: the problems are small, and the work is spread over processes.
test docs demo gallery bench: export OMP_NUM_THREADS = 1
test docs demo gallery bench: export OPENBLAS_NUM_THREADS = 1

# Tests start hundreds of processes: without bytecode each of them compiles the package again.
test: export PYTHONDONTWRITEBYTECODE =

.PHONY: help setup lint test docs demo gallery bench wheel smoke clean

help:  ## list these targets
	@grep -E '^[a-z]+:.*## ' Makefile | sed -E 's/^([a-z]+):.*## (.*)/make \1\t\2/' | expand -t 14

setup: $(STAMP)  ## make .venv and install what is needed (again only when the requirements change)

# Each step that is done stays done, whether the next one breaks off or not.
STOPPED = { echo "setup stopped: no network, or no room on the disk? pip says which above. Type make $(or $(MAKECMDGOALS),setup) again: it goes on where it stopped"; exit 1; }

# The demo's own part: nothing of it is compiled to bytecode before it is used, which saves a tenth of the disk.
$(DEMO): pyproject.toml setup.py constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "Python 3.11 or newer is needed, and there is no $(PYTHON); try: make $(or $(MAKECMDGOALS),setup) PYTHON=/path/to/python"; exit 1; }
	@$(PYTHON) -c 'import platform, sys; sys.exit(sys.version_info < (3, 11) and f"Python 3.11 or newer is needed, and $(PYTHON) is {platform.python_version()}; try: make $(or $(MAKECMDGOALS),setup) PYTHON=/path/to/python")'
	@echo "setup 1 of 4  [=         ]  an environment in $(VENV)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || $(STOPPED)
	@$(PIP) install --no-compile -c $(PINS) "setuptools>=77" || $(STOPPED)
	@echo "setup 2 of 4  [==        ]  numpy, scipy, solvers"
	@$(PIP) install --no-compile -c $(PINS) numpy scipy clarabel highspy scikit-learn matplotlib || $(STOPPED)
	@echo "setup 3 of 4  [=====     ]  cvxpy, casadi"
	@$(PIP) install --no-compile -c $(PINS) cvxpy casadi || $(STOPPED)
	@echo "setup 4 of 4  [========  ]  stancekit, pinocchio, MuJoCo, meshes and pages"
	@$(PIP) install --no-compile -c $(PINS) --no-build-isolation -e ".[robots,terrain,viz]" || $(STOPPED)
	@touch $@

$(STAMP): $(DEMO)
	@echo "setup, what tests need: torch, Ray, the other solvers and simulators (the largest download, some minutes)"
	@$(PIP) install -c $(PINS) --no-build-isolation -e ".[catalogue,data,rl,ray,exact,machines]" || $(STOPPED)
	@echo "setup, what tests need: tools for testing, checking and the pages"
	@$(PIP) install -c $(PINS) --no-build-isolation -e ".[dev]" || $(STOPPED)
	@touch $@
	@echo "setup done: $(BIN)/stancekit"

lint: setup  ## ruff, mypy --strict, and the direction of imports
	@echo "ruff"
	@$(BIN)/ruff check
	@echo "mypy"
	@$(BIN)/python setup.py --quiet links
	@$(BIN)/mypy $(LINKS)
	@echo "import-linter"
	@$(BIN)/lint-imports

test: lint  ## lint, then every test
	@echo "pytest"
	@$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile

docs: setup  ## build the pages into docs/_build/html: warnings are errors, examples are run
	@$(BIN)/python setup.py --quiet links
	@$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going --builder html docs docs/_build/html
	@echo "docs/_build/html/index.html"

demo: $(DEMO)  ## install what it needs, then plan, judge and simulate a robot over a terrain: out/demo
	@$(BIN)/stancekit demo --out out/demo

gallery: setup  ## make the pictures, films and pages of docs/gallery.md again: minutes
	@$(BIN)/python docs/gallery.py

bench: setup  ## run every script in benchmarks/
	@test -n "$(BENCHMARKS)" || { echo "there is no script in benchmarks/"; exit 1; }
	@for script in $(BENCHMARKS); do echo "$$script"; $(BIN)/python "$$script"; done

wheel: setup  ## build the wheel into dist/
	@rm -rf build
	@$(BIN)/python -m build --wheel --no-isolation --outdir dist

smoke: setup  ## build wheel and sdist, install each into empty environments of every Python at hand, and try them
	@$(BIN)/python -m build --no-isolation --outdir dist
	@$(PYTHON) .ci/smoke.py --pins $(PINS) dist/*.whl dist/*.tar.gz

clean:  ## remove what was built and cached; .venv and out/ stay
	@rm -rf build dist docs/_build docs/auto_examples docs/environments/*.png docs/environments/[A-Z]*.md *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	@find . -path './$(VENV)' -prune -o -type d -name __pycache__ -exec rm -rf {} +
