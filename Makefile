# make demo, make test: all that a Linux x86-64 machine with Python 3.10 or later needs.

PYTHON ?= python3
VENV ?= .venv
INSTALLED := $(VENV)/installed

export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# A ROS installation that is sourced is for another Python; the venv brings all of its own.
unexport PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH
unexport RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: demo listen test test-desktop lint bench pictures clean

# Ctrl-C and SIGTERM end both.
demo: $(INSTALLED)
	@$(VENV)/bin/dummy_arm & arm=$$!; $(VENV)/bin/web_view & view=$$!; \
	    code=; trap 'code=0; kill $$arm $$view 2> /dev/null' INT TERM; \
	    wait $$view; code=$${code:-$$?}; kill $$arm 2> /dev/null; wait $$arm $$view; exit $$code

listen: $(INSTALLED)
	@$(VENV)/bin/python docs/examples/listen.py

test: $(INSTALLED)
	@rm -rf build
	$(VENV)/bin/colcon build
	$(VENV)/bin/colcon test --event-handlers console_direct+ \
	    $(if $(PYTEST_ARGS),--pytest-args $(PYTEST_ARGS))
	$(VENV)/bin/colcon test-result --verbose
	@$(VENV)/bin/colcon test-result | awk '/^Summary:/ { ran = $$2 - $$8 } \
	    END { if (ran < 1) { print "no test ran"; exit 1 } }'

# As on a Jazzy desktop: with stand-ins for tf2_msgs and for the pytest plugins of launch.
test-desktop: $(INSTALLED)
	PYTHONPATH=$(CURDIR)/test/desktop $(VENV)/bin/python -m pytest -p launch_stand_in $(PYTEST_ARGS) test

lint: $(INSTALLED)
	$(VENV)/bin/ruff check
	$(VENV)/bin/mypy

bench: $(INSTALLED)-bench
	$(VENV)/bin/python bench/bench.py docs/lookup_cost.png

pictures: $(INSTALLED)-pictures
	$(VENV)/bin/python docs/pictures.py

clean:
	rm -rf build install log $(VENV) dummy_arm.egg-info
	rm -rf .hypothesis .mypy_cache .pytest_cache .ruff_cache

$(INSTALLED): setup.py
	@[ "$$(uname -sm)" = 'Linux x86_64' ] || \
	    { echo 'wheels of rclpy exist only for Linux x86-64; see README.md'; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	    { echo 'Python 3.10 or later is needed; name one: make PYTHON=python3.12'; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2> /dev/null || { $(PYTHON) -c 'import sys; print( \
	    "the venv module is missing: apt install python3.%d-venv" % sys.version_info[1])'; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $(VENV)/COLCON_IGNORE
	$(VENV)/bin/python -m pip install --quiet --editable '.[bag,ros,test,view]'
	@touch $@

$(INSTALLED)-%: $(INSTALLED)
	$(VENV)/bin/python -m pip install --quiet --editable '.[$*]'
	@touch $@
