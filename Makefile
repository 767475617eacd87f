# The commands of this project. Everything runs in .venv, which `setup` makes and keeps in step with the lock file.
#   make setup PYTHON=python3.12     uses that interpreter
#   make test ARGS="tests/unit -k knots"   passes ARGS to pytest (demo and bench take ARGS too)
SHELL := /bin/bash
BIN := .venv/bin
PACKAGES := cellctl planner drivers sim config
ARGS ?=
export PYTHON

.DEFAULT_GOAL := help
.PHONY: help setup demo test bench lint console lock clean

help: ## show these commands
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' Makefile | while IFS=$$'\t' read -r name what; do printf 'make %-8s %s\n' "$$name" "$$what"; done

setup: ## make .venv and build the console, as far as they are not up to date
	@.setup/setup.sh

demo: setup ## a simulated cell builds a part, from upload to measured result
	@$(BIN)/cellctl demo $(ARGS)

test: setup ## all tests except the slow ones, on two cores; the architecture is one of them
	@.setup/install_debian.sh
	@.setup/run_tests.sh $(ARGS)

bench: ## measure and print tables (also in tests/bench/results)
	@.setup/setup.sh bench
	@$(BIN)/python -m tests.bench $(ARGS)

lint: setup ## ruff, mypy --strict, import contracts
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo

console: setup ## build the operator's page if its sources changed
	@$(BIN)/python cellctl/console/build.py

lock: setup ## write .setup/requirements.txt anew from pyproject.toml
	@.setup/lock.sh

clean: ## remove what setup, tests and builds made; the next `make` starts from nothing
	@rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis tests/bench/results
	@rm -rf cellctl/console/dist cellctl/console/web/node_modules
	@find $(PACKAGES) tests -name __pycache__ -type d -prune -exec rm -rf {} +
