# `make demo` and `make test` do all the set-up on a fresh machine: nothing needs to be installed before.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
JOBS   ?= auto

ROVID  ?= $(BIN)/rovid

.PHONY: demo demo-alone test pytest test-slow notebooks lint docs release bench sweep torture challenge lowest clean

INSTALL := .ci/install $(BIN)/python
# By all cores, and wherever Python is told to keep nothing of the kind by itself; what does not compile is not used. Tests
# of libraries, what nothing here imports, and MAVLink's many dialects that are not read, would be a third of it.
COMPILE := $(BIN)/python -m compileall -qq -j 0 -x \
	'site-packages/(.*/tests?/|(OpenGL|fontTools|mypyc?|pip|pkg_resources|pygments/lexers|setuptools|snowballstemmer)/|pymavlink/dialects/v../(?!ardupilotmega))'

$(VENV)/ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable '.[app,fleet,logs]'
	-$(COMPILE) $(VENV)/lib rovid
	touch $@

$(VENV)/installed: $(VENV)/ready
	$(INSTALL) --group dev --editable '.[app,fleet,logs]'
	-$(COMPILE) $(VENV)/lib tools benchmarks docs
	touch $@

# The simulation, compiled once and not by each worker of the tests; where that fails it is compiled at first use.
KERNELS := from rovid.model.kernels import compile_all, is_compiled; is_compiled() or compile_all()

$(VENV)/compiled: $(VENV)/installed
	-$(BIN)/python -c '$(KERNELS)'
	-$(ROVID) fit sample_logs/planar_rov/run_01.csv --axes planar -p $(VENV)/planar.toml > $(VENV)/planar.log 2>&1
	touch $@

define DEMO
	$(ROVID) check sample_logs/rosub_tank
	$(ROVID) fit-drag sample_logs/rosub_tank -p demo/parameters.toml
	$(ROVID) fit-inertia -p demo/parameters.toml
	$(ROVID) simulate -p demo/parameters.toml
	@echo "The finished page:"
	@$(ROVID) report -p demo/parameters.toml -o demo/report
endef

demo: $(VENV)/ready  ## identify the sample trial day and write its page
	$(DEMO)

demo-alone:  ## the same by an installed ROVID, in whatever folder holds the sample logs
	$(DEMO)

test: $(VENV)/installed  ## all tests; fails when none ran
	$(MAKE) --no-print-directory --jobs=2 lint pytest

pytest: $(VENV)/compiled
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal

test-slow: $(VENV)/compiled  ## the tests that take minutes, or show at length what others show in short
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m slow

notebooks: $(VENV)/compiled  ## the six notebooks of docs/gallery.md, from the first cell to the last: five minutes
	$(BIN)/python -m pytest -n $(JOBS) -m "slow or not slow" tests/docs/test_notebooks.py

lint: $(VENV)/installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(VENV)/installed  ## the documentation: build/docs/index.html
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo "The documentation: build/docs/index.html"

release: notebooks  ## also golden numbers, sdist and wheel in dist/, the demo from that wheel outside the tree; uploads nothing
	$(BIN)/python -m pytest -q -m slow tests/whole/test_golden.py
	rm -rf dist
	$(BIN)/python -m build
	.ci/try_wheel $(PYTHON)

$(VENV)/compared: $(VENV)/compiled  # a fit leaves the rest to a second process, whose time would count
	$(INSTALL) --group bench
	touch $@

bench: $(VENV)/compared  ## timings, as ratios measured in one run, and whether standard errors hold
	$(BIN)/python -m benchmarks.reading
	$(BIN)/python -m benchmarks.simulation
	$(BIN)/python -m benchmarks.passes
	$(BIN)/python -m benchmarks.stages
	$(BIN)/python -m benchmarks.startup
	$(BIN)/python -m benchmarks.growth
	$(BIN)/python -m benchmarks.peers
	$(BIN)/python -m benchmarks.bootstrap sample_logs/rosub_tank
	$(BIN)/python -m benchmarks.uncertainty
	$(BIN)/python -m benchmarks.decisions
	$(BIN)/python -m benchmarks.folders
	$(BIN)/python -m benchmarks.folders --axes
	$(BIN)/python -m benchmarks.clocks

sweep: $(VENV)/installed  ## hours: what the diagnosis names of hidden effects; SWEEP="--seed 1 --vehicle small"
	$(BIN)/python -m benchmarks.sweep $(SWEEP)

torture: $(VENV)/installed  ## an hour: a million bad inputs, kills, full disks; run again, it goes on where it ended
	$(BIN)/python -m benchmarks.torture --inputs 1000000 --state build/torture.jsonl $(TORTURE)
	$(BIN)/python -m benchmarks.torture.faults --state build/faults.jsonl

lowest:  ## the demo with the lowest version of each dependency that pyproject.toml allows
	rm -rf build/lowest
	$(PYTHON) -m venv build/lowest
	UV_RESOLUTION=lowest-direct .ci/install build/lowest/bin/python '.[app]'
	$(MAKE) --no-print-directory demo-alone ROVID=build/lowest/bin/rovid

challenge: $(VENV)/compared  ## an hour: the last open round of Name That Cause, all baselines; minutes with CHALLENGE="--campaigns 1"
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check pysindy
	$(BIN)/python -m benchmarks.challenge $(or $(CHALLENGE),--page docs/challenge.md)

clean:
	rm -rf $(VENV) demo dist build/docs build/doctrees build/release
