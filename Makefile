# Needs Python >= 3.11 with its venv module, and make; everything else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
# one process of pytest per core: threads of linear algebra would only be in each other's way
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
PIP := $(BIN)/pip --disable-pip-version-check install --quiet -c constraints.txt
# tools about the code, not its results; mutation.py takes hours
BENCHMARKS := $(filter-out %/freeze.py %/mutation.py %/reference_loop.py,$(wildcard benchmarks/[a-z]*.py))

.NOTPARALLEL:
.PHONY: help tune test test-slow test-all env bench docs clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 16

tune: .venv/.stamp-run ## tune the panda's dither from Table 4.3 into runs/panda; interrupted, it resumes
	$(BIN)/stiction tune panda --table stiction_envs/measured/thesis/table_4_3.csv --out runs/panda

test: .venv/.stamp-dev ## linter, formatter, types, then the quick tests: minutes
	@$(BIN)/python benchmarks/reference_loop.py
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(ONE_THREAD) $(BIN)/pytest -m "not slow"

test-slow: .venv/.stamp-dev ## the tests that `make test` leaves out, README's commands among them
	$(ONE_THREAD) $(BIN)/pytest -m slow

test-all: test test-slow ## both

env: .venv/.stamp-dev ## .venv with everything: rl, video and dev extras

bench: .venv/.stamp-dev ## every benchmark; each writes its result beside itself
	@set -e; for script in $(BENCHMARKS); do echo "$$script"; $(BIN)/python "$$script"; done

docs: .venv/.stamp-dev ## the documentation site: docs/_build/html/index.html
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

clean: ## remove .venv, builds and caches; runs/ stays
	rm -rf .venv build dist docs/_build docs/generated *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# What a user runs needs no PyTorch, so `make tune` installs without the extras.
.venv/.stamp-run: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(PIP) -e .
	touch $@

.venv/.stamp-dev: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(PIP) -e '.[rl,video,dev]'
	touch .venv/.stamp-run $@
