# `make up` and `make test` are all a newcomer needs; everything they use is installed by `setup`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
CODE   := bus marine services camera_tracker platform_link ui logs benchmarks tests starboard.py

.PHONY: help setup up test check bench figures campaigns docs soak fuzz format lock chromium clean

help:  ## this list
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

setup: $(STAMP)  ## make .venv from requirements.lock; quick when nothing changed

$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Starboard needs Python 3.11 or newer: make PYTHON=python3.12 ..." if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

up: setup  ## start everything with the simulator; prints the address of the page
	@exec $(BIN)/starboard up config/simulation.toml

test: setup chromium  ## all tests that CI runs
	$(BIN)/pytest -n 2 tests/unit tests/property tests/loop
	$(BIN)/pytest tests/system tests/browser

chromium:  # Debian's Chromium for the browser tests, where it is missing
	@command -v chromium >/dev/null || { \
	  echo "installing Debian's chromium for the browser tests"; \
	  SUDO=; [ "$$(id -u)" = 0 ] || SUDO=sudo; \
	  $$SUDO apt-get update -qq && $$SUDO apt-get install -y -qq --no-install-recommends chromium >/dev/null; }

check: setup  ## lint, format, types, direction of imports, stale generated files
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m services.generate --check

format: setup  ## let ruff mend what it can
	$(BIN)/ruff check --fix $(CODE)
	$(BIN)/ruff format $(CODE)

bench: setup  ## every benchmark, as JSON lines
	$(BIN)/starboard bench all --json

figures: setup  ## draw the figures of the thesis again, and those of the real ship, into figures/
	$(BIN)/starboard figures --out figures

campaigns: setup  ## identification through the whole system: 10 minutes and more, report in campaigns/
	$(BIN)/python -m benchmarks.campaigns --out campaigns

docs: setup  ## draw the generated parts of docs/ again
	$(BIN)/python -m services.generate

soak: setup  ## tests too long for CI
	$(BIN)/pytest -m soak --timeout=3600

fuzz: setup  ## nonsense on every key of a running star, half a minute
	$(BIN)/pytest -m soak tests/system/test_fuzz_star.py

lock:  ## renew requirements.lock from pyproject.toml (needs the package registry)
	$(PYTHON) -m venv $(VENV)/lock && $(VENV)/lock/bin/pip install --quiet uv
	$(VENV)/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --extra dev --generate-hashes --no-emit-index-url \
	  --custom-compile-command "make lock" pyproject.toml -o requirements.lock

clean:  ## remove what make made, but no recording
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
