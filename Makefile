# `make install` makes a virtual environment in this folder with everything; the other targets call it when needed.
# PYTHON is only used to make that environment: make PYTHON=python3.12 install
PYTHON ?= python3
DATA ?= $(if $(SPOT3D_DATA),$(SPOT3D_DATA),data)
VENV := .venv
RUN := $(VENV)/bin/python -m

# The stamp carries the folder's path: an environment that was copied or moved with its checkout installs the code
# of the old place, and would be tested instead of this one.
INSTALLED := $(VENV)/installed-$(shell printf '%s' '$(CURDIR)' | cksum | cut -d ' ' -f 1)

# One thread for each process: the stages share the cores, a library's thread pool would only fight over them.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

SECONDS ?= 600
MINUTES ?= 60

.PHONY: help install demo test test-browser test-containers lint check bench fuzz soak evaluate clean
.DEFAULT_GOAL := help

help:
	@echo "make install   set up .venv with everything (again only when dependencies change)"
	@echo "make demo      find the objects of the built-in scene and draw them"
	@echo "make test      run the tests"
	@echo "make test-containers  build the image and run the stack in Docker, or in an engine of its own (root)"
	@echo "make test-browser  test the dashboard in headless Chromium, which must be there"
	@echo "make check     format, lint, types and tests: what CI runs"
	@echo "make bench     measure time and memory"
	@echo "make fuzz      mutated messages through every stage, for SECONDS (now: $(SECONDS))"
	@echo "make soak      a live run of MINUTES (now: $(MINUTES)): does anything grow?"
	@echo "make evaluate  the paper's tables, for the data sets found in DATA (now: $(DATA))"
	@echo "make clean     remove what the other targets made, except .venv"

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "spot3d needs Python 3.11 or newer, and $(PYTHON) is not: name one, as in make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; \
	    exit 1; }
	@$(RUN) pip --version >/dev/null 2>&1 || "$(PYTHON)" -m venv --clear $(VENV) || { \
	    echo "$(PYTHON) cannot make a virtual environment: install its venv module (Debian, Ubuntu: apt install python3-venv)" >&2; \
	    exit 1; }
	$(RUN) pip install --disable-pip-version-check --quiet -c constraints.txt -e '.[dev]'
	@rm -f $(VENV)/installed-*
	@touch $@

demo: $(INSTALLED)
	$(RUN) spot3d demo

# In as many processes as there are cores, but no more than four: a test of the whole dataflow starts ten of its own.
test: $(INSTALLED)
	$(RUN) pytest --numprocesses auto --maxprocesses 4 --dist worksteal

test-containers: $(INSTALLED)
	SPOT3D_CONTAINERS=1 tests/containers/with_engine.sh $(RUN) pytest -x -v --log-cli-level=INFO tests/containers

test-browser: $(INSTALLED)
	@command -v chromium || command -v chromium-browser || command -v google-chrome || { \
	    echo "no browser is installed: apt install chromium (Debian, Ubuntu), or any Chromium or Chrome" >&2; exit 1; }
	$(RUN) pytest tests/dashboard/test_dashboard_browser.py

lint: $(INSTALLED)
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	$(RUN) mypy

check: lint test

bench: $(INSTALLED)
	@mkdir -p out
	$(RUN) spot3d bench --json out/bench.json --plots out/bench $(if $(wildcard $(DATA)/redkitchen),--data "$(DATA)/redkitchen")

fuzz: $(INSTALLED)
	SPOT3D_FUZZ_SECONDS=$(SECONDS) $(RUN) pytest --show-capture=no tests/fuzz

soak: $(INSTALLED)
	$(RUN) spot3d.bench.soak $(if $(wildcard $(DATA)/redkitchen),"$(DATA)/redkitchen",scene) --minutes $(MINUTES) --out out/soak

evaluate: $(INSTALLED)
	@mkdir -p out
	$(RUN) spot3d evaluate all "$(DATA)" --json out/evaluate.json --plots out/evaluate

clean:
	rm -rf build dist out .mypy_cache .pytest_cache .ruff_cache .hypothesis *.egg-info
	find services schemas tests deploy -name __pycache__ -type d -prune -exec rm -rf {} +
