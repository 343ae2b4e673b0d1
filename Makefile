# Needs make, Python 3.10 or later with venv, cargo and a C linker; everything else is set up here,
# in .venv and target.

.DEFAULT_GOAL := help
.PHONY: help demo test test-all test-slow test-release bench bench-fast bench-compare experiments lint format docs fuzz build clean
.NOTPARALLEL:
SHELL := /bin/sh

# rustup's default folder, for shells without it in their PATH.
export PATH := $(PATH):$(HOME)/.cargo/bin
export VIRTUAL_ENV := $(CURDIR)/.venv
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Python compiles the modules that it loads; pip would compile all.
export PIP_NO_COMPILE := 1
export PIP_QUIET := 1
unexport PYTHONHOME
unexport PYTHONPATH

VENV_PYTHON := .venv/bin/python
# Stamps of installations: the package as users have it; the requirements of tests and lints; those
# of the pages; the core as in wheels.
READY := .venv/.trisquare-ready
DEV_READY := .venv/.trisquare-dev-ready
DOCS_READY := .venv/.trisquare-docs-ready
BENCH_READY := .venv/.trisquare-bench-ready
SOURCES := pyproject.toml Cargo.toml Cargo.lock \
	$(wildcard rust/*/Cargo.toml rust/*/src/*.rs rust/*/src/*/*.rs)

help:
	@echo 'make build              set up .venv and compile the core (every other target does so itself)'
	@echo 'make demo               calibrate the bundled photograph and compare with the truth'
	@echo 'make test               run the tests of every room, without the slow ones'
	@echo 'make test ROOM=camera   run the tests of one room, of Python or of Rust'
	@echo 'make test-all           run all tests: these, the slow ones, and those of the crate'
	@echo 'make test-slow          run what test leaves out of test-all'
	@echo 'make test-release       run the tests on what is released: optimised across crates'
	@echo 'make bench              measure accuracy and speed (about an hour)'
	@echo 'make bench NAME=tags    run one benchmark, or several: NAME="tags tone"'
	@echo 'make bench-fast         run those of speed and headline accuracy (10 minutes at most)'
	@echo 'make bench-compare      print what differs from the results that are committed'
	@echo "make experiments        run the paper's experiments and write their page (15 minutes at most)"
	@echo 'make lint               check format, style, types and imports'
	@echo 'make format             format the Rust and the Python code'
	@echo 'make docs               build the documentation, in docs/_build/html'
	@echo 'make fuzz               damaged files for every reader, damaged inputs for every entry point (hours)'
	@echo 'make clean              delete all that make has made'

demo: $(READY)
	$(VENV_PYTHON) -m trisquare demo

# One process per processor; an idle one takes over tests of another. Many tests start further
# processes: byte code is always written, or each would compile all again.
PYTEST = PYTHONDONTWRITEBYTECODE= $(VENV_PYTHON) -m pytest -n auto --dist worksteal --durations=10

# `make test ROOM=lens` runs the tests of one room: a folder of tests/, a module of the crate, or
# both.
ROOM ?=
ROOMS := $(filter-out helpers,$(patsubst tests/%/,%,$(filter %/,$(wildcard tests/*/))))
RUST_ROOMS := $(patsubst rust/trisquare/src/%/mod.rs,%,$(wildcard rust/trisquare/src/*/mod.rs)) \
	$(filter-out lib,$(patsubst rust/trisquare/src/%.rs,%,$(wildcard rust/trisquare/src/*.rs)))
RUST_TESTS := $(patsubst rust/trisquare/tests/public/%.rs,%,$(wildcard rust/trisquare/tests/public/*.rs))

ifeq ($(ROOM),)
test: $(DEV_READY)
	$(PYTEST) -m 'not slow'
else ifneq ($(filter $(ROOM),$(ROOMS) $(RUST_ROOMS)),)
# Rooms that are only in the crate need no Python.
test: $(if $(filter $(ROOM),$(ROOMS)),$(DEV_READY))
	$(if $(filter $(ROOM),$(RUST_ROOMS)),cargo test -p trisquare $(ROOM)::)
	$(if $(filter $(ROOM),$(RUST_TESTS)),cargo test -p trisquare --test public $(ROOM)::)
	$(if $(filter $(ROOM),$(ROOMS)),$(PYTEST) -m 'not slow' tests/$(ROOM))
else
test:
	@echo 'no room "$(ROOM)"; Python: $(sort $(ROOMS)); Rust: $(sort $(RUST_ROOMS))' >&2; exit 2
endif

# In two parts, so that `make test`, the command in the README, is run as well.
test-all: test test-slow

test-slow: $(DEV_READY)
	cargo test -p trisquare --lib --tests
	cargo test -p trisquare --doc
	$(PYTEST) -m slow

# The core as in wheels and for users of the crate: optimised across crates.
test-release: $(BENCH_READY)
	cargo test --release -p trisquare
	$(PYTEST) -m 'not slow'

# `make bench NAME=tags` runs one benchmark, NAME="tags tone" several.
NAME ?=

bench: $(BENCH_READY)
	$(VENV_PYTHON) benchmarks/run.py $(NAME)

bench-fast: $(BENCH_READY)
	$(VENV_PYTHON) benchmarks/run.py --fast

bench-compare: $(DEV_READY)
	$(VENV_PYTHON) benchmarks/run.py --compare

# The experiments import modules of benchmarks/.
experiments: $(BENCH_READY)
	PYTHONPATH=benchmarks $(VENV_PYTHON) -m experiments.run

lint: $(DEV_READY)
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --all-features -- -D warnings
	cargo clippy --manifest-path fuzz/Cargo.toml --all-targets -- -D warnings
	$(VENV_PYTHON) -m ruff format --check .
	$(VENV_PYTHON) -m ruff check .
	$(VENV_PYTHON) -m mypy
	$(VENV_PYTHON) -m mypy.stubtest trisquare._core
	.venv/bin/lint-imports

format: $(DEV_READY)
	cargo fmt --all
	cargo fmt --manifest-path fuzz/Cargo.toml
	$(VENV_PYTHON) -m ruff check --fix .
	$(VENV_PYTHON) -m ruff format .

# The crate's reference is copied to the folder to which the other pages link.
docs: $(DOCS_READY)
	rm -rf docs/_build docs/_generated target/doc
	$(VENV_PYTHON) -m sphinx --fail-on-warning --keep-going --quiet docs docs/_build/html
	RUSTDOCFLAGS='-D warnings' cargo doc --workspace --no-deps --all-features
	cp -R target/doc docs/_build/html/rust
	@test -f docs/_build/html/rust/trisquare/index.html

# Damaged files for every reader of files, then random bytes for every entry point; with cargo-fuzz
# installed, guided by coverage as well. Without a sanitizer, which safe code does not need, no
# nightly compiler is required.
FUZZ_CASES ?= 1000000
READER_CASES ?= 100000
FUZZ_TARGETS = $(basename $(notdir $(wildcard fuzz/fuzz_targets/*.rs)))

fuzz: $(DEV_READY)
	$(VENV_PYTHON) fuzz/readers.py --cases $(READER_CASES)
	cd fuzz && cargo run --release --quiet --bin soak -- $(FUZZ_CASES)
	@command -v cargo-fuzz >/dev/null || { echo 'no cargo-fuzz here: cargo install cargo-fuzz'; exit 0; }; \
	cd fuzz && for target in $(FUZZ_TARGETS); do \
		cargo fuzz run --sanitizer none --fuzz-dir . --features libfuzzer $$target -- \
			-runs=$(FUZZ_CASES) -max_len=1024 -len_control=0 -timeout=10 || exit 1; \
	done

build: $(DEV_READY)

clean:
	rm -rf .venv target fuzz/target fuzz/found dist demo-output docs/_build docs/_generated

# Prints one sentence about what is missing. Uses the default Python if it is suitable, else the
# newest.
$(VENV_PYTHON):
	@command -v cargo >/dev/null || { echo 'trisquare needs cargo (Rust): see https://rustup.rs' >&2; exit 1; }
	@command -v cc >/dev/null || { echo 'trisquare needs cc, a C compiler, to link the Rust core.' >&2; exit 1; }
	@for python in $(PYTHON) python3 python3.14 python3.13 python3.12 python3.11 python3.10; do \
		"$$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' 2>/dev/null \
			&& exec "$$python" -m venv --clear .venv; \
	done; \
	echo 'trisquare needs Python 3.10 or later with venv (python3-venv on Debian).' >&2; exit 1

# The largest requirements of the package, fetched while the core compiles: the first half of that
# leaves a processor free. The last line installs the others.
LARGE_PACKAGES := matplotlib numpy opencv-python-headless reportlab

$(READY): $(VENV_PYTHON) $(SOURCES)
	@command -v cargo >/dev/null || { echo 'trisquare needs cargo (Rust): see https://rustup.rs' >&2; exit 1; }
	$(VENV_PYTHON) -m pip install 'maturin>=1.9.4,<2'
	nice $(VENV_PYTHON) -m pip install $(LARGE_PACKAGES) & fetched=$$!; \
	$(VENV_PYTHON) -m maturin develop --profile quick --skip-install && wait $$fetched
	$(VENV_PYTHON) -m maturin develop --profile quick --extras report,serve,target
	@touch $@

# The package is already installed: these add the requirements of an extra.
$(DEV_READY): $(READY)
	$(VENV_PYTHON) -m pip install 'trisquare[dev]'
	@touch $@

$(DOCS_READY): $(DEV_READY)
	$(VENV_PYTHON) -m pip install 'trisquare[docs]'
	@touch $@

$(BENCH_READY): $(DEV_READY)
	$(VENV_PYTHON) -m maturin develop --release
	@touch $@
