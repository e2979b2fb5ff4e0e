# Everything is installed into .venv; PYTHON chooses the interpreter that makes it (3.11 or newer).
PYTHON ?= python3
WORKERS ?= 2
BIN := .venv/bin
INSTALLED := .venv/installed

.DEFAULT_GOAL := help
.PHONY: help install test check rest torture lint format smoke figures bench clean

help: ## show this list
	@grep -E '^[a-z0-9]+:.*## ' Makefile | sed -E 's/^([a-z0-9]+):.*## /\1\t/' | expand -t 10

install: $(INSTALLED) ## install agfb and its development tools into .venv

$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check --editable '.[dev]'
	touch $@

# tests of one module share what it computes first: a module is not divided among processes
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test: $(INSTALLED) ## run the quick tests (WORKERS processes)
	$(PYTEST) -m 'not slow and not reliability'

check: lint test rest ## run style, types and all tests: required before a change is merged

rest: $(INSTALLED) ## run the tests that `make test` leaves out
	$(PYTEST) -m 'slow or reliability' --durations=10

torture: $(INSTALLED) ## kill 500 processes in every reliability test, 10000 configurations, 300 rotors (an hour)
	$(BIN)/python -m pytest tests/reliability --kills 500 --rotors 300 --hypothesis-profile torture --timeout 0

format: $(INSTALLED) ## format the sources
	$(BIN)/ruff check --select I --fix
	$(BIN)/ruff format

lint: $(INSTALLED) ## check format, style and types
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

smoke: $(INSTALLED) ## run the main job on configs/tongue.toml: build/smoke.zarr and figures
	$(BIN)/agfb run configs/tongue.toml -o build/smoke.zarr

# The paper's figures. Each number has a store, made by the stages of its configuration; each letter shows some cases.
# On another grid, beside:
#   make fig3 PAPER=build/coarse OPTIONS='--set numerics.circumferential=24 --set numerics.axial=4'
PAPER ?= build/paper
OPTIONS ?=
NUMBERED := fig3 fig4 fig5 fig6
OPEN := map gain energy
LETTERED := $(foreach figure,fig3 fig4 fig6,$(addprefix $(figure),a b c d)) gain10 gain50
.PHONY: $(NUMBERED) $(OPEN) $(LETTERED)

STAGES_fig3 := run
STAGES_fig4 := continue-cycles transient
STAGES_fig5 := continue-cycles
STAGES_fig6 := continue-cycles transient
STAGES_map := run
STAGES_gain := run
STAGES_energy := transient
CONFIG_map := fig3
OPTIONS_fig3 := --no-figures
OPTIONS_map := --no-figures --set track_curves.normal_forms=true
OPTIONS_gain := --no-figures

KIND_fig3 := sets
KIND_fig4 := envelopes
KIND_fig5 := tree
KIND_fig6 := envelope
KIND_map := stability
KIND_gain := sets
KIND_energy := modal-energy

CASES_fig3a := stiffness=3_*
CASES_fig3b := stiffness=10_*
CASES_fig3c := stiffness=20_*
CASES_fig3d := stiffness=50_*
CASES_fig4a := stiffness=3_*
CASES_fig4b := stiffness=10_*
CASES_fig4c := stiffness=20_*
CASES_fig4d := stiffness=50_*
CASES_fig6a := grade=1_stiffness=3_*
CASES_fig6b := grade=1_stiffness=50_*
CASES_fig6c := grade=6.3_stiffness=3_*
CASES_fig6d := grade=6.3_stiffness=50_*
CASES_map := stiffness=10_displacement=0.2
CASES_gain10 := stiffness=10_*
CASES_gain50 := stiffness=50_*

figures: $(NUMBERED) ## compute and draw all figures of the paper, into build/paper/figures
fig3: ## bifurcation sets for three displacements of the rings; fig3a to fig3d: one foil
fig4: ## response envelopes at two excitation frequencies; fig4a to fig4d: one foil
fig5: ## bifurcation tree of period doublings
fig6: ## the unbalanced rotor in time over balanced cycles; fig6a to fig6d: one foil and grade

map: ## what the paper leaves open: the set of k_b = 10 in Fig. 3 with the type of every bifurcation
gain: ## likewise: how the anti-resonance grows with the displacement; gain10, gain50: one foil
energy: ## likewise: a whirl that the rings stop, with the energies of the modes

number = $(strip $(foreach each,$(NUMBERED) $(OPEN),$(findstring $(each),$@)))
letters = $(or $(filter $@%,$(LETTERED)),$@)

define compute
$(BIN)/agfb $(1) configs/paper/$(or $(CONFIG_$(number)),$(number)).toml -o $(PAPER)/$(number).zarr --workers $(WORKERS) \
	--case '$(or $(CASES_$@),*)' $(OPTIONS_$(number)) $(OPTIONS) \
	|| test $$? -eq 3

endef
define draw
$(BIN)/agfb figures $(PAPER)/$(number).zarr -o $(PAPER)/figures/$(1).png --figure $(KIND_$(number)) \
	--case '$(or $(CASES_$(1)),*)'

endef

# Every command goes on with what is there: only what is missing is computed. Code 3: some cases failed; the others are
# drawn all the same.
$(NUMBERED) $(OPEN) $(LETTERED): $(INSTALLED)
	$(foreach stage,$(STAGES_$(number)),$(call compute,$(stage)))
	$(foreach letter,$(letters),$(call draw,$(letter)))

.PHONY: readings
readings: $(INSTALLED) ## what other readings of the paper change: 72 branches, build/paper/figures/readings.png
	$(BIN)/agfb continue-cycles configs/paper/readings.toml -o $(PAPER)/readings.zarr --workers $(WORKERS) $(OPTIONS) \
		|| test $$? -eq 3
	$(BIN)/agfb figures $(PAPER)/readings.zarr -o $(PAPER)/figures/readings.png --figure changes

bench: $(INSTALLED) ## measure the ratios of configs/performance.md: build/bench.json
	$(BIN)/python -m tests.benchmarks

clean: ## delete what the targets above made, except .venv
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find agfb_cli pipelines tests -name __pycache__ -type d -prune -exec rm -rf {} +
