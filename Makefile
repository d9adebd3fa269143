# vlnpe: every target installs what it needs first; only Python, make and git are required.
ROBOT      ?= aliengo
CONTROLLER ?= auto
SCENE      ?= builtin
EPISODES   ?= 6
CAMERA     ?= ego
LIGHT      ?= baked
SEED       ?= 0
POLICY     ?= random

PYTHON := $(shell command -v python3 || command -v python)
BIN    := .venv/bin
SETUP  := $(PYTHON) pipeline/bootstrap.py
# Trained policies that come with vlnpe, and what such policies need: PyTorch, and some pretrained encoders.
SHIPPED := $(basename $(notdir $(wildcard learning/policies/*.safetensors)))
LEARNED := train,pretrained

COLLECT = --robot "$(ROBOT)" --controller "$(CONTROLLER)" --scene "$(SCENE)" --episodes "$(EPISODES)" \
          --camera "$(CAMERA)" --light "$(LIGHT)" --seed "$(SEED)" \
          $(if $(SCENES),--scenes "$(SCENES)") $(if $(OUT),--out "$(OUT)") \
          $(if $(WORKERS),--workers "$(WORKERS)") $(ARGS)

# Containers often set it; every process then compiles the source of all libraries that it imports.
unexport PYTHONDONTWRITEBYTECODE

# A misspelt variable would be ignored. Names with an underscore are those of libraries.
VARIABLES = ROBOT CONTROLLER SCENE SCENES EPISODES CAMERA LIGHT SEED OUT WORKERS ARGS POLICY TRAIN UNSEEN KINDS PATHS \
            IMAGE EXTRA ONLY VERBOSE PYTHON SHELL MAKE%
GIVEN     := $(foreach name,$(.VARIABLES),$(if $(filter line,$(origin $(name))),$(if $(findstring _,$(name)),,$(name))))
ifneq ($(filter-out $(VARIABLES),$(GIVEN)),)
$(error unknown variable $(filter-out $(VARIABLES),$(GIVEN)); valid: $(filter-out PYTHON SHELL MAKE%,$(VARIABLES)))
endif

.DEFAULT_GOAL := help
.PHONY: help setup collect view dataset-bench evidence evaluate adapt train-gait test test-fast test-slow lint audit docs bench \
        report verify doctor clean

help:  ## Show this help
	@echo "usage: make <target> [VARIABLE=value …]"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo "variables for collect: ROBOT=$(ROBOT) CONTROLLER=$(CONTROLLER) SCENE=$(SCENE) EPISODES=$(EPISODES)"
	@echo "  CAMERA=$(CAMERA) LIGHT=$(LIGHT) SEED=$(SEED) SCENES=<folder> OUT=<folder> WORKERS=<processes>"
	@echo "  ARGS=<any other option of vlnpe collect, see vlnpe collect --help>"
	@echo "Without OUT, evaluate, report, verify and view take the run runs/apartment-SEED."

setup:  ## Install the core environment into .venv (collect does this automatically) [EXTRA=train,… VERBOSE=1]
	@$(SETUP) core "$(EXTRA)"

collect:  ## Collect a dataset: make collect ROBOT=aliengo [SCENE=scan.glb EPISODES=8 OUT=…]
	@$(SETUP) core
	@$(BIN)/vlnpe collect $(COLLECT)

view:  ## Look at a run in the browser: make view [OUT=runs/<name>]
	@$(SETUP) core view
	@$(BIN)/vlnpe view "$(or $(OUT),runs/apartment-$(SEED))" $(ARGS)

dataset-bench:  ## Collect the training data of the baselines: make dataset-bench [ROBOT=h1,aliengo CONTROLLER=… TRAIN=40 UNSEEN=10 KINDS=apartment,villa PATHS=36 IMAGE=128 OUT=…]
	@$(SETUP) core
	@$(BIN)/python -m benchmarks.dataset $(if $(TRAIN),--train "$(TRAIN)") $(if $(UNSEEN),--unseen "$(UNSEEN)") \
	    $(if $(KINDS),--kinds "$(KINDS)") $(if $(PATHS),--paths "$(PATHS)") $(if $(IMAGE),--image "$(IMAGE)") $(if $(OUT),--out "$(OUT)") \
	    $(if $(filter-out file,$(origin ROBOT)),--robot "$(ROBOT)") \
	    $(if $(filter-out file,$(origin CONTROLLER)),--controller "$(CONTROLLER)") \
	    $(if $(WORKERS),--workers "$(WORKERS)") $(ARGS)

evidence:  ## Train and test what docs/results/data.md rests on: make evidence [ARGS="mixtures --draw"]
	@$(SETUP) full
	@$(BIN)/python -m benchmarks.evidence $(ARGS)

evaluate:  ## Evaluate a policy in closed loop: make evaluate POLICY=cma-robots ROBOT=h1 [CONTROLLER=speed OUT=runs/<name>]
	@$(SETUP) core $(if $(filter $(SHIPPED) %.safetensors,$(POLICY)),$(LEARNED))
	@$(BIN)/vlnpe evaluate "$(or $(OUT),runs/apartment-$(SEED))" --policy "$(POLICY)" --robot "$(ROBOT)" \
	    --controller "$(CONTROLLER)" $(ARGS)

adapt:  ## Fine-tune a policy to your building and test it: make adapt SCENE=scan.glb ROBOT=aliengo [POLICY=cma-robots-32px OUT=…]
	@$(SETUP) core $(if $(filter-out file,$(origin POLICY)),$(LEARNED),train)
	@$(BIN)/vlnpe adapt $(if $(filter-out file,$(origin SCENE)),"$(SCENE)") --robot "$(ROBOT)" --controller "$(CONTROLLER)" --seed "$(SEED)" \
	    $(if $(filter-out file,$(origin POLICY)),--policy "$(POLICY)") $(if $(OUT),--out "$(OUT)") \
	    $(if $(WORKERS),--workers "$(WORKERS)") $(ARGS)

train-gait:  ## Train a gait, also of a robot of your own: make train-gait ROBOT=mydog [OUT=folder ARGS="--terrain stairs"]
	@$(SETUP) full
	@$(BIN)/python -m vlnpe.collectors.locomotion.training.train "$(ROBOT)" $(if $(OUT),--out "$(OUT)") $(ARGS)

test:  ## Run the tests but for the slow ones, about 11 minutes on 2 cores (installs torch and lerobot, too)
	@$(SETUP) full
	@echo "about 11 minutes on 2 cores; make test-fast needs neither torch nor lerobot, make test-slow runs the rest"
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder -m "not slow"

test-fast:  ## Run the fast tests of the core: no torch, no lerobot, no generated buildings, no whole runs
	@$(SETUP) test
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder --core -m "not slow and not chain"

test-slow:  ## Run the slow tests: whole chains, buildings, kills, clusters
	@$(SETUP) full
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder -m slow

docs:  ## Build the documentation's site in build/docs; a broken link is an error
	@$(SETUP) full
	@$(BIN)/python -m sphinx -q -W --keep-going -E docs build/docs

lint:  ## Check formatting, style and types
	@$(SETUP) full
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright

audit:  ## Check licences of all packages and, online, their known vulnerabilities
	@$(SETUP) full
	@$(BIN)/python -m tests.support.audit

bench:  ## Run the benchmarks, write benchmarks/README.md, then the slow tests: make bench [ONLY="render write"]
	@$(SETUP) full
	@$(BIN)/python -m benchmarks $(ONLY)
	@$(if $(ONLY),,$(MAKE) test-slow)

report:  ## Regenerate a run's report: make report OUT=runs/<name>
	@$(SETUP) core
	@$(BIN)/vlnpe report "$(or $(OUT),runs/apartment-$(SEED))"

verify:  ## Verify a run's outputs: make verify OUT=runs/<name>
	@$(SETUP) core
	@$(BIN)/vlnpe verify "$(or $(OUT),runs/apartment-$(SEED))"

doctor:  ## Check this machine and report what is missing
	@$(SETUP) core
	@$(BIN)/vlnpe doctor

clean:  ## Remove the environment and caches; keep runs/
	rm -rf .venv .tools .pytest_cache .ruff_cache .hypothesis build dist *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
