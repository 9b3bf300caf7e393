# `make demo` and `make test` do all of the set-up themselves; Python >= 3.10 and a C++20 compiler are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
BENCH := .venv-bench
SOURCES := pyproject.toml CMakeLists.txt $(shell find src native -name '*.py' -o -name '*.pyi' -o -name '*.cpp' -o -name '*.hpp')

.PHONY: demo test lint docs bench native clean help

help:
	@echo "make demo    simulate a robot in a building, map it, open demo/overview.png"
	@echo "make test    lint, types and tests"
	@echo "make docs    build the documentation, open build/site/index.html"
	@echo "make bench   set up the peers and run the benchmarks (see benchmarks/README.md)"
	@echo "make native  build the native module in place, for developers (PYTHON=...)"

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip

$(VENV)/installed: $(BIN)/python $(SOURCES)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check .
	@touch $@

$(VENV)/installed-test: $(BIN)/python $(SOURCES)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check '.[test]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: $(BIN)/python $(SOURCES)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check '.[docs]'
	@touch $@ $(VENV)/installed

# The peers have wishes of their own (NumPy 1), so they live apart.
$(BENCH)/installed: $(SOURCES)
	test -d $(BENCH) || $(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade pip
	$(BENCH)/bin/python -m pip install --quiet --disable-pip-version-check '.[bench]'
	@touch $@

demo: $(VENV)/installed
	$(BIN)/clew demo -o demo

docs: $(VENV)/installed-docs
	$(BIN)/sphinx-build -W --keep-going -q -E -b html docs build/site

lint: $(VENV)/installed-test
	$(BIN)/ruff check src tests benchmarks examples docs
	$(BIN)/mypy

test: lint
	$(BIN)/python -m pytest -q

bench: $(BENCH)/installed
	for benchmark in backend engine lidar fleet landmarks; do $(BENCH)/bin/python benchmarks/$$benchmark.py || exit 1; done

native:
	cmake -S . -B build/inplace -DPython_EXECUTABLE=$$($(PYTHON) -c 'import sys; print(sys.executable)') -DCMAKE_BUILD_TYPE=Release
	cmake --build build/inplace --parallel 2

clean:
	rm -rf $(VENV) $(BENCH) build demo docs/drawings src/clew/*.so
