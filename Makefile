# foldback: `make run` shows it, `make test` checks it. Python 3.11+ and make are all it needs.
# It uses a C++ compiler, CMake and ninja if they are there; else the build fetches them.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-builtin-rules
# Hundreds of processes import the same, and would compile it each time.
unexport PYTHONDONTWRITEBYTECODE

VENV := .venv
BIN := $(VENV)/bin
RUNS := $(VENV)/.runs
STAMP := $(VENV)/.installed
UV := uv==0.13.9
PIP_INSTALL := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check
PINNED := --constraint constraints.txt --editable
PARALLEL := -n auto --dist worksteal
FAST := -n logical --dist worksteal -m "not processes and not slow and not browser and not long and not benchmark"
CORE := CMakeLists.txt build_backend.py $(wildcard planner/core/*.cpp planner/core/*.hpp planner/core/CMakeLists.txt)
NODE_MODULES := node_modules/.installed
PRETTIER := $(BIN)/node node_modules/prettier/bin/prettier.cjs --log-level warn
CXX_FILES := planner/core/*.cpp planner/core/*.hpp bench/ode/*.cpp bench/ode/*.hpp
SCRIPTS := "web/static/**/*.js" "tests/web/js/*.js" eslint.config.js web/types.d.ts

# The parts of mediabunny that write films in the browser, as one script: decision 0075.
MUXER := web/static/js/film/mediabunny.js
MUXER_PARTS := BufferTarget, EncodedPacket, EncodedVideoPacketSource, Mp4OutputFormat, Output, WebMOutputFormat
MUXER_LICENCE := /*! mediabunny $$($(BIN)/node -p 'require("./node_modules/mediabunny/package.json").version'), \
	MPL-2.0, https://github.com/Vanilagy/mediabunny; see docs/licences.md */
BUILD_MUXER = echo 'export { $(MUXER_PARTS) } from "mediabunny";' | $(BIN)/node node_modules/esbuild/bin/esbuild \
	--bundle --minify --format=esm --target=es2022 --legal-comments=none --log-level=warning \
	--banner:js="$(MUXER_LICENCE)"

# The first interpreter that starts and is new enough; 3.11 to 3.13 are tried ones.
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python python3.14; do \
	"$$p" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' \
	>/dev/null 2>&1 && { echo "$$p"; exit; }; done)

.PHONY: help run test test-fast test-lowest test-long faults coverage load audit compose-check deploy-check docs release-files texts lint format bench success-map muxer reproduction constraints clean tools test-foreign wheels sanitize

help: ## List the targets of make
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST)

# Puts pip into the environment. Python 3.11 puts setuptools beside it, 10 MB that nothing here needs.
ENSURE_PIP := { $(BIN)/python -m pip --version || { $(BIN)/python -m ensurepip \
	&& $(BIN)/python -m pip uninstall --yes setuptools; }; } >/dev/null 2>&1
FETCH_UV := -m pip install --quiet --no-compile --disable-pip-version-check --target $(VENV)/uv $(UV) 2>/dev/null

# What to install: `.[service]`, or `.[dev]` with what tests and tools need besides. uv takes a sixth
# of pip's processor time (decision 0021) and is removed again; pip is for machines without it, or
# with an index that only pip knows. To fetch uv, the interpreter's own pip saves 4 s, if it has one.
# Python compiles what it imports: all that is there would take as long as the rest of the installation.
define install
@if [ -z "$(PYTHON)" ]; then \
	echo "foldback needs Python 3.11 or newer with its venv module, and found none." >&2; \
	echo "Install it (Debian: apt install python3 python3-venv) or name it: make run PYTHON=/path/to/python3" >&2; \
	exit 1; fi
@test -x $(BIN)/python || { echo "Making $(VENV) with $(PYTHON) …"; "$(PYTHON)" -m venv --without-pip $(VENV); }
@echo "Installing foldback and $(2) into $(VENV), once …"
@{ "$(PYTHON)" $(FETCH_UV) || { $(ENSURE_PIP); $(BIN)/python $(FETCH_UV); }; } \
	&& $(VENV)/uv/bin/uv pip install --quiet --python $(BIN)/python $(PINNED) '$(1)' pip 2>/dev/null \
	|| { $(ENSURE_PIP); $(PIP_INSTALL) $(PINNED) '$(1)'; }
@rm -rf $(VENV)/uv
endef

# Compiles changed files of the core, with the tools that are there if none is missing.
define rebuild
@echo "Building the core …"
@$(PIP_INSTALL) --no-deps --editable . $$($(BIN)/python -c "import build_backend; \
	print('' if build_backend.get_requires_for_build_editable() else '--no-build-isolation')" 2>/dev/null)
endef

