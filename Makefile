# `make demo` and `make test` do everything on a fresh machine: environment, pinned packages, run.
# The best Python that is here; another one by `make test PYTHON=python3.12`.
PYTHON = $(shell .ci/pythons "$$(.ci/pythons | head -n 1)")
OTHERS = $(shell .ci/pythons | tail -n +2)
BIN := .venv/bin
WORKERS ?= 2
# Files are handed out in the order of their names: sorted by their number of tests, long ones would come last.
SHARED := --dist loadfile --no-loadscope-reorder
# Modules are compiled when they are first imported; most of them never are.
INSTALL := install --quiet --no-compile

# What a Python without PyTorch can run; tests in these files that need a network are marked `network`.
WITHOUT_NETWORK := cpd cpd_input expectation field kernels latent_fit shape_space storage \
  collision engines files formats frames grasps gripper gripper_urdf meshes poses refine simulation \
  solids warping camera
LIGHT_TESTS := $(WITHOUT_NETWORK:%=tests/test_%.py)

.PHONY: demo test soak soak-arguments soak-faults soak-load soak-short lint test-pythons test-pythons-light test-package docs audit lock clean system
.SECONDARY:

demo: .venv/ready system
	$(BIN)/grasptransfer demo --out demo_out

test: .venv/ready system
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) $(SHARED)

# Damaged files of every format that is read: 20,000 each in hours (it goes on where it stopped), 300 each in CI.
soak: .venv/ready
	$(BIN)/python -m grasptransfer.workshop.soak --out runs/soak
# Any arguments, commands that are killed at random moments, and thousands of transfers; hours each.
soak-arguments soak-faults soak-load: soak-%: .venv/ready
	$(BIN)/python -m grasptransfer.workshop.soak $* --out runs/soak
soak-short: .venv/ready
	$(BIN)/python -m grasptransfer.workshop.soak --out $$(mktemp -d) --files 300

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/mypy --strict tests/user_program.py

# The whole suite on every Python found here. PyTorch is a download of some gigabytes for each of the others.
test-pythons: test $(OTHERS:%=whole-suite-%)
whole-suite-%: .venv-%/whole system
	OMP_NUM_THREADS=1 .venv-$*/bin/python -m pytest -n $(WORKERS) $(SHARED)

# Registration, grasping, formats and simulation on the other Pythons found here, without PyTorch.
test-pythons-light: $(OTHERS:%=light-suite-%)
	@echo "Other Pythons found here: $(or $(OTHERS),none)"
light-suite-%: .venv-%/light
	OMP_NUM_THREADS=1 .venv-$*/bin/python -m pytest $(LIGHT_TESTS) -m "not network and not full"

# The source package, the wheel made of it, and demo and example from the wheel alone, outside this checkout.
test-package: .venv/ready system
	rm -rf dist
	$(BIN)/python -m build --outdir dist
	set -e; folder=$$(mktemp -d); trap 'rm -rf "$$folder"' EXIT; \
	  $(BIN)/python -m venv "$$folder/venv"; \
	  "$$folder/venv/bin/pip" $(INSTALL) --constraint constraints.txt dist/*.whl; \
	  cd "$$folder"; venv/bin/grasptransfer demo --out demo_out; \
	  venv/bin/grasptransfer examples first; cd first; ../venv/bin/python 01_transfer_and_execute.py --quick

# The documentation as pages, in site/; a warning is an error.
docs: .venv/ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

audit: .venv/ready
	$(BIN)/python .ci/audit.py

# One version of each package for each Python. What PyTorch brings for graphics cards follows PyTorch's own pins.
lock: .venv/ready
	$(BIN)/python -m venv .venv-lock
	.venv-lock/bin/pip $(INSTALL) uv
	.venv-lock/bin/uv pip compile --quiet --universal --python-version 3.10 --all-extras --no-header \
	  --no-annotate pyproject.toml --output-file .venv-lock/pins.txt
	{ head -n 1 constraints.txt; grep -vE '^(nvidia-|cuda-|triton)' .venv-lock/pins.txt; } > .venv-lock/constraints.txt
	mv .venv-lock/constraints.txt constraints.txt

# An environment is ready only once every package is in: an interrupted set-up starts again.
.venv/ready: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "Python 3.10 to 3.13 with venv is missing: \
	sudo apt-get install python3 python3-venv"; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip $(INSTALL) --constraint constraints.txt --editable ".[dev]"
	touch .venv/ready

.venv-%/light: pyproject.toml constraints.txt
	"$$(.ci/pythons $*)" -m venv .venv-$*
	grep -v '^torch==' constraints.txt > .venv-$*/pins.txt
	.venv-$*/bin/pip $(INSTALL) --no-deps --requirement .venv-$*/pins.txt --editable .
	touch $@

.venv-%/whole: .venv-%/light
	.venv-$*/bin/pip $(INSTALL) --constraint constraints.txt --editable ".[dev]"
	touch $@

system: .venv/ready
	@$(BIN)/python -c "import ctypes.util, sys; \
	  sys.exit(None if ctypes.util.find_library('EGL') and ctypes.util.find_library('GL') else \
	  'EGL is missing (offscreen rendering): sudo apt-get install libegl1 libgl1 libgl1-mesa-dri')"

clean:
	rm -rf .venv .venv-* dist demo_out site
