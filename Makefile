# make reproduce   every figure, table and verdict        make help   the rest
SHELL := /bin/bash
.DEFAULT_GOAL := help

PYTHON ?= $(firstword $(foreach name,python3 python3.13 python3.12 python3.11,$(shell \
	$(name) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' >/dev/null 2>&1 && echo $(name))) python3)
UV ?= $(shell command -v uv 2>/dev/null)
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/.ready
BENCH_READY := $(VENV)/.bench-ready
LOCK_FLAGS := --quiet --generate-hashes --no-header --no-annotate --universal --no-emit-index-url \
	--no-emit-find-links --python-version 3.11 \
	--extra fits --extra data --extra cluster --extra test --extra browser

.PHONY: help reproduce test lab bench soak lock clean

help:  ## show this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | while IFS=$$'\t' read -r name text; do printf '  make %-10s %s\n' "$$name" "$$text"; done

reproduce: $(READY)  ## run the notebooks: figures, tables, pages and verdicts into build/
	@$(RUN)/losbench reproduce

test: $(READY)  ## check style and types, then run the tests
	$(RUN)/ruff check
	$(RUN)/ruff format --check
	$(RUN)/mypy
	$(RUN)/python -m pytest -n 2

lab: $(READY)  ## open the notebooks in JupyterLab
	$(RUN)/jupyter lab notebooks

bench: $(BENCH_READY)  ## measure speed against peers, naive baselines and physical limits
	@missed=0; for script in benchmarks/bench_*.py; do echo "== $$script"; OMP_NUM_THREADS=1 $(RUN)/python "$$script" || missed=1; done; exit $$missed

soak: $(READY)  ## ten minutes of random slider moves over all explorers
	$(RUN)/python benchmarks/soak_explorers.py

lock:  ## renew both locks from pyproject.toml (needs uv)
	@test -n "$(UV)" || { echo "make lock needs uv: https://docs.astral.sh/uv/"; exit 1; }
	printf 'hatchling\neditables\n' | "$(UV)" pip compile $(LOCK_FLAGS) pyproject.toml - -o requirements.lock
	printf 'hatchling\neditables\n' | "$(UV)" pip compile $(LOCK_FLAGS) --extra bench --constraint requirements.lock \
		pyproject.toml - -o requirements-bench.lock

clean:  ## remove what was made, the environment apart
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(READY): requirements.lock pyproject.toml
	@PYTHON="$(PYTHON)" UV="$(UV)" ./.ci/set-up $(VENV) requirements.lock
	@touch $@

$(BENCH_READY): requirements-bench.lock $(READY)
	@PYTHON="$(PYTHON)" UV="$(UV)" ./.ci/set-up $(VENV) requirements-bench.lock
	@touch $@
