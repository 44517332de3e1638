# The whole project on a machine with Python 3.11 or newer and make:
#   make demo    the main job, on a recording that the project makes itself; prints where report.html is
#   make test    everything installed, the tests of less than about a second each
#   make test-all all tests
#   make check   style, formatting, types, which part imports which
#   make docs    the site, from docs/ into out/site/; warnings are errors
#   make bench   the benchmarks' quick samples
#   make libraries  the compiled steps that a wheel can hold, into out/libraries/: about ten minutes
#   make mutants whether the tests notice mistakes: about two hours on two cores
PYTHON ?= python3
VENV ?= .venv
OUT ?= out/demo
BIN = $(VENV)/bin

.PHONY: demo test test-all check docs bench libraries mutants clean

demo: $(VENV)/.runs
	@mkdir -p $(OUT)
	@$(BIN)/python -c "from ergoqp.mocap.demo_recording import demo_recording; demo_recording('$(OUT)/demo.bvh')"
	@$(BIN)/ergoqp run screwing --from $(OUT)/demo.bvh --out $(OUT)
	@echo
	@echo "The report is in $(abspath $(OUT))/report.html"

test: $(VENV)/.tests
	$(BIN)/python -m pytest -n 2 --dist loadscope -m "not slow"

test-all: $(VENV)/.tests
	$(BIN)/python -m pytest -n 2 --dist loadscope

check: $(VENV)/.tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/python -m tools.house --check

docs: $(VENV)/.tests
	rm -rf out/site
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d out/doctrees docs out/site
	$(BIN)/python -m tools.site --check
	@echo "The site is in $(abspath out/site)/index.html"

bench: $(VENV)/.tests
	@for file in benchmarks/*.py; do \
		name=$$(basename $$file .py); \
		grep -q '__name__ == "__main__"' $$file || continue; \
		echo "== benchmarks.$$name"; \
		$(BIN)/python -m benchmarks.$$name --quick || exit 1; \
	done

libraries: $(VENV)/.tests
	$(BIN)/python -m tools.libraries --out out/libraries

mutants: $(VENV)/.tests
	$(BIN)/python -m tools.mutants --full

clean:
	rm -rf $(VENV) out

# What is installed follows from pyproject.toml; the code itself is not copied, so it is always the checkout's.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(v < (3, 11) and "Python 3.11 or newer is needed, %s is %d.%d; make PYTHON=... names another" % (sys.executable, v[0], v[1]))'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.runs: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[report]'
	@touch $@

$(VENV)/.tests: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@ $(VENV)/.runs
