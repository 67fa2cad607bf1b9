# Each target prepares .venv first; that takes minutes the first time and no time afterwards.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
# A URL, because pip splits a path at its spaces.
CONSTRAINED := PIP_CONSTRAINT="file://$(subst $() ,%20,$(subst %,%25,$(CURDIR)))/constraints.txt"
# A terminal shows pip's own progress, a log only what each step is.
QUIET := $(if $(MAKE_TERMOUT),,--quiet)
PIP_INSTALL := $(CONSTRAINED) $(BIN)/python -m pip install $(QUIET) --disable-pip-version-check
# Files that are compiled or copied. Python sources are installed editable and always current.
COMPILED := pyproject.toml constraints.txt $(wildcard */launch/*.py *_node/config/*.yaml) \
  $(shell find msgs_schema pa_ros/native -type f 2>/dev/null)
# Prints requirements from pyproject.toml, where `p` is its content. Installing an extra through
# pip's own syntax would compile the messages again.
requirements = $(shell $(BIN)/python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); e = p['project']['optional-dependencies']; print(*map(repr, $(1)))")

# A ROS that is sourced sets it, to packages for another Python.
unexport PYTHONPATH
# Where it is set, each of the hundreds of processes that tests start compiles the packages anew.
unexport PYTHONDONTWRITEBYTECODE
export OMP_NUM_THREADS ?= 1

.PHONY: help install run train test suite lint fuzz sanitize chaos links bench results reference \
  same-results docs-check dist colcon clean
.SECONDARY:

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 14

install: $(VENV)/.installed  ## prepare .venv; install-console, -film, -bench … add an extra

install-%: $(VENV)/.installed-% ;

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(COMPILED) | $(BIN)/python
	@echo "Downloading packages, and compiling the messages and the engine: some minutes"
	$(PIP_INSTALL) --editable .
	touch $@

$(VENV)/.installed-%: $(VENV)/.installed
	@echo "Downloading the packages of the extra $*"
	$(PIP_INSTALL) $(call requirements,e['$*'])
	touch $@

run: install-console  ## the demonstration: execute programs, learn, execute what was learned
	$(BIN)/pa_ros demo

OUT ?= runs/train
train: install  ## learn design 2-L in one process, into OUT
	$(BIN)/pa_ros train --design 2-L --seed 0 --frames 50000 --out $(OUT)

# Types are checked beside the tests, which often wait.
test: install-dev  ## lint, types and all tests
	@$(MAKE) --no-print-directory --jobs=2 lint suite

suite: install-dev
	$(BIN)/python -m pytest -q -n 4 --dist loadgroup

lint: install-dev  ## ruff and mypy only
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy tests

# `make test` tries a thousandth.
fuzz: install-dev  ## a million programs, messages, damaged checkpoints and bags
	PA_ROS_FUZZ=1 $(BIN)/python -m pytest -q tests/fuzz

sanitize: sanitize-none sanitize-address,undefined sanitize-thread  ## C++ tests with sanitizers
sanitize-%: install-dev
	$(BIN)/cmake -S pa_ros/native -B build/sanitize/$* -DPA_ROS_PYTHON=OFF -DPA_ROS_NATIVE_TESTS=ON \
	  -DPA_ROS_SANITIZE=$(filter-out none,$*)
	$(BIN)/cmake --build build/sanitize/$* --parallel 2
	$(BIN)/ctest --test-dir build/sanitize/$* --output-on-failure

chaos: install-dev  ## inject faults and write FAULTS.md (half an hour); ARGS=--short: a minute
	PYTHONPATH=tests $(BIN)/python -m chaos $(or $(ARGS),--table FAULTS.md)

links: install-dev  ## a fleet behind a bad link, a cluster that loses a host (as root)
	$(BIN)/python -m pytest -q -s -p no:xdist tests/tools/links.py tests/lab/cluster_on_hosts.py

NAME ?= graph
bench: install  ## one benchmark: NAME=learner ARGS="--json learner.json"
	PYTHONPATH=pa_ros:tests $(BIN)/python -m laboratory $(NAME) $(ARGS)

results: install  ## fill the tables of RESULTS.md from docs/results
	$(BIN)/python docs/results_tables.py

reference: install  ## fill tables of settings in the docs, and the nodes' parameter files
	$(BIN)/python docs/reference.py

same-results: install  ## does this tree learn the same bits as BASE=COMMIT?
	@test -n "$(BASE)" || { echo "same-results: expected BASE=COMMIT"; exit 2; }
	test -d build/base-$(BASE) || git worktree add --detach build/base-$(BASE) $(BASE)
	$(MAKE) -C build/base-$(BASE) install
	$(BIN)/python pa_ros/laboratory/benchmarks/same_results.py $(VENV) build/base-$(BASE)/.venv

docs-check: install-dev install-peers  ## run every command in README and docs (half an hour)
	$(BIN)/python -m pytest -q -s -p no:xdist tests/cli/docs_check.py

dist: install-dev  ## source archive and wheel, in dist/, and a test of the wheel
	rm -rf dist
	$(CONSTRAINED) $(BIN)/python -m build
	$(BIN)/python -m pytest -q -p no:xdist tests/ros/packaged.py

# colcon builds in its own environment with ROS 2 from the Python index, whatever is sourced.
COLCON := $(CURDIR)/build/colcon
COLCON_ENV := env -u PYTHONPATH -u LD_LIBRARY_PATH -u COLCON_PREFIX_PATH -u ROS_DISTRO \
  AMENT_PREFIX_PATH=$(COLCON)/venv CMAKE_PREFIX_PATH=$(COLCON)/venv PATH=$(COLCON)/venv/bin:$(PATH)
colcon: install-dev $(COLCON)/.ready  ## build all packages with colcon, and test them
	cd $(COLCON) && $(COLCON_ENV) colcon build --event-handlers console_cohesion+ \
	  --paths $(addprefix $(CURDIR)/,msgs_schema msgs_schema/standard/* pa_ros sim_node agent_node learner_node) \
	  --cmake-args -DCMAKE_BUILD_TYPE=Release -DPython3_EXECUTABLE=$(COLCON)/venv/bin/python
	$(BIN)/python -m pytest -q -p no:xdist tests/ros/colcon_built.py

$(COLCON)/.ready: pyproject.toml constraints.txt | $(VENV)/.installed
	mkdir -p $(COLCON) && touch build/COLCON_IGNORE
	@echo "Downloading the packages that colcon builds with: some minutes"
	$(PYTHON) -m venv $(COLCON)/venv
	grep -v '^setuptools==' constraints.txt > $(COLCON)/constraints.txt  # colcon needs an older one
	PIP_CONSTRAINT=$(COLCON)/constraints.txt $(COLCON)/venv/bin/python -m pip install $(QUIET) \
	  --disable-pip-version-check \
	  $(call requirements,p['build-system']['requires'] + p['project']['dependencies'] + e['colcon'])
	touch $@

clean:  ## remove everything that was built
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
