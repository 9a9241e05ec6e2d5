# Every target sets itself up: a virtual environment in the checkout, nothing outside it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: inflate test test-long kernels check format bench-sim bench-evolve bench-protocols bench-kill bench-gauge bench-faults bench-markers bench-vent bench-rig interop wire-table clean

inflate: $(INSTALLED)  ## the main job, on the simulated rig
	$(BIN)/labctl inflate --pattern sphere

# What computes, and what runs in virtual time, does not care how busy the machine is. What needs the machine's own time
# comes after it, one test after the other, beside a sleeper (tests/real_time.py).
test: $(INSTALLED)  ## every check and every test
	@$(MAKE) --no-print-directory --jobs 2 --output-sync check kernels
	$(BIN)/pytest -n 2 --dist loadfile -m "not real_time and not long"
	$(BIN)/pytest -m "real_time and not long"

test-long: $(INSTALLED) kernels  ## further cases of what `make test` shows once: about 6 minutes
	$(BIN)/pytest -n 2 --dist loadfile -m "long and not real_time"
	$(BIN)/pytest -m "long and real_time"

kernels: $(INSTALLED)  ## the compiled simulator, which each stream of tests would else compile for itself
	$(BIN)/python -c 'from sim.warm import compile_kernels as ready; [ready(print, solver, precision) \
	  for solver in ("equilibrium", "dynamic") for precision in ("float32", "float64")]'

check: $(INSTALLED)  ## style, types, who may import whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

bench-sim: $(INSTALLED)  ## the simulator's speed against its scalar oracle, about 6 minutes
	PYTHONPATH=tests $(BIN)/python bench/sim_speed.py

bench-evolve: $(INSTALLED)  ## the search against others, its operators and its speed: about an hour on 2 free cores
	$(BIN)/python bench/evolve_baselines.py --out runs/bench/baselines.json --plot runs/bench/baselines.png
	$(BIN)/python bench/evolve_operators.py --out runs/bench/operators.json
	$(BIN)/python bench/evolve_speed.py

bench-protocols: $(INSTALLED)  ## every protocol but inflate on doubles at 20 times their time: under 5 minutes
	$(BIN)/python bench/all_protocols.py

bench-kill: $(INSTALLED)  ## kill -9 at 200 random moments of a run: about half an hour
	$(BIN)/python bench/kill_run.py

bench-gauge: $(INSTALLED)  ## gauges that freeze, jitter, drift or are off, in virtual time: about 20 minutes
	$(BIN)/python bench/gauge_faults.py
	$(BIN)/python bench/gauge_offsets.py

bench-faults: $(INSTALLED)  ## unplugging, over-pressure and spoilt frames by the thousand: about two hours on 2 cores
	PYTHONPATH=tests $(BIN)/python bench/faults.py --out runs/bench/faults.json

bench-rig: $(INSTALLED)  ## ingest, recording and the supervisor under 72 markers at 960 Hz, then beside four busy loops: about half an hour
	$(BIN)/python bench/rig_load.py --busy 4 --out runs/bench/rig.json

interop: $(INSTALLED)  ## clients written elsewhere on the doubles, each in an environment of its own: about 3 minutes
	$(BIN)/python bench/interop/run.py

wire-table: $(INSTALLED)  ## docs/reference/wire-faults.md anew: every driver, wire fault and verb, about 10 s
	PYTHONPATH=tests $(BIN)/python bench/wire_table.py

bench-vent: $(INSTALLED)  ## vent and abort from a second terminal, in every step of every command: about half an hour
	$(BIN)/python bench/second_terminal.py

bench-markers: $(INSTALLED)  ## 1 000 random things that markers do, and whether a height is ever wrong: about 10 minutes
	PYTHONPATH=tests $(BIN)/python bench/marker_faults.py

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("labctl needs Python 3.11 or newer; this is " + sys.version.split()[0] + ". Name another: make PYTHON=python3.12") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