$(RUNS): pyproject.toml constraints.txt $(CORE)
	$(if $(filter-out $(CORE),$?),$(call install,.[service],its dependencies),$(rebuild))
	@touch $@

$(STAMP): pyproject.toml constraints.txt $(CORE)
	$(if $(filter-out $(CORE),$?),$(call install,.[dev],what its tests need),$(rebuild))
	@touch $(RUNS) $@

run: $(RUNS) ## Start the service (FOLDBACK_HOST, FOLDBACK_PORT, FOLDBACK_DATA_DIR)
	@exec $(BIN)/foldback serve --first-shape wrench-160

tools: $(STAMP)
	@$(BIN)/python -m tests.tools

test: $(STAMP) tools ## Run all tests, also in a real browser: about 6 minutes on two cores
	@$(BIN)/python -m pytest -q $(PARALLEL) --durations=20 $(ARGS)

test-fast: $(STAMP) ## Run the tests that start no other program: about a minute
	@$(BIN)/python -m pytest -q $(FAST) $(ARGS)

$(NODE_MODULES): $(STAMP) package.json package-lock.json .npmrc
	@echo "Installing the tools for the pages' scripts into node_modules, once …"
	@$(BIN)/npm ci --silent --ignore-scripts
	@touch $@

wheels: $(STAMP) ## Build wheels into dist/: one for Python 3.11, if it is there, and one for all later ones
	@rm -rf dist
	@for pythons in "python3.11" "python3.12 python3.13 python3.14"; do for python in $$pythons; do \
		"$$python" -c '' 2>/dev/null || continue; \
		"$$python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist . \
			|| exit 1; \
		break; done; done
	@ls dist

# Other builds of the core stay as they are.
SANITIZED := build/sanitized
# Exceptions are intercepted only if the library that throws them is loaded first, too.
ASAN = $(shell $${CXX:-c++} -print-file-name=libasan.so):$(shell $${CXX:-c++} -print-file-name=libstdc++.so)
SANITIZED_TESTS := tests/planner/core tests/planner/chain tests/planner/clearance tests/planner/statics tests/planner/turns

sanitize: $(STAMP) ## Run tests of the core with checks of addresses, indices and undefined behaviour
	@cmake -S . -B $(SANITIZED) -G Ninja -DFOLDBACK_SANITIZE=ON -DSKBUILD_STATE=editable \
		-DPython_EXECUTABLE=$(abspath $(BIN))/python >/dev/null
	@cmake --build $(SANITIZED)
	@FOLDBACK_CORE=$(abspath $(SANITIZED))/core LD_PRELOAD=$(ASAN) \
		ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1:halt_on_error=1 \
		$(BIN)/python -m pytest -q -p tests.planner.core.sanitized -o timeout=0 $(SANITIZED_TESTS) $(ARGS)

lint: $(STAMP) $(NODE_MODULES) ## Check style and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/clang-format --dry-run --Werror $(CXX_FILES)
	@$(BIN)/pyright
	@$(BIN)/node node_modules/typescript/bin/tsc --project jsconfig.json
	@$(BIN)/node node_modules/eslint/bin/eslint.js web/static tests/web/js
	@$(PRETTIER) --check $(SCRIPTS)
	@$(BUILD_MUXER) | cmp - $(MUXER) || { echo "make muxer writes $(MUXER)" >&2; exit 1; }

format: $(STAMP) $(NODE_MODULES) ## Format Python with ruff, C++ with clang-format, and scripts with prettier
	@$(BIN)/ruff check --fix --quiet .
	@$(BIN)/ruff format .
	@$(BIN)/clang-format -i $(CXX_FILES)
	@$(PRETTIER) --write $(SCRIPTS)

muxer: $(STAMP) $(NODE_MODULES) ## Write the script that writes films in the browser, from its package
	@$(BUILD_MUXER) > $(MUXER)

test-long: $(STAMP) tools ## Run long tests (crashes, replays of all shapes): an hour or more
	@$(BIN)/python -m pytest -q -m "long or hypothesis" --hypothesis-profile=thorough -o timeout=0 \
		--durations=20 $(ARGS)

LOWEST := .venv-lowest
LOWEST_PYTHON ?= python3.11

test-lowest: ## Run the tests of test-fast with the lowest versions that pyproject.toml permits
	@test -x $(LOWEST)/bin/uv || { $(LOWEST_PYTHON) -m venv $(LOWEST) && \
		$(LOWEST)/bin/python -m pip install --quiet --disable-pip-version-check $(UV); }
	@$(LOWEST)/bin/uv pip install --quiet --python $(LOWEST)/bin/python --upgrade \
		--resolution lowest-direct --editable '.[dev]'
	@# Stored texts, types and licences are those of the versions in constraints.txt.
	@$(LOWEST)/bin/python -m pytest -q $(FAST) --ignore=tests/server/contract \
		--deselect=tests/deploy/test_licences.py \
		--deselect=tests/web/test_static_files.py::test_types_of_answers_are_those_of_the_description \
		$(ARGS)

