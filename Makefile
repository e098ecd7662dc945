# Developer shortcuts; the README's two commands need none of them.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: build test slow lint types docs check clean

build:  ## virtual environment with the package as it stands in this tree
	$(PYTHON) -m venv .venv
	$(BIN)/pip install -q '.[dev]'

test:
	$(BIN)/pytest -n auto

slow:  ## what `test` leaves out: long diagnoses, and logs that others measured where they are at hand
	$(BIN)/pytest -n auto -m slow

lint:
	$(BIN)/ruff check .

types:
	$(BIN)/mypy --python-executable $(BIN)/python

docs:  ## the pages, in build/docs
	$(BIN)/mkdocs build -q --strict -f docs/mkdocs.yml

check: build lint types docs test

clean:
	rm -rf .venv build dist .pytest_cache .hypothesis .mypy_cache .ruff_cache gms_mujoco/native/*.so
