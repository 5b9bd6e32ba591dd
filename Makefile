# `make demo` and `make test` work on a bare Debian or Ubuntu with Python 3.11-3.13 and make; see README.md.
# PYTHON picks the interpreter; the environment lives in .venv.
PYTHON ?= $(shell for p in python3 python3.12 python3.11 python3.13; do $$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
# where it is set (containers), each of the hundred processes that tests start would compile our 550 modules anew: 1.3 s
export PYTHONDONTWRITEBYTECODE :=
RUN := $(VENV)/bin/python

.PHONY: demo test check docs gallery setup setup-dev packages packages-dev clean bench

demo: $(VENV)/.installed
	$(VENV)/bin/scan2fea demo -o out-demo

test: $(VENV)/.installed-dev
	OMP_NUM_THREADS=1 $(RUN) -m pytest -n 2

# what CI runs before the tests: lint, types, layers
check: $(VENV)/.packages-dev
	$(VENV)/bin/ruff check
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

bench: $(VENV)/.installed-dev
	for file in benchmarks/*.py; do echo "== $$file"; OMP_NUM_THREADS=1 $(RUN) $$file || exit 1; done

# the site, in site/; an error where a link or a picture leads nowhere
docs: $(VENV)/.installed-dev
	$(RUN) docs/make_site.py site

# the examples, and the page and pictures that they make (some minutes)
gallery: $(VENV)/.installed-dev
	OMP_NUM_THREADS=1 $(RUN) examples/make_gallery.py

setup: $(VENV)/.installed
setup-dev: $(VENV)/.installed-dev
packages: $(VENV)/.packages
packages-dev: $(VENV)/.packages-dev

$(VENV)/.packages: pyproject.toml requirements.lock system.sh
	@[ -n "$(PYTHON)" ] || { echo "no Python 3.11, 3.12 or 3.13 found: install one, or name it: make PYTHON=/path/to/python3.12" >&2; exit 1; }
	PYTHON=$(PYTHON) sh ./system.sh run
	$(PYTHON) -m venv $(VENV)
	@# not all 5,000 modules at once on one core (half a minute): Python compiles those that are imported
	$(RUN) -m pip install --quiet --no-compile -r requirements.lock
	$(RUN) -m pip install --quiet --no-deps -e .
	touch $@

$(VENV)/.packages-dev: $(VENV)/.packages requirements-dev.lock
	sh ./system.sh test
	$(RUN) -m pip install --quiet --no-compile -r requirements-dev.lock
	touch $@

$(VENV)/.installed: $(VENV)/.packages
	@echo "compiling the kernels once (two to four minutes)"
	$(RUN) -m scan2fea.pipeline.warm
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed $(VENV)/.packages-dev
	touch $@

clean:
	rm -rf $(VENV) out-demo build dist site
