# Each target works on a fresh clone: it makes its own virtual environment in .venv from pyproject.toml,
# with the versions of constraints.txt, once.
#
#   make demo    reconstruct Spirit's entry from the shipped telemetry; figures and results go to demo-results
#   make test    run the tests        make lint   ruff        make types   mypy        make layers  import-linter
#   make notebooks      execute the notebooks (minutes)
#   make coverage       lines and branches of the package that make test passes through (twice its time)
#   make test-browser   operate the workbench and the report in Chromium (minutes)
#   make test-effects   hide every effect of the catalogue in a simulated flight and diagnose it, and run the tests that
#                       take longest (a quarter of an hour)
#   make fuzz    search for files that break a reader, a minute for each kind of file
#   make study-faults       faults of an IMU's samples in simulated flights: how many are repaired (an hour; goes on)
#   make study-rover-faults  faults of one IMU in the telemetry of Spirit and Opportunity (ten minutes; goes on)
#   make study-velocity-register  when the rovers' computer added an increment to its velocity register (seconds)
#   make study-imu-difference  how the rovers' two IMUs differ, and what is filled from the other one (two minutes)
#   make study-lost-seconds  a second of the first IMU lost at 50 times of 40 flights: do the errors agree with the sigmas
#   make study-dynamics-filling  lost stretches filled by an autoregression and by rotational dynamics (ten minutes)
#   make study-kills        kill -9 at 50 moments of run, diagnose, improve and campaign: is a result ever torn (ten minutes)
#   make study-mutation     one change at a time in files of the diagnosis, estimation and navigation: does a test fail
#                           (hours; goes on)
#   make calibrate   are the sigmas true: 300 simulated flights with gaps, against their truth (ten minutes; goes on)
#   make bench   measure times beside other packages and write docs/performance.md (half an hour; goes on)
#   make clean   remove what these targets made
#   make docs    build the documentation into docs/_build/html; a warning is an error
#   make study-simulation   reconstruct many simulated flights and judge the errors (some minutes)
#   make study-closure      how often the post-flight layer's bands hold the truth, over many flights (minutes)
#   make study-filters      the unscented against the extended filter (minutes; goes on where it stopped)
#   make study              how often the right effect is named, on simulated flights (hours; goes on where it stopped)
#   make study-inexact      the same where tables, air, mass and inertia are not exact (hours; goes on where it stopped)
#   make study-thresholds   which verdicts change with each threshold of the diagnosis (hours; resumable)
#   make thesis-claims      write docs/thesis-claims.md: every statement of the thesis on the rovers with our number (seconds)
#   make study-comparators  what stepwise regression and pysindy say of the practice flights
#   make study-cross-prediction  learn the increments on one rover and predict the other (5 minutes)
#   make study-moment-regression  which kind of moment the models of both rovers lack (seconds)

PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed
DOCS_STAMP := .venv/installed-docs
BENCH_STAMP := .venv/installed-bench
COVERAGE_STAMP := .venv/installed-coverage
FAST := not browser and not notebook and not slow and (not effects or representative)

.PHONY: demo test coverage notebooks test-browser test-effects lint types layers bench docs study study-inexact study-simulation study-closure study-filters study-thresholds study-comparators study-cross-prediction study-moment-regression thesis-claims clean fuzz study-faults study-rover-faults study-velocity-register study-imu-difference study-lost-seconds study-dynamics-filling study-kills study-mutation calibrate

demo: $(STAMP)
	$(BIN)/edl-filter demo -o demo-results

# One worker per file, so that what a file reads or reconstructs once serves all its tests; the order is that of
# tests/conftest.py, longest files first, where xdist would take the files with most tests first
test: $(STAMP)
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "$(FAST)"

# Functions that numba compiles are not counted (pyproject.toml): coverage sees interpreted code only, and interpreted
# flights take hours. Tests of computing times may fail while it measures; the report follows all the same
coverage: $(COVERAGE_STAMP)
	-$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "$(FAST)" --cov --cov-report=
	$(BIN)/coverage report --sort cover

# Five notebooks, each with runs and diagnoses of its own
notebooks: $(STAMP)
	$(BIN)/pytest -n 2 -m notebook tests/notebooks

# Two runs and two diagnoses by clicking take minutes, and need Chromium
test-browser: $(STAMP)
	$(BIN)/pytest -m browser tests/serve tests/report/html

# A flight and a diagnosis for nearly every test: a worker that has none left takes over some of the other's
test-effects: $(STAMP)
	$(BIN)/pytest -n 2 --dist worksteal -m "effects or slow"