# Blender's package has wheels for Python 3.11 alone.
FOREIGN := .venv-foreign
FOREIGN_PYTHON ?= python3.11
FOREIGN_PLANS := out/foreign

$(FOREIGN)/.installed: tests/foreign/requirements.txt tests/foreign/blender.txt $(STAMP)
	@echo "Installing other programs into $(FOREIGN), once: several GB …"
	@for part in requirements blender; do \
		$(FOREIGN_PYTHON) -m venv $(FOREIGN)/$$part && \
		$(FOREIGN)/$$part/bin/python -m pip install --quiet --only-binary :all: \
			--disable-pip-version-check -r tests/foreign/$$part.txt || exit 1; done
	@$(BIN)/npm install --silent --no-save --ignore-scripts --prefix $(FOREIGN) gltf-validator@2.0.0-dev.3.10
	@touch $@

test-foreign: $(FOREIGN)/.installed ## Open exports in Drake, PyBullet, Blender and others (several GB)
	@$(BIN)/python -m tests.foreign.make_plans $(FOREIGN_PLANS)
	@FOREIGN_PLANS=$(abspath $(FOREIGN_PLANS)) FOREIGN_NODE=$(abspath $(BIN))/node \
		FOREIGN_MODULES=$(abspath $(FOREIGN))/node_modules \
		FOREIGN_BLENDER=$(abspath $(FOREIGN))/blender/bin/python \
		$(FOREIGN)/requirements/bin/python -m pytest -c tests/foreign/pytest.ini tests/foreign $(ARGS)

coverage: $(STAMP) tools ## Measure which lines and branches `make test` runs, for each package
	@rm -rf out/coverage && mkdir -p out/coverage
	@$(BIN)/python -m coverage run -m pytest -q $(PARALLEL) -o timeout=0 $(ARGS)
	@$(BIN)/python -m coverage combine -q
	@for package in planner web words cli server client; do \
		printf '%-16s ' $$package; \
		$(BIN)/python -m coverage report --include="foldback/$$package/*" | tail -n 1; done

faults: $(STAMP) tools ## Put deliberate mistakes into the code and run the test that finds each (ARGS="--all NAME …")
	@$(BIN)/python -m tests.faults $(ARGS)

load: $(STAMP) tools ## Measure the service under load, attacks and crashes: a table, and JSON in out/
	@$(BIN)/python -m bench.load $(ARGS)

audit: $(STAMP) ## Search code and dependencies for known vulnerabilities
	@$(BIN)/bandit -q -c pyproject.toml -r server cli words web planner client foldback
	@$(BIN)/pip-audit -r constraints.txt --no-deps

compose-check: $(STAMP) tools ## Run compose.yaml without containers: folds, backup, restore (root, Linux)
	@$(BIN)/python -m tests.deploy.rehearsal

deploy-check: $(STAMP) ## Run the build steps of the container image (root, Debian, minutes)
	@$(BIN)/python -m tests.deploy.build

bench: $(STAMP) ## Run the benchmarks: a table, and JSON in out/ (ARGS="--only first")
	@$(BIN)/python -m bench $(ARGS)

success-map: $(STAMP) ## Sweep the missing folds of the success map and draw it for /benchmarks
	@$(BIN)/python -m bench.stored_sweeps success-map

reproduction: $(STAMP) ## Run the missing experiments of the paper and write their page (ARGS="--only ID …")
	@$(BIN)/python -m bench.reproduction $(ARGS)

release-files: $(STAMP) tools ## Make the files again that a new version changes: hours (ARGS=--dry-run)
	@$(BIN)/python -m docs.make_release_files $(ARGS)

docs: $(STAMP) ## Write the reference of the Python library into out/reference
	@$(BIN)/python -m docs.make_reference

texts: $(STAMP) ## List every text that users can see, in out/texts.md (ARGS="--sample 200")
	@$(BIN)/python -m docs.make_texts $(ARGS)

constraints: $(STAMP) ## Write constraints.txt from the installed packages
	@{ echo "# Versions that are tested together; \`make constraints\` writes this file."; \
	   $(BIN)/python -m pip freeze --disable-pip-version-check --exclude-editable \
	   | grep -v -e ' @ ' -e '^-' ; } > constraints.txt.new && mv constraints.txt.new constraints.txt
	@touch $(RUNS) $(STAMP)

clean: ## Remove generated files; folds in data/ stay
	rm -rf $(VENV) node_modules build dist out .pytest_cache .ruff_cache
