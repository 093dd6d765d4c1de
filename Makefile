# Two commands on a fresh machine: `make demo` and `make test`. Both need Python >= 3.11 and pip.
PYTHON ?= python3
VENV := .venv
PIP := $(VENV)/bin/pip install --quiet --disable-pip-version-check -c constraints.txt
DEMO := hil-runs/demo-$(shell date +%Y%m%d-%H%M%S)

.PHONY: demo test fuzz mutation protocol-mutation golden bench bench-train time-to-gait lint typecheck setup clean

# What the emulator and the daemon need; no torch.
demo: $(VENV)/.hil
	$(VENV)/bin/rmll-hil run --policy policies/trot.onnx --seconds 20 --vx 0.5 --out $(DEMO)

test: setup
	$(VENV)/bin/pytest -n 2 --dist worksteal

# Everything that reads packets, files or messages, with hostile input for some minutes.
fuzz: setup
	HYPOTHESIS_PROFILE=fuzz $(VENV)/bin/pytest -m fuzz

# Does a test notice when the safety code is changed? Minutes; what may survive: docs/testing.md.
mutation: setup
	$(PIP) mutmut==3.8.1
	$(VENV)/bin/python tests/mutation/run.py

# Does a test notice when the runtime gets a packet's fields wrong? Some minutes.
protocol-mutation: setup
	$(VENV)/bin/python tests/mutation/protocol.py

# Timings; run them on an idle machine.
bench-train: setup
	$(VENV)/bin/python tests/benchmarks/bench_precision.py

# Hours: steps and minutes until each of the paper's gaits is useful; an interrupted one goes on.
time-to-gait: setup
	$(VENV)/bin/python -m rmll_train.time_to_gait --out time-to-gait.jsonl

bench: setup
	$(VENV)/bin/pytest -o addopts=--import-mode=importlib tests/benchmarks --benchmark-only -s

# Renew the logs that today's daemon must replay, after a change that was meant.
golden: setup
	$(VENV)/bin/python -m rmll_hil.golden

lint: setup
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

typecheck: setup
	$(VENV)/bin/pyright

# Everything: training, export, emulator, tests.
setup: $(VENV)/.dev

$(VENV)/.hil: pyproject.toml constraints.txt
	test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[hil]'
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt
	test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[dev]'
	touch $@ $(VENV)/.hil

clean:
	rm -rf $(VENV) hil-runs mutation
