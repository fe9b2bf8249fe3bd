# Every target uses the virtual environment in .venv; `make venv` builds it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
# Other libraries to be compared with, never in the environment that Traverse runs in.
PEERS := .venv-peers
# Tests that run at once: many wait for real time, so three more than there are cores.
WORKERS ?= $(shell expr $$(nproc) + 3)
TEST = OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder \
    --required="$(TEST_GROUPS)"
# What failed beside others may have been late only: once more, alone. Both are printed.
AGAIN = OPENBLAS_NUM_THREADS=1 $(BIN)/pytest --last-failed --last-failed-no-failures none \
    --required="$(TEST_GROUPS)"
# What benchmarks and proofs write: BUILD=DIR for another folder. They run from any
# clone and leave it as it was; `make figures` takes their pictures into docs/.
BUILD ?= build
FIGURES := $(BUILD)/figures
SITE ?= site
DIST ?= dist
# TINY=1: as little of a benchmark or proof as shows that it runs.
TINY ?=
# Groups of Debian packages that the tests need, in deploy/debian-packages.sh.
TEST_GROUPS := compiler avr simavr arm cppcheck cplusplus mosquitto postgresql openssl jq chromium node systemd groff xvfb
# Dask scheduler that long proofs run on: make blind SCHEDULER=tcp://host:8786
SCHEDULER ?=
CLUSTER := $(if $(SCHEDULER),--scheduler $(SCHEDULER))
# The Debian of `make test-fresh`, and options of deploy/fresh_machine.py.
SUITE ?= bookworm
FRESH ?=
# What the kernel in C is built from.
KERNEL := setup.py $(foreach kind,pyx pxd pxi c h inc,$(wildcard kinematics/kernel/*.$(kind)))

# Compiled modules are kept: without them every program that a test starts compiles anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: docs help venv system node demo test test-slow test-targets test-fresh check lint format schemas lock bench bench-capture bench-drivers bench-recording bench-identification prove prove-acceptance prove-alignment blind blind-full fuzz fuzz-files soak endurance bench-client test-vm install deb clean bench-kernel audit bench-fleet bench-page bench-zoo prove-board-day screenshots figures honesty wheels

help:  ## what can be made
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

venv: $(STAMP)  ## the virtual environment in .venv

# Its first layer: what measuring with the simulated arm needs.
$(VENV)/.demo: pyproject.toml requirements-demo.lock
	@$(PYTHON) -c 'import sys; sys.exit("Traverse needs Python 3.11 or newer; $(PYTHON) is " + sys.version.split()[0] + \
	    ". Name another one: make PYTHON=python3.13" if sys.version_info < (3, 11) else 0)'
	@PYTHON=$(PYTHON) sh deploy/debian-packages.sh python
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python deploy/environment.py requirements-demo.lock demo
	@touch $@

$(VENV)/.compiler: $(VENV)/.demo
	@PYTHON=$(BIN)/python sh deploy/debian-packages.sh compiler
	@touch $@

$(STAMP): $(VENV)/.demo pyproject.toml requirements.lock $(KERNEL) | $(VENV)/.compiler
	@rm -f kinematics/kernel/*.so
	@$(BIN)/python deploy/environment.py requirements.lock demo,lab,dev
	@touch $@

system: $(VENV)/.compiler  # Debian packages that the tests need
	@PYTHON=$(BIN)/python sh deploy/debian-packages.sh $(TEST_GROUPS)

demo: $(VENV)/.demo  ## one round of measurements with a simulated arm
	$(BIN)/traverse demo --once

node: build/node/.ready  # packages of npm, for the tests of readers in JavaScript

build/node/.ready: tests/interface/package.json tests/interface/package-lock.json
	@sh deploy/debian-packages.sh node
	@mkdir -p build/node
	@cp tests/interface/package.json tests/interface/package-lock.json build/node/
	@npm ci --prefix build/node --no-audit --no-fund --loglevel=error
	@touch $@

# Each worker imports all tests, and would compile them anew where nobody has.
$(VENV)/.compiled: $(STAMP)
	@$(BIN)/pytest --collect-only -q > /dev/null || true
	@touch $@

# What tests need: Debian packages are unpacked while Python packages are, and compiled.
READY = @$(MAKE) --no-print-directory --jobs=4 venv system node $(VENV)/.compiled

test:  ## all tests but the slow ones
	$(READY)
	$(TEST) -m "not slow" || $(AGAIN) -m "not slow"

test-slow:  ## guides followed to their end, outages, campaigns through everything; five minutes
	$(READY)
	$(TEST) -m "slow and not targets" || $(AGAIN) -m "slow and not targets"

test-targets: venv system $(PEERS)/.ready  ## long targets in tiny sizes: benchmarks, packages, pictures; ten minutes
	$(BIN)/pytest -m targets tests/benchmarks/test_targets.py

test-fresh:  ## the README's commands in a pristine Debian (SUITE=trixie for another); root, a quarter of an hour
	@sh deploy/debian-packages.sh fresh || true
	@$(PYTHON) deploy/fresh_machine.py $(SUITE) $(FRESH)

check: lint  ## lint, and the quick tests of what has changed; about a minute
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.changed -n $(WORKERS) --dist loadfile --no-loadscope-reorder

lint: venv  ## ruff, mypy --strict, import contracts, warnings of the firmware
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy --num-workers 2
	$(BIN)/lint-imports
	@$(MAKE) --no-print-directory -C firmware check BUILD=$(abspath $(BUILD))/firmware

format: venv  ## put the code into its form
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

schemas: venv  ## write the message reference and JSON Schemas of messages and files
	$(BIN)/python docs/generate_messages.py
	$(BIN)/python docs/file_schemas.py

# It sees the packages of .venv behind its own.
$(PEERS)/.ready: benchmarks/peers.txt requirements.lock $(STAMP)
	$(BIN)/python -m venv --clear $(PEERS)
	$(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' \
	    > $$(echo $(PEERS)/lib/python3.*/site-packages)/environment-of-traverse.pth
	$(PEERS)/bin/pip install --quiet --constraint requirements.lock --requirement benchmarks/peers.txt
	touch $@

bench-kernel: $(PEERS)/.ready  ## kernel and measurement path beside others; takes two minutes
	PYTHONPATH=src OPENBLAS_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.kinematics $(FIGURES)/kinematics.json
	PYTHONPATH=src OPENBLAS_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.path $(FIGURES)/path.json

bench: venv system bench-kernel  ## the figures of docs/performance.md; takes eight minutes
	$(BIN)/python -m benchmarks $(FIGURES)
	$(BIN)/python -m benchmarks.service.plain $(FIGURES)/presses.json
	$(BIN)/python -m benchmarks.service.stages $(FIGURES)/press.json
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.service.effects $(FIGURES)/effects.json
	$(BIN)/python -m benchmarks.tools.plots $(FIGURES)
	$(BIN)/python -m benchmarks.tools.compare $(FIGURES)

bench-drivers: venv system node  ## the drivers: what each encoder reaches, interpolation, the boards; takes minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.drivers.bar
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.drivers.deskew
	$(BIN)/python -m benchmarks.drivers.boards

prove-board-day: venv system  ## a day of the Mega's firmware in its emulator, across forty wraps of its counter; half an hour
	$(BIN)/python -m benchmarks.drivers.board_day

bench-capture: venv system  ## filters, and a switching probe's contact; takes two minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.service.filters
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.drivers.touch

bench-recording: venv system  ## what recording costs at 10 kHz, and how fast a replay is; takes two minutes
	$(BIN)/python -m benchmarks.service.recording $(FIGURES)/recording.json

bench-zoo: $(PEERS)/.ready  ## robot descriptions of the package example-robot-data: read right, or refused with a reason; half a minute
	PYTHONPATH=src OPENBLAS_NUM_THREADS=1 $(PEERS)/bin/python -m benchmarks.zoo

bench-page: venv system  ## the operator's page in a browser: latency, a million points, memory; takes 13 minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.clients.page all

screenshots: venv system  ## pictures of the operator's page and of reports, from real runs
	$(BIN)/python -m benchmarks.clients.reports $(FIGURES)/reports
	$(BIN)/python -m benchmarks.clients.screenshots $(FIGURES)/page-states
	$(BIN)/python -m benchmarks.clients.gateways $(FIGURES)

figures:  ## takes the pictures that bench, prove-* and screenshots made into docs/
	@cd $(FIGURES) && find . -name '*.png' -exec sh -c \
	    'for it; do test -e "$(CURDIR)/docs/$$it" && cp -v "$$it" "$(CURDIR)/docs/$$it"; done' sh {} +

bench-identification: venv  ## the adjustment beside scipy's least squares; takes many minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.identification.__main__

prove-acceptance: venv  ## a thousand arms accepted or rejected, rightly or not; takes minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.acceptance --out $(BUILD)/acceptance.jsonl --pictures $(FIGURES) $(CLUSTER)

prove-alignment: venv  ## 10 000 dispositions of common points: predicted errors against true ones; takes minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.alignment --out $(BUILD)/alignment.jsonl --pictures $(FIGURES) $(CLUSTER)

prove: venv  ## the statistics of the identification over thousands of campaigns; takes an hour
	$(BIN)/python -m benchmarks.proofs --out $(BUILD)/proofs.jsonl $(CLUSTER)

blind: venv  ## 200 hidden effects and what the diagnosis says of them; takes minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.blind --out $(BUILD)/blind.jsonl $(CLUSTER)

blind-full: venv  ## thousands of them, goes on from its file; takes an hour or two
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.blind --full --out $(BUILD)/blind-full.jsonl $(CLUSTER)

bench-fleet: venv system  ## 50 arms at one broker read by a group, daemons beside each other, a hostile client; takes minutes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.fleet --out $(FIGURES)/fleet.json
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.service.hostile

audit: venv  ## known advisories of the dependencies, where their data can be reached
	$(BIN)/python deploy/audit.py

fuzz: venv system  ## every decoder under atheris, every property with a thousand examples; takes many minutes
	$(BIN)/python -m tests.fuzz --seconds $(if $(TINY),1,60)
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -q -n $(WORKERS) -m hypothesis $(if $(TINY),tests/protocol/test_arrays.py,--hypothesis-profile=thorough --timeout=600)

fuzz-files: venv system  ## damaged files given to every command that reads them, 300 times each; takes an hour or two
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.fuzz.files

honesty: venv  ## a thousand worlds in virtual time: nothing unmarked may be wrong; minutes (WORLDS=40)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.honesty --out $(BUILD)/honesty.jsonl $(if $(WORLDS),--runs $(WORLDS))

soak: venv system  ## 200 times daemon, broker, board, networks, consumer killed; half an hour (KILLS=12: a minute or two)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.soak $(if $(KILLS),--kills $(KILLS))

endurance: venv system  ## a stream at 1 kHz for an hour (MINUTES=5 for less): memory, descriptors, losses
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.service.endurance $(MINUTES)

bench-client: venv system  ## the Python client: points over cut connections, beside bare subscribers
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.clients.client

install: venv  ## into DESTDIR: /usr/lib/traverse, unit, rules; nothing is started
	@sh deploy/debian-packages.sh elfutils
	sh deploy/package/install.sh '$(DESTDIR)'

deb: venv  ## Debian packages of daemon, lab and store, in build/ (MACHINE=aarch64: for arm64)
	@sh deploy/debian-packages.sh elfutils $(if $(MACHINE),aarch64)
	BUILD=$(abspath $(BUILD)) $(if $(MACHINE),MACHINE=$(MACHINE)) sh deploy/package/build-deb.sh

wheels: venv  ## wheels for x86_64 and aarch64, and the source distribution, in dist/
	@sh deploy/debian-packages.sh aarch64
	sh deploy/package/build-wheels.sh $(DIST)

test-vm: deb system  ## CANopen on SocketCAN, and the package with systemd, in virtual machines; takes minutes
	@sh deploy/debian-packages.sh vm
	sh deploy/vm/system.sh 1500 $$(for name in traverse traverse-lab traverse-fleet; do ls -t build/$${name}_*_amd64.deb | head -n 1; done)
	sh deploy/vm/run.sh 1200 $(BIN)/python -m tests.vm

docs: venv  ## the documentation as a site, in site/ (SITE=DIR for another)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --site-dir $(abspath $(SITE))

lock: venv  ## requirements.lock and requirements-demo.lock anew from pyproject.toml
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --all-extras --no-emit-index-url --no-header \
	    --output-file requirements.lock pyproject.toml
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --extra demo --no-emit-index-url --no-header \
	    --constraint requirements.lock --output-file requirements-demo.lock pyproject.toml

clean:  ## remove what was built
	rm -rf $(VENV) $(PEERS) build dist site src/*.egg-info kinematics/kernel/*.so .pytest_cache .mypy_cache .ruff_cache .hypothesis
