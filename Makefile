# Every target starts from a fresh clone: it makes .venv and installs what is missing, and does neither a second time.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# There when all that environment.txt pins is installed.
STAMP := $(VENV)/installed
NOTEBOOKS := $(sort $(wildcard notebooks/*.ipynb))
EXECUTED := $(NOTEBOOKS:notebooks/%=build/full/notebooks/%)
# Executed notebooks, beside which site and slides find all pages and pictures.
RUN := build/$(if $(SMALL),small,full)
SOURCES := $(wildcard clothlab/*.py clothlab/*/*.py clothlab/lab/static/* studies/*.py studies/*/*.py) data/SHA256SUMS
# In as many processes as there are cores; what is left at the end is shared among them.
PYTEST := $(BIN)/pytest --numprocesses=auto --dist=worksteal
# The matrices are small: a second thread would only wait.
export OMP_NUM_THREADS ?= 1
# A training step frees some 40 MB and asks for them again. Left alone, glibc gives them back to the system, which clears
# thousands of pages anew for each step: a sixth of an autoencoder's training.
export MALLOC_TRIM_THRESHOLD_ ?= 536870912
export MALLOC_MMAP_THRESHOLD_ ?= 33554432
# Set in many containers. Each process would then compile anew what pytest makes of the tests: five seconds.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help lab check test tested slow pages throw throw-tested notebooks site site-built site-tested browser chromium data checksums train results paper reproduce worlds findings picture editions grades slides book format doctor lock

help:  ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

# What a bare Debian or Ubuntu lacks of what is needed: OpenGL without a display; a browser, and what leads it.
SYSTEM := sh scripts/system_packages.sh
OPENGL := libegl1 libopengl0 libgl1-mesa-dri
BROWSER := chromium libatomic1

# PyTorch without CUDA is several gigabytes smaller; UV_TORCH_BACKEND=auto takes the one for this machine's GPU. Where pip
# has a folder of packages of its own, uv looks there, too.
ifdef PIP_FIND_LINKS
export UV_FIND_LINKS ?= $(PIP_FIND_LINKS)
else
export UV_TORCH_BACKEND ?= cpu
endif

$(STAMP): environment.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "clothlab needs Python 3.11 or newer; name one: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || $(SYSTEM) $(notdir $(PYTHON))-venv
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet uv
	$(BIN)/uv pip install --quiet --python $(BIN)/python --requirement environment.txt
	@touch $@

doctor: $(STAMP)  ## check this machine: versions, drawing, data
	@$(SYSTEM) $(OPENGL) || true
	@$(BIN)/python -m clothlab doctor

# JupyterLab starts in the repository's root: a notebook's ../docs would lie outside of what it serves otherwise.
lab: doctor  ## open the notebooks in JupyterLab
	$(BIN)/jupyter lab --config=jupyter_lab_config.py $(if $(filter 0,$(shell id -u)),--allow-root) --LabApp.default_url=/lab/tree/notebooks/00_start_here.ipynb

check: $(STAMP)  ## linter, types and unit tests, in parallel
	$(call CHECKED)

# The linters, then types beside tests, whose options stand behind it.
define CHECKED
$(BIN)/ruff check .
$(BIN)/ruff format --check .
$(BIN)/lint-imports --no-logo
$(BIN)/mypy & types=$$!; $(PYTEST) $(1); tests=$$?; wait $$types && exit $$tests
endef

test: doctor tested notebooks  ## linter, types, every test without a browser, every notebook

# What `make check` and `make slow` do, in one run: each process imports everything once.
tested: $(STAMP)
	$(call CHECKED,-rs -m 'not browser and not book')

slow: $(STAMP)  ## only the tests that start kernels and processes of their own
	$(PYTEST) -m slow -rs

# What `make notebooks` leaves, for the site; it is not made anew where it is there.
build/small:
	$(MAKE) notebooks

pages: chromium build/small  ## the live lab in JupyterLab, the site, and the page "Throw a cloth", in a browser
	$(MAKE) --jobs=2 --keep-going browser site throw-tested

site: chromium build/small  ## the site and the slides from the run of `make notebooks`, and its tests in a browser
	$(MAKE) site-built
	$(MAKE) site-tested

site-built:
	$(MAKE) book SMALL=1
	$(MAKE) slides SMALL=1

site-tested:
	$(BIN)/pytest -m book -rs tests/browser/test_site.py

notebooks: $(STAMP)  ## run every notebook from top to bottom with CI's small sizes, into build/small
	rm -rf build/small && $(BIN)/python scripts/solutions.py solve --into build/small/notebooks $(NOTEBOOKS)
	CLOTHLAB_MINE= CLOTHLAB_SMALL=1 $(BIN)/pytest --nbmake -p nbmake --overwrite --nbmake-timeout=300 --durations=0 --numprocesses=auto $$(ls -r build/small/notebooks/*.ipynb)

findings: $(STAMP)  ## every notebook at full size, every finding judged by what was measured
	$(BIN)/python scripts/editions.py $(NOTEBOOKS)

throw: build/throw/index.html  ## build the page "Throw a cloth" and serve it on this machine; web/README.md says more
	$(BIN)/python -m web serve

build/throw/index.html: $(wildcard web/*.py web/*.toml web/page/* clothlab/*.py clothlab/*/*.py clothlab/lab/static/*) data/SHA256SUMS | $(STAMP)
	$(BIN)/python -m web build

throw-tested: build/throw/index.html chromium
	$(BIN)/pytest -rs -m '' web/tests

browser: $(STAMP) chromium  ## only the live lab in JupyterLab in Chromium; screenshots go to build/screenshots
	$(BIN)/pytest -m browser -s tests/browser

chromium: $(STAMP)
	@$(SYSTEM) $(BROWSER) || $(BIN)/playwright install chromium

data: $(STAMP)  ## record all trials and targets anew (simulation); NAMES="train" chooses, here and in the next two
	$(BIN)/python scripts/reproduce.py record $(NAMES)

checksums: $(STAMP)  ## record the hashes of the files in data/ after a change to them
	$(BIN)/python -c "from clothlab import data; data.write_checksums()"

train: $(STAMP)  ## train autoencoders and DPMPBs anew from data/trials
	$(BIN)/python scripts/reproduce.py train $(NAMES)

results: $(STAMP)  ## run the experiments of the stored tables anew, and write the README's rows
	$(BIN)/python scripts/reproduce.py results $(NAMES)

paper: $(STAMP)  ## the paper's results once, from nothing, in build/paper: record, train, estimate, control; goes on where it stopped
	$(BIN)/python scripts/reproduce.py paper $(OPTIONS)

worlds: $(STAMP)  ## ten times everything from other seeds, in build/worlds, then tables side by side (OPTIONS="--paper-only --count 3")
	$(BIN)/python scripts/reproduce.py worlds $(OPTIONS)

reproduce: $(STAMP)  ## everything from nothing, in build/reproduce; goes on where it stopped (OPTIONS="--seeds 2 --scheduler ADDRESS --paper-only")
	$(BIN)/python scripts/reproduce.py everything $(OPTIONS)

picture: $(STAMP)  ## draw the README's moving picture and its gallery anew, after `make notebooks`
	$(BIN)/python scripts/make_picture.py

$(EXECUTED): build/full/notebooks/%: notebooks/% $(SOURCES) | $(STAMP)
	$(BIN)/python scripts/editions.py $<

editions: $(EXECUTED)  ## write build/student (stubs) and build/instructor (executed, with solutions; also as HTML)
	$(BIN)/jupyter nbconvert --log-level ERROR --to html build/instructor/*.ipynb

grades: $(STAMP)  ## FOLDER=... points and words for each student in it; ONLY="00 01" chooses notebooks
	@$(BIN)/python scripts/grade.py "$(or $(FOLDER),$(error say which folder: make grades FOLDER=path/to/the/class))" $(if $(ONLY),--only $(ONLY))

# What notebooks link to; pages of before are gone.
define WITH_PAGES
rm -rf $(RUN)/docs $(RUN)/data $(RUN)/web $(RUN)/reference $(RUN)/*.md
mkdir $(RUN)/data $(RUN)/web
cp -R *.md LICENSE docs docs/book/index.md docs/book/reference.rst $(RUN)
cp data/README.md $(RUN)/data
cp web/README.md $(RUN)/web
endef

book: $(STAMP) $(if $(SMALL),build/small,$(EXECUTED))  ## the executed series as a web site; SMALL=1 from `make notebooks`
	$(WITH_PAGES)
	rm -rf build/book
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going \
		--conf-dir docs/book --doctree-dir build/book/doctrees $(RUN) build/book/html
	if [ -d build/throw ]; then cp -R build/throw build/book/html/throw; fi
	@echo "build/book/html/index.html: open it in a browser"

slides: $(STAMP) $(if $(SMALL),build/small,$(EXECUTED))  ## a deck of each notebook for a projector in build/slides; SMALL=1 from `make notebooks`
	$(WITH_PAGES)
	$(BIN)/jupyter nbconvert --log-level ERROR --to slides --config docs/course/slides.py --output-dir build/slides $(RUN)/notebooks/*.ipynb
	@echo "build/slides: open the pages in a browser; the arrow keys lead on"

# Pinned versions stay, unless UPGRADE=1. What CUDA consists of is left out: an installer takes what the build of PyTorch at
# hand asks for.
lock: $(STAMP)  ## pin what pyproject.toml names in environment.txt; UPGRADE=1 takes the newest versions
	UV_FIND_LINKS= $(BIN)/uv pip compile pyproject.toml --quiet --universal --python-version 3.11.2 --fork-strategy fewest \
		--group dev --group book --group web --no-header --no-annotate $(if $(UPGRADE),--upgrade) --output-file environment.txt
	{ echo "# Every package and its version: \`make lock\` writes it from pyproject.toml."; \
		grep -Ev '^(nvidia-|cuda-|triton)' environment.txt; echo "-e ."; } > build/environment.txt
	mv build/environment.txt environment.txt

format: $(STAMP)  ## format code and notebooks, strip notebook outputs, write the links of pyproject.toml's address
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/nbstripout --keep-id $(NOTEBOOKS)
	$(BIN)/python scripts/solutions.py format $(NOTEBOOKS)
	$(BIN)/python scripts/repository.py
