# make demo, make test: all that a Linux x86-64 machine with Python 3.10 or later needs.

PYTHON ?= python3
# The ROS 2 whose wheels are installed: jazzy or kilted.
DISTRO ?= jazzy
OF_DISTRO := $(if $(filter-out jazzy,$(DISTRO)),-$(DISTRO))
VENV ?= .venv$(OF_DISTRO)
INSTALLED := $(VENV)/installed
TEST_TOOLS := $(INSTALLED)-bag,test
# On two cores; the tests mostly wait. Where colcon runs them by itself, pytest-xdist is not needed.
PARALLEL := -n 6 --dist worksteal
# Otherwise, each process of pytest-xdist prints the warnings.
WARN_ONCE := -p no:colcon_core_warnings_stderr

export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# A ROS installation that is sourced is for another Python; the venv brings all of its own.
# PYTHONDONTWRITEBYTECODE would make setuptools warn, and every process compile what it imports.
unexport PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH
unexport RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONDONTWRITEBYTECODE

.PHONY: demo listen test test-plan test-once night lint bench docs dist pictures clean
.NOTPARALLEL:

# Ctrl-C and SIGTERM end both.
demo: $(INSTALLED)
	@$(VENV)/bin/dummy_arm & arm=$$!; $(VENV)/bin/web_view & view=$$!; \
	    code=; trap 'code=0; kill $$arm $$view 2> /dev/null' INT TERM; \
	    wait $$view; code=$${code:-$$?}; kill $$arm 2> /dev/null; wait $$arm $$view; exit $$code

listen: $(INSTALLED)
	@$(VENV)/bin/python docs/examples/listen.py

# The short suite.
test: test-plan $(TEST_TOOLS)
	@rm -rf build/dummy_arm
	@$(VENV)/bin/colcon build
	@$(VENV)/bin/colcon test --event-handlers console_direct+ console_stderr- \
	    --return-code-on-test-failure --pytest-args $(WARN_ONCE) $(PARALLEL) $(PYTEST_ARGS); code=$$?; \
	    $(VENV)/bin/colcon test-result && exit $$code
	@$(VENV)/bin/colcon test-result | awk '/^Summary:/ { ran = $$2 - $$8 } \
	    END { if (ran < 1) { print "no test ran"; exit 1 } }'

test-plan:
	@echo 'the tests take about three minutes on two idle cores, longer on a busy machine'
	@[ -e $(TEST_TOOLS) ] || echo 'before, their tools are installed: 480 MB more, some minutes'

# The tests that take seconds each: model answers, hand-ins, all blocks of the documentation.
test-once: $(TEST_TOOLS)
	$(VENV)/bin/python -m pytest $(PARALLEL) $(PYTEST_ARGS) test/once

# The tests that take one and a half hours together: soaks, attacks, fuzzing, other Pythons.
night:
	.ci/night

lint: $(TEST_TOOLS)
	$(VENV)/bin/ruff check
	$(VENV)/bin/mypy
	$(VENV)/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*
	$(VENV)/bin/check-jsonschema --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/*
	$(VENV)/bin/zizmor --offline --quiet .github

bench: $(TEST_TOOLS) $(INSTALLED)-bench
	$(VENV)/bin/python bench/bench.py docs/lookup_cost.png

# On Python 3.11 or later.
docs: $(INSTALLED)-docs
	rm -rf build/docs
	$(VENV)/bin/sphinx-build --quiet --fail-on-warning --keep-going -d build/doctrees docs build/docs
	@echo 'built build/docs/index.html'

# What a release publishes.
dist: $(INSTALLED)-release
	rm -rf dist
	$(VENV)/bin/pyproject-build --quiet --outdir dist
	$(VENV)/bin/pyproject-build --quiet --outdir dist compat
	$(VENV)/bin/twine check --strict dist/*

pictures: $(TEST_TOOLS) $(INSTALLED)-pictures
	$(VENV)/bin/python docs/pictures.py

clean:
	rm -rf build dist install log $(VENV) .venv-* *.egg-info compat/build compat/*.egg-info
	rm -rf .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find * -name __pycache__ -prune -exec rm -r {} +

# With paths, and not with an import hook, so that editors and mypy find the packages.
AS_PATHS := --config-settings editable_mode=compat
EXTRAS := robot,ros$(OF_DISTRO),view
# Of what pip prints, a line for each package and for each large download.
PROGRESS := while read -r what name rest; do case "$$what $$name $$rest" in \
    Obtaining\ file*) echo "preparing $${name\#file://}" ;; \
    Collecting*) n=$$((n + 1)); echo "package $$n: $${name%%[<>=~!;[]*}" ;; \
    Processing*.whl*) n=$$((n + 1)); name=$${name\#\#*/}; echo "package $$n: $${name%%-*}" ;; \
    Downloading*MB\)) echo "    downloading $${name%%-*} $$rest" ;; \
    Installing\ collected*) echo "unpacking $$n packages" ;; esac; done
$(INSTALLED): SHELL := bash
$(INSTALLED): .SHELLFLAGS := -o pipefail -c
# The demo is to take little of the disk. So there is no bytecode: Python compiles what is used, once.
# The libraries in the wheel of pygraphviz are 13 MB of code and 95 MB of zeros, which take no space as
# holes in the files; where the file system has no such holes, they stay.
$(INSTALLED): setup.py compat/pyproject.toml
	@[ "$$(uname -sm)" = 'Linux x86_64' ] || \
	    { echo 'wheels of rclpy exist only for Linux x86-64; see README.md'; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	    { echo 'Python 3.10 or later is needed; name one: make PYTHON=python3.12'; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2> /dev/null || { $(PYTHON) -c 'import sys; print( \
	    "the venv module is missing: apt install python3.%d-venv" % sys.version_info[1])'; exit 1; }
	@echo 'installing about 100 packages (340 MB) into $(abspath $(@D))'
	@$(PYTHON) -m venv $(@D)
	@touch $(@D)/COLCON_IGNORE
	@$(@D)/bin/python -m pip install --no-compile $(AS_PATHS) --editable '.[$(EXTRAS)]' --editable compat \
	    | $(PROGRESS)
	@find $(@D) -name __pycache__ -prune -exec rm -r {} +
	@find $(@D) -path '*.libs/*' -type f -exec fallocate --dig-holes {} \; 2> /dev/null || true
	@touch $@
	@echo 'installed; to use it in a shell: . $(abspath $(@D))/bin/activate'

# The test tools start Python thousands of times.
$(INSTALLED)-%: $(INSTALLED)
	@echo 'installing the extra packages for $*, a minute or more'
	@$(VENV)/bin/python -m pip install --quiet $(AS_PATHS) --editable '.[$*]'
	@$(VENV)/bin/python -m compileall -q -j 2 $(VENV)/lib > /dev/null || true
	@touch $@
