# Two commands: `make demo` records a demo drive, `make test` runs the tests.
PYTHON ?= python3
FUZZ_SECONDS ?= 600
BIN := .venv/bin
# an editable install knows the modules that were there: a new name installs again, an edit does not
NAMES := $(shell mkdir -p build && find recorder -name '*.py' | sort > build/names.new && \
           { cmp -s build/names.new build/names || mv build/names.new build/names; }; echo build/names)
SOURCES := pyproject.toml CMakeLists.txt $(wildcard recorder/kernels/*.cpp recorder/kernels/*.hpp) $(NAMES)
# the GenICam driver's bindings are built where the libraries for it are there; the demo does without
ARAVIS := $(shell pkg-config --exists gobject-introspection-1.0 cairo 2>/dev/null && ls /usr/lib/*/girepository-1.0/Aravis-0.8.typelib >/dev/null 2>&1 && echo '[aravis]')
PIP := $(BIN)/pip install -q --disable-pip-version-check

.PHONY: demo test lint fuzz bench proto clean
demo: .venv/demo.stamp
	$(BIN)/recorder demo

test: .venv/test.stamp
	$(BIN)/pytest

lint: .venv/test.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

fuzz:
	@tools/debian_packages.sh fuzz $(PYTHON)
	tools/fuzz.sh $(FUZZ_SECONDS)

bench: .venv/bench.stamp
	$(BIN)/python tools/bench/figures.py

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make PYTHON=python3.11 ..." >&2; exit 1; }
	@$(PYTHON) -m venv .venv

.venv/demo.stamp: $(SOURCES) tools/debian_packages.sh
	@tools/debian_packages.sh demo $(PYTHON)
	@$(MAKE) --no-print-directory .venv/bin/python
	@echo "building and installing into .venv, a minute or two"
	@$(PIP) -e '.$(ARAVIS)'
	@touch $@

.venv/test.stamp: $(SOURCES) tools/debian_packages.sh
	@tools/debian_packages.sh test $(PYTHON)
	@$(MAKE) --no-print-directory .venv/bin/python
	@echo "building and installing into .venv, a minute or two"
	@$(PIP) -e '.[test,aravis]'
	@touch $@ .venv/demo.stamp

.venv/bench.stamp: $(SOURCES) tools/debian_packages.sh
	@tools/debian_packages.sh test $(PYTHON)
	@$(MAKE) --no-print-directory .venv/bin/python
	@echo "building and installing into .venv, with the peers of the benches, a minute or two"
	@$(PIP) -e '.[test,aravis,bench]'
	@touch $@ .venv/test.stamp .venv/demo.stamp

clean:
	rm -rf .venv build .mypy_cache .ruff_cache .pytest_cache
