# firstfix. `make demo` shows it, `make test` proves it; both set up what they need.
.PHONY: setup native console demo test test-fast lint docs bench scoreboard faults lock test-servers clean
.DEFAULT_GOAL := help
bin := .venv/bin
# Four files' tests at a time, as tests often wait; PYTEST_ARGS="-k name" or a path narrows a run.
PYTEST_ARGS ?= -n 4 --dist loadfile --no-loadscope-reorder
# A run that takes longer (seconds) is ended, with the stacks of what hangs. On 2 cores it takes some 36 minutes.
TEST_LIMIT_S ?= 10800
run_tests := PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/python tests/harness/reaper.py --limit-s $(TEST_LIMIT_S) $(bin)/python -m pytest
FAST := $(addprefix tests/, core builder service client cli ros2 house)

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: .venv/.ready native console  ## make .venv from the locks (system libraries too, where it may)
.venv/.ready: pyproject.toml deploy/locks/setup.txt deploy/locks/dev.txt scripts/setup.sh
	@scripts/setup.sh

native: build/.native  ## build the compiled core anew, where a source has changed
build/.native: .venv/.ready scripts/native.sh $(shell find native -name '*.[ch]pp' -o -name 'CMake*' -o -name '*.cmake')
	@scripts/native.sh
	@touch $@

console: .venv/.ready  ## build the console's page anew, where a source has changed
	@scripts/console.sh

demo: setup  ## a map in, a version published, poses out over HTTP and zenoh (OPEN=1: stays up, with the console)
	@$(bin)/python -m firstfix_cli.demo

lint: setup  ## style, types, and who may import whom
	@$(bin)/ruff check .
	@$(bin)/ruff format --check .
	@$(bin)/lint-imports --no-logo
	@$(bin)/mypy

test: setup test-servers lint  ## lint, then every test
	@$(run_tests) $(PYTEST_ARGS)

test-fast: setup  ## the quick tests, for the edit loop
	@$(run_tests) -n 4 --dist loadfile -m "not slow" $(FAST)

test-servers: .venv/.ready  ## an S3 server for the storage tests, where Go is there to build it
	@scripts/test-servers.sh

bench: setup  ## the suites of benchmarks/ (ARGS="real --quick")
	@PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/python -m benchmarks.run $(ARGS)

scoreboard: setup $(if $(findstring --check,$(ARGS)),,test-servers)  ## measure this commit for the pages (ARGS="real peers", ARGS=--quick, ARGS=--check)
	@PATH="$(CURDIR)/$(bin):$$PATH" PYTHONPATH=tests $(bin)/python -m benchmarks.scoreboard $(ARGS)
	@$(if $(findstring --check,$(ARGS)),,$(bin)/python scripts/generate.py)

faults: setup test-servers  ## the fault drills of tests/faults (ARGS="power_cuts --cuts 50")
	@PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/python -m tests.faults $(ARGS)

docs: setup  ## the documentation site, in build/site
	@NO_MKDOCS_2_WARNING=1 $(bin)/mkdocs build --strict --quiet
	@echo "docs: open build/site/index.html, or: $(bin)/mkdocs serve"

lock: setup  ## resolve deploy/locks anew (LOCK_ARGS=--upgrade for newer releases)
	@scripts/lock.sh $(LOCK_ARGS)

clean:  ## remove what the targets above made
	rm -rf .venv build dist demo .*_cache core/firstfix/native/_*.so console/node_modules service/firstfix_service/console_files
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
