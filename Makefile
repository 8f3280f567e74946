# Needs Python 3.11 or newer, pip and make; uv is used when it is present. Everything is installed into .venv from the
# hashed lock. `make all` and `make test` set themselves up.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Wheels with the hashes of the lock: nothing is built, and nothing beside the lock is fetched.
LOCKED := --require-hashes --only-binary :all: --no-deps
# The project itself: built by the lock's hatchling.
EDITABLE := --no-deps --no-build-isolation -e .

ifneq ($(shell command -v uv 2>/dev/null),)
CREATE := uv venv -q --python $(PYTHON) $(VENV)
INSTALL := uv pip install --python $(BIN)/python
else
CREATE := $(PYTHON) -m venv $(VENV)
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check
endif

# Snakemake gives the path of the environment's Python to bash as it is; a colon would end it in PATH.
ifneq ($(shell pwd | LC_ALL=C tr -d 'A-Za-z0-9_@%+=,./\200-\377-' | grep -c .),0)
$(error "$(CURDIR)" has a character with which Snakemake runs no job: move the project to a folder of letters, digits and _.,+=@%-)
endif

COMPILE := -q --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header

.PHONY: all test quick lint verify bench docs schemas slurm clean lock environment

# On a terminal with bars by kind of job; elsewhere with a line for each.
all: $(STAMP)
	. $(BIN)/activate && snakemake all $(shell test -t 2 && echo --logger rich)

test: $(STAMP)
	. $(BIN)/activate && pytest -n 3 --dist loadgroup --no-loadscope-reorder

# What to run after every small change: lint, and the tests that compute no stage of a paper.
quick: lint
	. $(BIN)/activate && pytest -n 3 --dist loadgroup -m "not workflow and not stages and not slurm and not long"

lint: $(STAMP)
	. $(BIN)/activate && ruff check . && ruff format --check . && lint-imports && snakefmt --check Snakefile workflow && snakemake --lint

verify: $(STAMP)
	. $(BIN)/activate && snakemake verify

bench: $(STAMP)
	. $(BIN)/activate && python bench/run.py

# The pages and the library reference, into docs/_build/html/index.html.
docs: $(STAMP)
	. $(BIN)/activate && python -m sphinx -q -W --keep-going docs docs/_build/html

# The JSON Schema of a build's claims, which is committed and published with the pages.
schemas: $(STAMP)
	. $(BIN)/activate && python -m marsedl.schemas docs/schemas/claims.json

# What sends jobs to Slurm, into the same environment: only where it is wanted, as every start of Snakemake loads it.
slurm: $(STAMP)
	@echo "Installing what sends jobs to Slurm into $(VENV)"
	@$(INSTALL) $(LOCKED) -r requirements-slurm.lock

environment: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	@echo "Making an environment in $(VENV)"
	@test -x $(BIN)/python || $(CREATE)
	@echo "Installing the packages of requirements.lock into it; this takes some minutes"
	@$(INSTALL) $(LOCKED) -r requirements.lock
	@echo "Installing marsedl itself"
	@$(INSTALL) $(EDITABLE)
	@echo "The environment is ready; enter it with: . $(BIN)/activate"
	@touch $@

# Resolve again, without any package index address in the result.
lock:
	uv pip compile $(COMPILE) --extra dev --extra docs pyproject.toml -o requirements.lock
	uv pip compile $(COMPILE) --extra slurm --constraint requirements.lock pyproject.toml -o requirements-slurm.lock

# Everything that can be regenerated; the environment stays.
clean:
	rm -rf data/cache figures report logs benchmarks build docs/_build .snakemake .cache