# With atheris (pip install 'edl-filter[fuzz]') also guided by coverage
fuzz: $(STAMP)
	PYTHONPATH=tests/hostile:tests/results $(BIN)/python tests/hostile/fuzz.py --seconds 60

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

# Lower layers never import higher ones, and no circle of packages or files (contracts in pyproject.toml)
layers: $(STAMP)
	$(BIN)/lint-imports --no-cache

# Installs the packages that it compares with; those that are missing when benchmarks/performance.py is called without
# make are named as such on the page. Benchmarks whose results lie in bench-results are not repeated (--again does)
bench: $(BENCH_STAMP)
	$(BIN)/python benchmarks/performance.py

# Every page is read anew (-E): parts of the pages are generated from the package, whose changes Sphinx does not detect
docs: $(DOCS_STAMP)
	$(BIN)/sphinx-build -W --keep-going -q -E -b html docs docs/_build/html
	@echo "Open docs/_build/html/index.html"

study: $(STAMP)
	$(BIN)/python benchmarks/studies/identification.py -o study-results/identification.jsonl
	$(BIN)/python benchmarks/studies/identification_report.py study-results/identification.jsonl \
	  --figure docs/figures/identification.png

study-inexact: $(STAMP)
	$(BIN)/python benchmarks/studies/inexact.py -o study-results/inexact.jsonl
	$(BIN)/python benchmarks/studies/inexact_report.py study-results/inexact.jsonl

study-simulation: $(STAMP)
	$(BIN)/python benchmarks/studies/simulation.py

study-closure: $(STAMP)
	$(BIN)/python benchmarks/studies/closure.py

study-thresholds: $(STAMP)
	$(BIN)/python benchmarks/studies/thresholds.py -o study-results/thresholds.jsonl
	$(BIN)/python benchmarks/studies/thresholds.py --report study-results/thresholds.jsonl

study-faults: $(STAMP)
	$(BIN)/python benchmarks/studies/faults.py -o study-results/faults.jsonl --imus 2 1

study-rover-faults: $(STAMP)
	$(BIN)/python benchmarks/studies/rover_faults.py -o study-results/rover-faults.jsonl

study-velocity-register: $(STAMP)
	$(BIN)/python benchmarks/studies/velocity_register.py

study-imu-difference: $(STAMP)
	$(BIN)/python benchmarks/studies/imu_difference.py

study-lost-seconds: $(STAMP)
	$(BIN)/python benchmarks/studies/lost_seconds.py -o study-results/lost-seconds.jsonl

study-dynamics-filling: $(STAMP)
	for mission in mer_a mer_b practice_mer; do $(BIN)/python benchmarks/studies/dynamics_filling.py builtin:$$mission || exit 1; done

study-kills: $(STAMP)
	$(BIN)/python benchmarks/studies/kills.py --moments 50

study-mutation: $(STAMP)
	$(BIN)/python benchmarks/studies/mutation.py -o study-results/mutation.jsonl

calibrate: $(STAMP)
	$(BIN)/python benchmarks/studies/calibration.py -o study-results/calibration.jsonl
	$(BIN)/python benchmarks/studies/calibration_report.py study-results/calibration.jsonl \
	  --inexact study-results/inexact.jsonl

study-filters: $(STAMP)
	$(BIN)/python benchmarks/studies/filter_comparison.py

study-comparators: $(STAMP)
	$(BIN)/python benchmarks/studies/comparators.py

study-cross-prediction: $(STAMP)
	$(BIN)/python benchmarks/studies/cross_prediction.py --sensitivity --figure docs/figures/increments_of_both_rovers.png
	$(BIN)/python benchmarks/studies/cross_prediction.py --estimate

study-moment-regression: $(STAMP)
	$(BIN)/python benchmarks/studies/moment_regression.py --set aerodynamics.discrepancy.asymmetry_sigma=0
	$(BIN)/python benchmarks/studies/moment_regression.py

thesis-claims: $(STAMP)
	PYTHONPATH=benchmarks/studies $(BIN)/python -m thesis_claims

clean:
	rm -rf .venv demo-results bench-results .coverage docs/_build build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

# The stamp is written last: an installation that was interrupted starts again from nothing
$(STAMP): pyproject.toml constraints.txt
	rm -rf .venv
	$(PYTHON) -c 'import sys; sys.exit("edl-filter needs Python 3.11 or newer; say which with PYTHON=...") \
	if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	--constraint constraints.txt --editable '.[dev]'
	touch $@

$(DOCS_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	--constraint constraints.txt --editable '.[docs]'
	touch $@

$(COVERAGE_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	--constraint constraints.txt --editable '.[coverage]'
	touch $@

$(BENCH_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	--constraint constraints.txt --editable '.[bench]'
	touch $@
