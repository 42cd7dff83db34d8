# `make demo` and `make test` need only Python >= 3.10 and make; the first one run installs.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
WORKERS ?= auto
STAMP := $(VENV)/.installed

.PHONY: demo test test-long test-notebooks lint types docs figures dist install clean

demo: $(STAMP)
	$(BIN)/mitsuba-restir compare ajar --equal-time 4 -o out/demo

test: $(STAMP)
	$(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 4 --dist worksteal $(ARGS)

test-long: $(STAMP)
	$(BIN)/python -m pytest -m long $(ARGS)

test-notebooks: $(STAMP)
	$(BIN)/python -m pytest -m notebooks $(ARGS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

docs: $(STAMP)
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

figures: $(STAMP)
	$(BIN)/python docs/teaser.py
	$(BIN)/python docs/run_notebooks.py
	$(BIN)/python docs/growth.py

dist: $(STAMP)
	$(BIN)/python docs/try_wheel.py

install: $(STAMP)

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "Python 3.10 or newer is needed: make PYTHON=/path/to/python3.10" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
		{ echo "No venv module: install it (Debian: sudo apt install python3-venv)" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,denoise]'
	@touch $@

clean:
	rm -rf $(VENV) out docs/_build dist
