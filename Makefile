# Needs Python >= 3.11 with its venv module, and make; everything else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
PYTHON_VERSION := $(shell $(PYTHON) -c 'import platform; print(platform.python_version())')
RUN := .venv/.stamp-run-$(PYTHON_VERSION)
DEV := .venv/.stamp-dev-$(PYTHON_VERSION)
# one process of pytest per core: threads of linear algebra would only be in each other's way
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
PIP := $(BIN)/pip --disable-pip-version-check install --quiet -c constraints.txt
# modules that write a page
BENCHMARKS := $(shell grep -l 'def main' benchmarks/accuracy/*.py benchmarks/servo/*.py benchmarks/engines/*.py benchmarks/speed/*.py benchmarks/learning/*.py | sed 's:/:.:g; s:\.py$$::')

.NOTPARALLEL:
.PHONY: help tune reproduce test test-slow test-all env bench docs clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 16

tune: $(RUN) ## tune the panda's dither from Table 4.3 into runs/panda; interrupted, it resumes
	$(BIN)/stiction tune panda --table stiction_envs/measured/thesis/table_4_3.csv --out runs/panda

reproduce: $(DEV) ## every table and figure of the thesis, simulated beside measured, into runs/
	$(BIN)/python -m benchmarks.thesis --out runs/reproduce-thesis

test: $(DEV) ## linter, formatter, types, then the quick tests: minutes
	@$(BIN)/python benchmarks/reference_loop.py
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(ONE_THREAD) $(BIN)/pytest -m "not slow"

test-slow: $(DEV) ## the tests that `make test` leaves out, README's commands among them
	$(ONE_THREAD) $(BIN)/pytest -m slow

test-all: test test-slow ## both

env: $(DEV) ## .venv with everything: rl and dev extras

bench: $(DEV) ## every benchmark; each writes its result beside itself
	@set -e; for script in $(BENCHMARKS); do echo "$$script"; $(BIN)/python -m "$$script"; done

docs: $(DEV) ## the documentation site: docs/_build/html/index.html
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

clean: ## remove .venv, builds and caches; runs/ stays
	rm -rf .venv build dist docs/_build docs/generated *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# What a user runs needs no PyTorch, so `make tune` installs without the extras. An environment of
# another Python is removed, and so is an old *.egg-info, which would hide new entry points.
define NEW_ENVIRONMENT
test -e .venv/.stamp-run-$(PYTHON_VERSION) || rm -rf .venv
rm -rf *.egg-info
$(PYTHON) -m venv .venv
endef

$(RUN): pyproject.toml constraints.txt
	$(NEW_ENVIRONMENT)
	$(PIP) -e .
	touch $@

$(DEV): pyproject.toml constraints.txt
	$(NEW_ENVIRONMENT)
	$(PIP) -e '.[rl,dev]'
	touch $(RUN) $@
