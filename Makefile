# make demo   plan and polish a shipped part, with a short report
# make test   the test suite
# make check  lint, format, layers, types, wording
# make bench  speeds as ratios
# make docs   the site in build/docs: every example and code block runs
# make wheel  a wheel with its kernels compiled, for this Python and platform
# make clean  remove what the other targets made (run folders in results/ stay)

CANDIDATES := $(PYTHON) python3.11 python3.12 python3.13 python3.14 python3 python
FIND_PYTHON = for p in $(CANDIDATES); do \
	if $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then echo $$p; exit; fi; done
VENV := .venv
BIN := $(VENV)/bin
TREE := build/tree

# Without compiled files every started Python parses the package anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check bench docs site wheel clean
.DELETE_ON_ERROR:

demo: $(VENV)/.installed
	$(BIN)/polish-sim demo

# To rewrite asserts, so that a failure shows its values, takes every process longer than to import all else:
# what fails is run once more for them.
test: $(VENV)/.installed
	@$(BIN)/python -m pytest --assert=plain || \
		{ code=$$?; [ $$code != 1 ] || $(BIN)/python -m pytest --last-failed -n 0; exit $$code; }

check: $(VENV)/.installed $(VENV)/.docs
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/python .ci/assemble.py $(TREE)
	PYTHONPATH=$(TREE) $(BIN)/lint-imports
	MYPYPATH=$(TREE) $(BIN)/mypy --package polish_sim
	$(BIN)/python -m pytest -q -n 0 tests/test_architecture.py -k phrases
	DOCS_QUICK=1 $(MAKE) --no-print-directory site

bench: $(VENV)/.installed
	$(BIN)/python -m benchmarks

docs: $(VENV)/.docs
	$(MAKE) --no-print-directory site
	$(BIN)/python docs/run_blocks.py

# The pages alone; with DOCS_QUICK=1 without running the examples.
site:
	rm -rf build/docs docs/tutorials
	$(BIN)/python -m sphinx -W --keep-going -q docs build/docs
	$(BIN)/python docs/check_links.py build/docs

wheel: $(VENV)/.installed
	$(BIN)/python .ci/build_wheel.py

clean:
	rm -rf $(VENV) build dist docs/tutorials *.egg-info .pytest_cache .ruff_cache .mypy_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.installed: pyproject.toml
	@python=$$($(FIND_PYTHON)); \
	if [ -z "$$python" ]; then \
		echo "error: Python 3.11 or newer with venv is needed; name one with: make PYTHON=/path/to/python" >&2; exit 2; fi; \
	echo "$$python -m venv $(VENV)"; $$python -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(BIN)/python -m compileall -q src cli models
	touch $@

# What the site is made with: an extra that only its targets install.
$(VENV)/.docs: $(VENV)/.installed
	$(BIN)/python -c 'import sphinx, furo, myst_parser, sphinx_gallery, ziamath' 2>/dev/null || \
		$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@
