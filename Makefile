# One command each; every one prepares .venv first and is quick the second time.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
# As a URL, since pip takes a path with a space for two.
CONSTRAINED := PIP_CONSTRAINT="file://$(subst $() ,%20,$(subst %,%25,$(CURDIR)))/constraints.txt"
PIP_INSTALL := $(CONSTRAINED) $(BIN)/python -m pip install --quiet --disable-pip-version-check
# What is compiled or copied; Python sources are installed editable and always current.
COMPILED := pyproject.toml constraints.txt $(wildcard */launch/*.py *_node/config/*.yaml) \
  $(shell find msgs_schema pa_ros/native -type f 2>/dev/null)
# The requirements of one extra, so that asking for it does not compile the interfaces again.
extra = $(shell $(BIN)/python -c "import tomllib; print(*map(repr, tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['$(1)']))")

export OMP_NUM_THREADS ?= 1

.PHONY: colcon dist docs-check reference install install-dev install-bench install-peers install-console install-film install-tensorboard run train test fuzz bench chaos same-results links lint sanitize clean

install: $(VENV)/.installed
install-dev: $(VENV)/.installed-dev
install-bench: $(VENV)/.installed-bench
install-peers: $(VENV)/.installed-peers
install-console: $(VENV)/.installed-console
install-film: $(VENV)/.installed-film
install-tensorboard: $(VENV)/.installed-tensorboard

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(COMPILED) | $(BIN)/python
	$(PIP_INSTALL) --editable .
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(PIP_INSTALL) $(call extra,dev)
	touch $@

$(VENV)/.installed-bench: $(VENV)/.installed
	$(PIP_INSTALL) $(call extra,bench)
	touch $@

$(VENV)/.installed-peers: $(VENV)/.installed
	$(PIP_INSTALL) $(call extra,peers)
	touch $@

$(VENV)/.installed-console: $(VENV)/.installed
	$(PIP_INSTALL) $(call extra,console)
	touch $@

$(VENV)/.installed-film: $(VENV)/.installed
	$(PIP_INSTALL) $(call extra,film)
	touch $@

$(VENV)/.installed-tensorboard: $(VENV)/.installed
	$(PIP_INSTALL) $(call extra,tensorboard)
	touch $@

run: install-console
	$(BIN)/pa_ros demo

OUT ?= runs/train
train: install
	$(BIN)/pa_ros train --design 2-L --seed 0 --frames 50000 --out $(OUT)

# A fleet on three hosts with a bad link that is cut, and a Ray cluster that loses a host (needs root).
links: install-dev
	$(BIN)/python -m pytest -q -s -p no:xdist tests/tools/links.py tests/evaluation/cluster_on_hosts.py

# What docs and parameter files say of settings, from the settings.
reference: install
	$(BIN)/python docs/reference.py

lint: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy tests

test: lint
	$(BIN)/python -m pytest -q -n 3 --dist loadgroup

# Every command that README and docs show in a block, run as it stands: half an hour. What
# hasn't ended after half a minute is interrupted, as with Ctrl-C.
docs-check: install-dev install-peers
	$(BIN)/python -m pytest -q -s -p no:xdist tests/cli/docs_check.py

# Source archive and, from it, the wheel, into dist/; the wheel then has to do its work in an environment
# of its own.
dist: install-dev
	rm -rf dist
	$(CONSTRAINED) $(BIN)/python -m build
	$(BIN)/python -m pytest -q -p no:xdist tests/ros/packaged.py

# All packages by colcon, in an environment of its own with ROS 2 from the Python index, whatever else is
# sourced; then what was installed has to do its work. (With a ROS 2 of one's own: docs/contributing.md.)
COLCON := $(CURDIR)/build/colcon
COLCON_ENV := env -u PYTHONPATH -u LD_LIBRARY_PATH -u COLCON_PREFIX_PATH -u ROS_DISTRO \
  AMENT_PREFIX_PATH=$(COLCON)/venv CMAKE_PREFIX_PATH=$(COLCON)/venv PATH=$(COLCON)/venv/bin:$(PATH)
requirements = $(shell $(BIN)/python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); print(*map(repr, p['build-system']['requires'] + p['project']['dependencies'] + p['project']['optional-dependencies']['colcon']))")
colcon: install-dev $(COLCON)/.ready
	cd $(COLCON) && $(COLCON_ENV) colcon build --event-handlers console_cohesion+ \
	  --paths $(addprefix $(CURDIR)/,msgs_schema pa_ros sim_node agent_node learner_node) \
	  --cmake-args -DCMAKE_BUILD_TYPE=Release -DPython3_EXECUTABLE=$(COLCON)/venv/bin/python
	$(BIN)/python -m pytest -q -p no:xdist tests/ros/colcon_built.py

$(COLCON)/.ready: pyproject.toml constraints.txt | $(VENV)/.installed
	mkdir -p $(COLCON) && touch build/COLCON_IGNORE
	$(PYTHON) -m venv $(COLCON)/venv
	grep -v '^setuptools==' constraints.txt > $(COLCON)/constraints.txt  # colcon wants an older one
	PIP_CONSTRAINT=$(COLCON)/constraints.txt $(COLCON)/venv/bin/python -m pip install --quiet \
	  --disable-pip-version-check $(requirements)
	touch $@

# A million programs, a hundred thousand messages, damaged checkpoints and bags; then, where atheris
# can be installed, cases led by coverage. `make test` looks at a thousandth of them.
fuzz: install-dev
	PA_ROS_FUZZ=1 $(BIN)/python -m pytest -q tests/fuzz
	-$(PIP_INSTALL) $(call extra,fuzz)
	$(BIN)/python tests/fuzz/guided.py -max_total_time=120

# The fused engine's own tests: plain, with AddressSanitizer and UBSan, and with ThreadSanitizer.
sanitize: sanitize-none sanitize-address,undefined sanitize-thread
sanitize-%: install-dev
	$(BIN)/cmake -S pa_ros/native -B build/sanitize/$* -DPA_ROS_PYTHON=OFF -DPA_ROS_NATIVE_TESTS=ON \
	  -DPA_ROS_SANITIZE=$(filter-out none,$*)
	$(BIN)/cmake --build build/sanitize/$* --parallel 2
	$(BIN)/ctest --test-dir build/sanitize/$* --output-on-failure

# One benchmark of pa_ros/benchmarks: make bench NAME=learner ARGS="--json learner.json"
NAME ?= graph
bench: install
	PYTHONPATH=pa_ros:tests $(BIN)/python -m benchmarks $(NAME) $(ARGS)

# Faults injected into a running graph. Without ARGS it writes FAULTS.md's table, in half an hour.
chaos: install-dev
	PYTHONPATH=tests $(BIN)/python -m chaos $(or $(ARGS),--table FAULTS.md)

# make same-results BASE=COMMIT: does what stands here learn the same as that commit, on this machine?
same-results: install
	@test -n "$(BASE)" || { echo "same-results: expected BASE=COMMIT"; exit 2; }
	test -d build/base-$(BASE) || git worktree add --detach build/base-$(BASE) $(BASE)
	$(MAKE) -C build/base-$(BASE) install
	$(BIN)/python pa_ros/benchmarks/same_results.py $(VENV) build/base-$(BASE)/.venv

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
