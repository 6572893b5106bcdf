# make demo   plan and polish a shipped part, with a short report
# make test   the test suite
# make check  lint, format, layers, types
# make bench  speeds as ratios
# make wheel  a wheel with its kernels compiled, for this Python and platform
# make clean  remove what the other targets made (run folders in results/ stay)

CANDIDATES := $(PYTHON) python3.11 python3.12 python3.13 python3.14 python3 python
FIND_PYTHON = for p in $(CANDIDATES); do \
	if $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then echo $$p; exit; fi; done
VENV := .venv
BIN := $(VENV)/bin
TREE := build/tree

.PHONY: demo test check bench wheel clean
.DELETE_ON_ERROR:

demo: $(VENV)/.installed
	$(BIN)/polish-sim demo

test: $(VENV)/.installed
	$(BIN)/python -m pytest

check: $(VENV)/.installed
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/python .ci/assemble.py $(TREE)
	PYTHONPATH=$(TREE) $(BIN)/lint-imports
	MYPYPATH=$(TREE) $(BIN)/mypy --package polish_sim

bench: $(VENV)/.installed
	$(BIN)/python -m benchmarks

wheel: $(VENV)/.installed
	$(BIN)/python .ci/build_wheel.py

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.installed: pyproject.toml
	@python=$$($(FIND_PYTHON)); \
	if [ -z "$$python" ]; then \
		echo "error: Python 3.11 or newer with venv is needed; name one with: make PYTHON=/path/to/python" >&2; exit 2; fi; \
	echo "$$python -m venv $(VENV)"; $$python -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(BIN)/python -m compileall -q src cli models
	touch $@
