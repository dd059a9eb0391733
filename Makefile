# firstfix. `make demo` shows it, `make test` proves it; both set up what they need.
.PHONY: setup native console release demo test test-slow test-all lint docs docs-outputs lab paper scoreboard bench faults lock test-servers all-test-servers clean
.DEFAULT_GOAL := help
bin := .venv/bin
# Four files' tests at a time, as tests often wait; PYTEST_ARGS="-k name" or a path narrows a run.
PYTEST_ARGS ?= -n 4 --dist loadfile --no-loadscope-reorder
# A run that takes longer (seconds) is ended, with the stacks of what hangs.
TEST_LIMIT_S ?= 10800
run_tests := PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/python tests/harness/reaper.py --limit-s $(TEST_LIMIT_S) $(bin)/python -m pytest
# The compiled core, the console and the servers side by side: each alone leaves a processor idle, or waits for a network.
ifeq ($(MAKELEVEL),0)
MAKEFLAGS += --jobs=3
endif

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: .venv/.ready native console  ## make .venv from the locks (system libraries too, where it may)
.venv/.ready: pyproject.toml deploy/locks/setup.txt deploy/locks/dev.txt deploy/locks/ouster.txt scripts/setup.sh
	@scripts/setup.sh

native: build/.native  ## build the compiled core anew, where a source has changed
build/.native: .venv/.ready scripts/native.sh $(shell find native -name '*.[ch]pp' -o -name 'CMake*' -o -name '*.cmake')
	@scripts/native.sh
	@touch $@

console: .venv/.ready  ## build the console's page anew, where a source has changed
	@plugins/console/build.sh

demo: setup  ## a map in, a version published, poses out over HTTP and zenoh (OPEN=1: stays up, with the console)
	@$(bin)/python -m firstfix_lab.demo

lint: setup  ## style, types, and who may import whom
	@$(bin)/ruff check .
	@$(bin)/ruff format --check .
	@$(bin)/lint-imports --no-logo
	@$(bin)/mypy

test: setup test-servers lint  ## lint, then the tests that show what firstfix promises: twelve minutes on 2 cores
	@$(run_tests) $(PYTEST_ARGS) -m "not slow"

test-slow: setup all-test-servers  ## the other tests: images, drills, sanitizers, long tours, all ROS 2 distributions
	@$(run_tests) $(PYTEST_ARGS) -m slow

test-all:  ## `make test`, then `make test-slow`; what both build is built once
	@export ONCE_A_RUN=$$(mktemp -d) && trap 'rm -rf "$$ONCE_A_RUN"' EXIT \
	  && $(MAKE) --no-print-directory test && $(MAKE) --no-print-directory test-slow

test-servers: .venv/.ready  ## the real servers of `make test`: S3, JetStream, MQTT, Chromium, ROS 2 Jazzy
	@scripts/test-servers.sh

all-test-servers: .venv/.ready  ## those of `make test-slow` too: Azure, toxiproxy, HAProxy, helm, ROS 2 Kilted
	@scripts/test-servers.sh all

lab: setup all-test-servers  ## a suite or a drill of the lab (ARGS="real --quick", ARGS="power_cuts --cuts 50", ARGS=--help)
	@PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/firstfix-lab $(ARGS)

paper: setup  ## the paper's tables and figures, measured
	@PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/firstfix-lab paper $(ARGS)

scoreboard: setup $(if $(findstring --check,$(ARGS)),,all-test-servers)  ## measure this commit for the pages (ARGS="real peers", ARGS=--quick, ARGS=--check)
	@PATH="$(CURDIR)/$(bin):$$PATH" $(bin)/firstfix-lab scoreboard $(ARGS)
	@$(if $(findstring --check,$(ARGS)),,$(bin)/python scripts/generate.py)

bench faults:  # until 0.2
	@echo "make $@ is now: make lab ARGS=\"$(ARGS)\"" >&2; exit 2

docs: setup  ## the documentation site, in build/site
	@NO_MKDOCS_2_WARNING=1 $(bin)/mkdocs build --strict --quiet
	@echo "docs: open build/site/index.html, or: $(bin)/mkdocs serve"

docs-outputs: setup  ## the printed outputs of the tutorials, made by running them (some minutes)
	@$(bin)/python scripts/docs_outputs.py $(ARGS)

lock: setup  ## resolve deploy/locks anew (LOCK_ARGS=--upgrade for newer releases)
	@scripts/lock.sh $(LOCK_ARGS)

release:  ## the wheels of a release in dist/, tried in clean environments (PYTHONS="3.11 3.12")
	@scripts/release.sh

clean:  ## remove what the targets above made
	rm -rf .venv build dist demo .*_cache core/firstfix/native/_*.so plugins/console/page/node_modules plugins/console/firstfix_console/files
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
