# Everything runs in .venv at the repository's root; the stamp makes a second run start at once.
PYTHON ?= python3
VENV   := .venv
STAMP  := $(VENV)/.installed
BIN    := $(VENV)/bin

.DEFAULT_GOAL := help
.PHONY: help install demo test test-slow lint types benchmark check clean

help:            ## show this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/ :/' | column -t -s:

install: $(STAMP) ## make .venv with the pinned set of constraints.txt

$(STAMP): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: $(STAMP)   ## the whole chain on this machine, without hardware: bus to report
	$(BIN)/seatrial demo -o demo

test: $(STAMP)   ## the test suite (-n 2: two processes)
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow"

test-slow: $(STAMP) ## the long proofs
	$(BIN)/python -m pytest -m slow

lint: $(STAMP)   ## ruff: rules and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)  ## mypy, strict
	$(BIN)/mypy

benchmark: $(STAMP) ## speeds as ratios, printed and never asserted
	for file in tests/benchmarks/*_speed.py; do $(BIN)/python $$file; done

check: lint types test ## what CI runs

clean:           ## forget the environment and what the demo made
	rm -rf $(VENV) demo
