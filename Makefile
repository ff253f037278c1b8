# Everything runs in .venv at the repository's root; the stamp makes a second run start at once.
PYTHON ?= python3
VENV   := .venv
STAMP  := $(VENV)/.installed
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip -qq --disable-pip-version-check
# PyTorch's own index of its builds without CUDA; empty: the package index's, on Linux gigabytes more.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
TORCH := $(shell sed -n 's/^\(torch==[^ ;]*\).*/\1/p' constraints.txt)

# Where the environment forbids it, every process that a test starts would compile all our modules anew.
unexport PYTHONDONTWRITEBYTECODE

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help install lock demo test attack nightly oracle pages docs linkcheck lint types benchmark benchmark-day benchmark-quality benchmark-diagnosis benchmark-measured load flood watch-load load-mqtt soak fuzz check release clean

help:            ## show this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## */\t/' | expand -t 22

install: $(STAMP) ## make .venv with the pinned set of constraints.txt, by their hashes

# What comes is named as it comes: a fresh machine downloads for minutes.
NAMES := awk '/^ *(Downloading|Using cached) /{sub(/^ */,"  "); print; fflush()}'

$(STAMP): pyproject.toml constraints.txt
	@echo "1 of 4  the environment, $(VENV)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "2 of 4  $(TORCH), its build without CUDA"
	@test -z "$(TORCH_INDEX)" || \
	  $(PIP) install --no-deps --retries 0 --index-url $(TORCH_INDEX) $(TORCH) 2>/dev/null || \
	  echo "$(TORCH_INDEX) gave no PyTorch: it comes from the package index, on Linux with gigabytes of CUDA"
	@echo "3 of 4  $$(grep -c '^[a-z]' constraints.txt) packages by their hashes; minutes on a fresh machine"
	@set -o pipefail; $(PIP:-qq=) install --no-deps --require-hashes --requirement constraints.txt | $(NAMES)
	@$(PIP) install $(TORCH)  # the CUDA libraries of a PyTorch from the package index; of the CPU build nothing
	@echo "4 of 4  Seatrial itself"
	@$(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

lock: $(STAMP)   ## write constraints.txt anew for every Python that pyproject.toml promises; UPGRADE=1: the newest of all
	$(PIP) install uv
	$(BIN)/uv pip compile --quiet --universal --all-extras --no-annotate --generate-hashes \
	  --custom-compile-command 'make lock' \
	  --python-version "$$(sed -n 's/^requires-python = ">=\(.*\)"/\1/p' pyproject.toml)" \
	  $(if $(UPGRADE),--upgrade) pyproject.toml --output-file constraints.txt

demo: $(STAMP)   ## the whole chain on this machine, without hardware: bus to report
	$(BIN)/seatrial demo -o demo

test: $(STAMP)   ## the test suite (-n 3: three processes, for some wait more than they work)
	$(BIN)/python -m pytest -n 3 --dist worksteal -m "not slow and not pages and not attack"

attack: $(STAMP) ## every attack on the recorder, its input, files, outputs and pages, a line for each
	$(BIN)/python -m pytest -n 2 --dist worksteal -v tests/attacks

nightly: $(STAMP) ## the long proofs: whole trials, many seeds, the longer attacks, all examples of properties
	$(BIN)/python -m pytest -n 2 --dist worksteal --hypothesis-profile night -m "slow or attack or hypothesis"

oracle: $(STAMP) ## rudder ships and NetCDF against other programs, which it installs
	$(PIP) install --no-deps shipmmg==0.0.11
	grep -o '^[a-z][^\\]*' constraints.txt > $(VENV)/pins.txt  # with hashes it would ask for the checker's, too
	$(PIP) install --constraint $(VENV)/pins.txt compliance-checker==6.1.0
	$(BIN)/python -m pytest tests/hybrid/test_rudder_ships.py tests/analysis/test_netcdf.py

pages: $(STAMP)  ## the tutorial word by word, the notebooks, the site
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "pages and not slow"

docs: $(STAMP)   ## the documentation as a site in docs/_build/html; a warning is an error
	$(BIN)/python -m sphinx -b html -d docs/_build/doctrees -W --keep-going -n -q docs docs/_build/html
	@echo docs/_build/html/index.html

linkcheck: $(STAMP) ## whether the links to other sites still lead somewhere; needs a network
	$(BIN)/python -m sphinx -b linkcheck -q docs docs/_build/linkcheck

# What is installed as one package lies in the repository's top-level folders; these links show it to mypy and
# import-linter as it is installed.
PACKAGE := build/package/seatrial
$(PACKAGE):
	mkdir -p $@
	ln -s ../../../seatrial.py $@/__init__.py
	for folder in acquisition analysis hybrid notebooks; do ln -s ../../../$$folder $@/$$folder; done

lint: $(STAMP) $(PACKAGE) ## ruff (rules, complexity, docstrings, format), import layers, dead code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	cd build/package && ../../$(BIN)/lint-imports --no-logo --config ../../.importlinter
	$(BIN)/python -m tests.dead_code

types: $(STAMP) $(PACKAGE) ## mypy, strict
	$(BIN)/mypy

benchmark: $(STAMP) ## speeds as ratios, printed and never asserted
	for file in tests/benchmarks/*_speed.py; do $(BIN)/python $$file; done

benchmark-day: $(STAMP) ## 24 h of 13 channels at 20 Hz, from MCAP to held windows: time and memory, some ten minutes
	$(BIN)/python tests/benchmarks/day_speed.py 24

benchmark-quality: $(STAMP) ## false alarms on sound simulated trials and in waves, faults found in spoilt ones
	$(BIN)/python tests/benchmarks/quality_trials.py 4
	$(BIN)/python tests/benchmarks/wave_trials.py 300
	$(BIN)/python tests/benchmarks/delay_trials.py 500

benchmark-diagnosis: $(STAMP) ## hidden effects named blind, scored; two hours (SIZE=small: ten minutes, SIZE=full: a night)
	$(BIN)/python -m tests.benchmarks.diagnosis_trials -o $(or $(RESULTS),diagnosis_$(or $(SIZE),designed).jsonl) \
	  --size $(or $(SIZE),designed) --page docs/diagnosis_benchmark.md

benchmark-measured: $(STAMP) ## effects hidden in measured data (DATA: Esso Osaka's trials by manoeuvre), scored; an hour or two
	$(BIN)/python -m tests.benchmarks.hidden_in_measured $(or $(DATA),../shared/data/esso_osaka) \
	  -o $(or $(RESULTS),measured.jsonl)

load: $(STAMP)   ## ten minutes of a saturated bus, a busy line and an autopilot: losses, CPU, memory
	$(BIN)/python tests/benchmarks/recorder_load.py 600

flood: $(STAMP)  ## the same for a minute with junk at full speed on one line more: what is kept of it, what others lose
	$(BIN)/python tests/benchmarks/recorder_load.py 60 junk

watch-load: $(STAMP) ## the same load for 80 s with a twin beside the recorder, stopped and killed: losses, CPU, latency
	$(BIN)/python -m tests.benchmarks.watch_load $(or $(DURATION),80) $(CALIBRATOR)

load-mqtt: $(STAMP) ## ten minutes of 1,000 messages a second through an MQTT broker: losses, CPU, memory
	$(BIN)/python -m tests.benchmarks.mqtt_load 600

soak: $(STAMP)   ## a week at sea through the recorder, with faults, in some ten minutes: losses, memory, open files
	$(BIN)/python tests/benchmarks/recorder_soak.py 7

fuzz: $(STAMP)   ## every decoder and recovery against bytes found by coverage, ten minutes each
	$(BIN)/python -m pip install --quiet atheris
	for name in nmea2000 dbc nmea0183 gateways mavlink mqtt declared discover recover; do \
	  $(BIN)/python -m tests.fuzz.fuzz_$$name -max_total_time=600 -rss_limit_mb=300 || exit 1; done

check: lint types docs test pages ## what CI runs

# The version stands in pyproject.toml alone.
VERSION = $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)

release: $(STAMP) ## build a release into dist/, check it as it is installed, print the text of its tag
	rm -rf dist
	$(BIN)/python -m hatchling build -d dist
	$(BIN)/python -m pytest -q tests/test_package.py
	@! grep -q '^## $(VERSION), unreleased' CHANGELOG.md || \
	  { echo "CHANGELOG.md says that $(VERSION) is unreleased: give it a date, then run this again"; exit 1; }
	@sed -n '/^## $(VERSION)/,/^## [^$(VERSION)]/p' CHANGELOG.md
	@echo "git tag -a v$(VERSION), with the text above; then upload dist/"

clean:           ## forget the environment and what the demo made
	rm -rf $(VENV) demo docs/_build
