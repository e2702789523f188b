# `make demo` and `make test` do everything on a fresh machine: environment, pinned packages, run.
PYTHON := $(firstword $(foreach p,python3.11 python3.10 python3,$(if $(shell command -v $(p)),$(p))))
BIN := .venv/bin
WORKERS ?= 2

.PHONY: demo test lint bench-cpd clean system
demo: .venv/ready system
	$(BIN)/grasptransfer demo --out demo_out

test: .venv/ready system
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath .venv/bin/python

# An environment is ready only once every package is in: an interrupted set-up starts again.
.venv/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; v = sys.version_info[:2]; sys.exit(None if v in ((3, 10), (3, 11)) else \
	  f'Python {v[0]}.{v[1]}: pybullet has wheels for 3.10 and 3.11; install python3.11 (apt-get install python3.11 python3.11-venv)')"
	$(PYTHON) -m venv .venv || { echo "venv is missing: apt-get install python3-venv"; exit 1; }
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[dev]"
	touch .venv/ready

system: .venv/ready
	@$(BIN)/python -c "import ctypes.util, sys; \
	  sys.exit(None if ctypes.util.find_library('EGL') and ctypes.util.find_library('GL') else \
	  'EGL is missing (offscreen rendering): sudo apt-get install libegl1 libgl1 libgl1-mesa-dri')"

clean:
	rm -rf .venv demo_out
