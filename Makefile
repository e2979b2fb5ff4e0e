# Everything is installed into .venv; PYTHON chooses the interpreter that makes it (3.11 or newer).
PYTHON ?= python3
WORKERS ?= 2
BIN := .venv/bin
INSTALLED := .venv/installed

.DEFAULT_GOAL := help
.PHONY: help install test torture lint smoke figures bench clean

help: ## show this list
	@grep -E '^[a-z]+:.*## ' Makefile | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 10

install: $(INSTALLED) ## install agfb and its development tools into .venv

$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check --editable '.[dev]'
	touch $@

test: $(INSTALLED) ## run the tests (WORKERS processes)
	$(BIN)/python -m pytest -n $(WORKERS)

torture: $(INSTALLED) ## kill 500 processes in every test of reliability, try 10000 configurations (hours)
	$(BIN)/python -m pytest tests/reliability --kills 500 --hypothesis-profile torture

lint: $(INSTALLED) ## check style and types
	$(BIN)/ruff check
	$(BIN)/mypy

smoke: $(INSTALLED) ## run the main job on configs/smoke.toml: build/smoke.zarr and figures
	$(BIN)/agfb run configs/smoke.toml -o build/smoke.zarr

figures: $(INSTALLED) ## draw the figures of build/smoke.zarr again
	$(BIN)/agfb figures build/smoke.zarr

bench: $(INSTALLED) ## measure the ratios that the README quotes: build/bench.json
	$(BIN)/python -m tests.benchmarks

clean: ## delete what the targets above made, except .venv
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find agfb_cli pipelines tests -name __pycache__ -type d -prune -exec rm -rf {} +
