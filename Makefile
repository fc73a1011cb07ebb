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
STAMP := $(VENV)/.stancekit-installed
DOCS := $(VENV)/.stancekit-docs-installed
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

$(STAMP): pyproject.toml setup.py constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "Python 3.11 or newer is needed, and there is no $(PYTHON); try: make $(or $(MAKECMDGOALS),setup) PYTHON=/path/to/python"; exit 1; }
	@$(PYTHON) -c 'import platform, sys; sys.exit(sys.version_info < (3, 11) and f"Python 3.11 or newer is needed, and $(PYTHON) is {platform.python_version()}; try: make $(or $(MAKECMDGOALS),setup) PYTHON=/path/to/python")'
	@echo "setup 1/4: an environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) install -c $(PINS) "setuptools>=77"
	@echo "setup 2/4: stancekit and what it runs on (numpy, cvxpy, clarabel, casadi, gymnasium, ...)"
	@$(PIP) install -c $(PINS) --no-build-isolation -e .
	@echo "setup 3/4: torch, Ray, the other solvers, simulators (the largest download, some minutes on a slow line)"
	@$(PIP) install -c $(PINS) --no-build-isolation -e ".[exact,rl,evo,ray,datasets,kin,bullet,mujoco,terrain,viz,dynamixel,ros,log]"
	@echo "setup 4/4: tools for testing and checking"
	@$(PIP) install -c $(PINS) --no-build-isolation -e ".[dev]"
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

docs: $(DOCS)  ## build the pages into docs/_build/html: warnings are errors, examples are run
	@$(BIN)/python setup.py --quiet links
	@$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going --builder html docs docs/_build/html
	@echo "docs/_build/html/index.html"

$(DOCS): $(STAMP)
	@$(PIP) install -c $(PINS) --no-build-isolation -e ".[docs]"
	@touch $@

demo: setup  ## plan on sampled terrain and write pictures and files to out/demo
	@$(BIN)/stancekit demo --out out/demo
	@$(BIN)/stancekit plan icy-walls --out out/demo/climb.json --picture out/demo/climb.png
	@$(BIN)/stancekit simulate out/demo/climb.json

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
