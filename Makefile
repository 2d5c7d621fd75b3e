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
FLOOR_VENV := .venv-floor
FLOOR_READY := $(FLOOR_VENV)/.ready
FLOOR_ROOMS := estimation imaging pointing recording papers
LOCK_FLAGS := --quiet --generate-hashes --no-header --no-annotate --universal --no-emit-index-url \
	--no-emit-find-links --python-version 3.11
LOCK_EXTRAS := --extra fits --extra hdf5 --extra tiff --extra data --extra cluster --extra docs --extra test --extra lint --extra mutants --extra browser
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
FOR_TEACHERS := notebooks/solutions tests/workbench/test_exercises.py tests/workbench/test_marking.py
SEED ?= 10
COUNT ?= 200

.PHONY: help reproduce site class test test-floor mutants lab bench compare soak fuzz lock clean

help:  ## show this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | while IFS=$$'\t' read -r name text; do printf '  make %-11s %s\n' "$$name" "$$text"; done

reproduce: $(READY)  ## run the notebooks: figures, tables, verdicts and the site into build/
	@$(RUN)/losbench reproduce

site: $(READY)  ## build the site of the last run again, without running anything
	@$(RUN)/losbench site

test: $(READY)  ## check style and types, then run the tests
	$(RUN)/ruff check
	$(RUN)/ruff format --check
	$(RUN)/mypy
	$(ONE_THREAD) $(RUN)/python -m pytest -n 2

test-floor: $(FLOOR_READY)  ## run the library's tests with the oldest packages that pyproject.toml allows
	$(ONE_THREAD) $(FLOOR_VENV)/bin/python -m pytest -n 2 $(addprefix tests/,$(FLOOR_ROOMS))

mutants: $(READY)  ## change one line at a time, and see whether a test notices (SEED=10 COUNT=200)
	$(ONE_THREAD) $(RUN)/python benchmarks/mutants.py --seed $(SEED) --count $(COUNT)

class:  ## an archive for students, without the solutions: dist/losbench-class.zip
	@mkdir -p dist
	git archive --format=zip --prefix=losbench/ --output=dist/losbench-class.zip HEAD -- . $(foreach path,$(FOR_TEACHERS),':(exclude)$(path)')
	@echo "dist/losbench-class.zip: the last commit without $(FOR_TEACHERS)"

lab: $(READY)  ## open the notebooks in JupyterLab
	$(RUN)/jupyter lab notebooks

bench: $(BENCH_READY)  ## measure speed against peers and limits: build/benchmarks.html and .json
	@rm -rf build/benchmarks; missed=0; for script in benchmarks/bench_*.py; do echo "== $$script"; $(ONE_THREAD) $(RUN)/python "$$script" || missed=1; done; \
	$(RUN)/python benchmarks/page.py; exit $$missed

compare: $(BENCH_READY)  ## the benches of two commits in turns, five rounds (OLD=commit NEW=commit)
	$(ONE_THREAD) $(RUN)/python benchmarks/compare.py $(OLD) $(NEW)

soak: $(READY)  ## ten minutes of random slider moves over all explorers
	$(RUN)/python benchmarks/soak_explorers.py

fuzz: $(READY)  ## ten thousand damaged files at every door: read, or refused in one line
	$(ONE_THREAD) $(RUN)/python benchmarks/fuzz.py

lock:  ## renew the locks from pyproject.toml (needs uv)
	@test -n "$(UV)" || { echo "make lock needs uv: https://docs.astral.sh/uv/"; exit 1; }
	printf 'hatchling\neditables\n' | "$(UV)" pip compile $(LOCK_FLAGS) $(LOCK_EXTRAS) pyproject.toml - -o requirements.lock
	printf 'hatchling\neditables\n' | "$(UV)" pip compile $(LOCK_FLAGS) $(LOCK_EXTRAS) --extra bench \
		--constraint requirements.lock pyproject.toml - -o requirements-bench.lock
	printf 'hatchling>=1.27\neditables>=0.5\npyparsing>=3.1,<3.3\n' | "$(UV)" pip compile $(LOCK_FLAGS) --extra fits --extra hdf5 --extra test \
		--resolution lowest-direct pyproject.toml - -o requirements-floor.lock

clean:  ## remove what was made, the environments apart
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(READY): requirements.lock pyproject.toml
	@PYTHON="$(PYTHON)" UV="$(UV)" ./.ci/set-up $(VENV) requirements.lock
	@touch $@

$(BENCH_READY): requirements-bench.lock $(READY)
	@PYTHON="$(PYTHON)" UV="$(UV)" ./.ci/set-up $(VENV) requirements-bench.lock
	@touch $@

$(FLOOR_READY): requirements-floor.lock pyproject.toml
	@PYTHON="$(PYTHON)" UV="$(UV)" ./.ci/set-up $(FLOOR_VENV) requirements-floor.lock
	@touch $@
