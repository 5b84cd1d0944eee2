# granite-lab: `make study` runs the main job on data/samples, `make test` passes the tests.
# Each target sets up .venv by itself; nothing but Python 3.11 or newer and make is needed.
# Another Python than python3: make PYTHON=python3.13 study

PYTHON ?= python3
BIN := .venv/bin
USE := .venv/.use-installed
DEV := .venv/.dev-installed
MINOR := "import sys; print('%d.%d' % sys.version_info[:2])"

.PHONY: help python study smoke test lint types bench bench-simulator bench-estimation bench-many blind mixtures peers outside outside-variants real validation soak samples joystick clean

help:
	@echo "make study             analyse data/samples, write reports/samples/index.html"
	@echo "make smoke             run every command once"
	@echo "make test              ruff, mypy and all tests"
	@echo "make bench             measure speed and accuracy, up to 1,200 trials (an hour), write docs/bench-*.md"
	@echo "make soak              the tests whose long parts are only sampled by make test, whole"
	@echo "make blind             hidden sets of a frozen range for discover (two hours), write docs/blind.md"
	@echo "make mixtures          100 mixtures of hidden effects (hours), write docs/blind-mixtures.md"
	@echo "make peers             discover beside two peers that learn the residual (hours), write docs/peers.md"
	@echo "make joystick          joystick runs, also with a controller that is not known (an hour), write docs/joystick.md"
	@echo "make outside DIR=...   judge discover by trials of other programs (DRIVE=wheels: driven by their wheels)"
	@echo "make outside-variants  the same trials as other loggers would have written them (an hour)"
	@echo "make real DATA=...     public trials of other robots through the whole chain, write docs/real-trials.md"
	@echo "make validation        hold the contact model against measured wheels, write docs/validation.md"
	@echo "make samples           write the virtual sample trials again"
	@echo "make clean             remove .venv and all caches"

# Packages that one Python has installed cannot be used by another.
python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "error: $(PYTHON) is not there or older than 3.11"; \
		echo "hint: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv --clear .venv
	@test "$$($(PYTHON) -c $(MINOR))" = "$$($(BIN)/python -c $(MINOR))" || \
		{ echo "error: .venv was made by Python $$($(BIN)/python -c $(MINOR)), not by $(PYTHON)"; \
		echo "hint: make clean"; exit 1; }

$(USE): pyproject.toml | python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(DEV): pyproject.toml | python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@ $(USE)

study: $(USE)
	$(BIN)/granite-lab study data/samples --out reports/samples

smoke: $(USE)
	$(BIN)/python tests/smoke.py

test: lint types $(DEV)
	$(BIN)/python -m pytest -n 2 --dist worksteal

lint: $(DEV)
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(DEV)
	$(BIN)/mypy

soak: $(DEV)
	GRANITE_SOAK=1 $(BIN)/python -m pytest -n 2 --dist worksteal -rP

bench: bench-simulator bench-estimation bench-many

bench-simulator: $(DEV)
	$(BIN)/python -m benchmarks.simulator --out docs/bench-simulator.md

bench-estimation: $(DEV)
	$(BIN)/python -m benchmarks.estimation --out docs/bench-estimation.md

bench-many: $(DEV)
	$(BIN)/python -m benchmarks.many_trials --counts 12,120,1200 --out docs/bench-many.md

blind: $(DEV)
	$(BIN)/python -m benchmarks.blind --minutes 120 --jobs 2 --out docs/blind.md

mixtures: $(DEV)
	$(BIN)/python -m benchmarks.mixtures --jobs 2 --out docs/blind-mixtures.md

joystick: $(DEV)
	$(BIN)/python -m benchmarks.joystick --jobs 2 --out docs/joystick.md

DIR ?= ../shared/outside
DRIVE ?= auto

outside: $(DEV)
	$(BIN)/python -m benchmarks.outside $(DIR) --jobs 2 --drive $(DRIVE)

PEERS ?= ../shared

peers: $(DEV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,peers]'
	$(BIN)/python -m benchmarks.peers --outside $(PEERS)/outside --mixtures $(PEERS)/mixtures --jobs 2 \
		--out docs/peers.md

real: $(DEV)
	$(BIN)/python -m benchmarks.real_trials --data $(DATA)

outside-variants: $(DEV)
	rm -rf build/outside-variants
	$(BIN)/python -m benchmarks.outside_variants build/outside-variants $(DIR)
	$(BIN)/python -m benchmarks.outside build/outside-variants --jobs 2

validation: $(USE)
	$(BIN)/python -m benchmarks.validation --out docs/validation.md

samples: $(USE)
	sh data/make-samples.sh $(BIN)/granite-lab

clean:
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .hypothesis build dist
