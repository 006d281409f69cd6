# The one entrance for users and developers: `make help` lists what there is.

.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

# The Python that .venv is made from. Override it with: make PYTHON=/path/to/python3.11 demo
PYTHON ?= $(shell for python in python3.11 python3.13 python3; do \
	if $$python -c 'import sys; sys.exit(sys.version_info[:2] not in [(3, 11), (3, 13)])' 2>/dev/null; \
	then echo $$python; exit; fi; done; echo python3)
VENV_PYTHON := .venv/bin/python

.PHONY: help demo test bench wheel zip package install-test window-test lint format clean environment

help: ## List the targets
	@grep -hE '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | \
	while IFS="$$(printf '\t')" read -r target text; do printf '  make %-13s%s\n' "$$target" "$$text"; done

demo: zip ## Retarget weights in Blender, what the PBD skin does, a bare mesh that gets bones; pictures and more in demo/
	@$(VENV_PYTHON) demo/run.py
	@$(VENV_PYTHON) demo/skin.py
	@$(VENV_PYTHON) demo/fit.py

test: zip ## Run all tests and linters (Rust, Python, inside Blender)
	@$(VENV_PYTHON) scripts/run_tests.py

bench: zip ## Measure the spectral solver, the skin, its speed, its frames and retargeted weights beside others; bench/*.json and *.png
	@$(VENV_PYTHON) bench/spectral.py
	@$(VENV_PYTHON) bench/skin.py
	@$(VENV_PYTHON) bench/performance.py
	@$(VENV_PYTHON) bench/skin_frames.py
	@$(VENV_PYTHON) bench/skin_frames.py --vertices 24000
	@$(VENV_PYTHON) bench/retarget.py
	@$(VENV_PYTHON) bench/bind.py
	@$(VENV_PYTHON) bench/fit.py
	@$(VENV_PYTHON) bench/bake.py

lint: wheel ## Run the formatters' checks, the linters and the type checker alone
	@$(VENV_PYTHON) scripts/run_tests.py lint

format: environment ## Format all Rust and Python code, and renew docs/api.md
	cargo fmt --all
	$(VENV_PYTHON) -m ruff check --fix
	$(VENV_PYTHON) -m ruff format
	$(VENV_PYTHON) scripts/api_page.py

wheel: environment ## Build the Python module of the Rust core into dist/ and install it into .venv
	@$(VENV_PYTHON) scripts/build_wheel.py

zip: wheel ## Build the Blender extension into dist/
	@$(VENV_PYTHON) scripts/build_zip.py

package: environment ## Build zips for Linux, Windows and macOS (PLATFORMS="linux-x64 ..." for some) into dist/package/
	@$(VENV_PYTHON) scripts/package.py $(PLATFORMS)

install-test: zip ## Install, use, upgrade, disable and remove the zip in Blender 4.2, 4.5, 5.0 and 5.2
	@$(VENV_PYTHON) scripts/install_matrix.py

window-test: zip ## A session in a real Blender window on a virtual screen, with pictures (BLENDER=/path/to/blender)
	@test -f demo/demo.blend || $(VENV_PYTHON) demo/run.py --no-render
	@$(VENV_PYTHON) scripts/window_test.py $(if $(BLENDER),--blender "$(BLENDER)")

environment: ## Make .venv with everything that the other targets need (they call this themselves)
	@"$(PYTHON)" scripts/setup_environment.py

clean: ## Remove everything that make has made
	rm -rf .venv .setup dist target demo/*.png demo/*.blend demo/*.blend1 demo/report.json bench/*.json bench/*.png
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
