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
.PHONY: help lab throw doctor editions grade docs paper results check test test-browser format lock clean
.PHONY: opengl tested notebooks site slides test-lab test-site test-throw chromium findings picture data train checksums worlds reproduce

help:
	@awk '/^##@ / { printf "\n%s\n", substr($$0, 5) } \
		/^[a-z-]+:.*## / { split($$0, part, /:.*## /); printf "  make %-13s %s\n", part[1], part[2] }' $(MAKEFILE_LIST)
	@printf '\nCONTRIBUTING.md names the others.\n'

# What a bare Debian or Ubuntu lacks of what is needed: OpenGL without a display; a library of Playwright's Node.js, which runs
# sources of the page and leads a browser; the browser.
SYSTEM := sh scripts/system_packages.sh
OPENGL := libegl1 libopengl0 libgl1-mesa-dri
NODE := libatomic1
BROWSER := chromium $(NODE)

# PyTorch without CUDA is several gigabytes smaller; UV_TORCH_BACKEND=auto takes the one for this machine's GPU. Where pip
# has a folder of packages of its own, uv looks there, too.
ifdef PIP_FIND_LINKS
export UV_FIND_LINKS ?= $(PIP_FIND_LINKS)
else
export UV_TORCH_BACKEND ?= cpu
endif

$(STAMP): environment.txt pyproject.toml | opengl
	@test -w . || { echo "This folder is not yours to write into. Type: cp -R '$(CURDIR)' ~/clothlab && make -C ~/clothlab $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "clothlab needs Python 3.11 or newer; name one: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || $(SYSTEM) $(notdir $(PYTHON))-venv
	$(PYTHON) -m venv $(VENV)
	@echo "Installing what environment.txt names"
	@$(BIN)/pip install --quiet uv && \
		$(BIN)/uv pip install --quiet --python $(BIN)/python --requirement environment.txt || \
		{ echo "The packages could not be installed, which needs the internet this once: connect this machine, and type again: make $(MAKECMDGOALS)"; exit 1; }
	@touch $@

# Nearly all of it draws.
opengl:
	@$(SYSTEM) $(OPENGL) || true

##@ To learn and to look

# JupyterLab starts in the repository's root: a notebook's ../docs would lie outside of what it serves otherwise.
lab: $(VENV)/checked  ## open the notebooks in JupyterLab
	$(BIN)/jupyter lab --config=jupyter_lab_config.py $(if $(filter 0,$(shell id -u)),--allow-root) --LabApp.default_url=/lab/tree/notebooks/00_start_here.ipynb

# Some shells have a HOST of their own: only one that is given to make counts.
throw: build/throw/index.html  ## a robot in your browser; HOST=0.0.0.0 for telephones in the same network
	@$(BIN)/python -m web serve $(if $(filter command%,$(origin HOST)),--host $(HOST)) $(if $(PORT),--port $(PORT))

build/throw/index.html: $(wildcard web/*.py web/*.toml web/page/* clothlab/*.py clothlab/*/*.py clothlab/lab/static/*) data/SHA256SUMS | $(STAMP)
	$(BIN)/python -m web build

doctor: $(STAMP)  ## check this machine: versions, drawing, data
	@$(BIN)/python -m clothlab doctor

# Once after each installation: it takes longer than JupyterLab does to start.
$(VENV)/checked: $(STAMP)
	@$(BIN)/python -m clothlab doctor
	@touch $@

##@ To teach

editions: $(EXECUTED)  ## notebooks for students (build/student) and executed with solutions (build/instructor)
	$(BIN)/jupyter nbconvert --log-level ERROR --to html build/instructor/*.ipynb

grade: $(STAMP)  ## points and words for a class: FOLDER=path, perhaps ONLY="00 01"
	@$(BIN)/python scripts/grade.py "$(or $(FOLDER),$(error say which folder: make grade FOLDER=path/to/the/class))" $(if $(ONLY),--only $(ONLY))

docs: site slides  ## the executed series as a site (build/book/html) and as slides; SMALL=1 with CI's sizes

$(EXECUTED): build/full/notebooks/%: notebooks/% $(SOURCES) | $(STAMP)
	$(BIN)/python scripts/editions.py $<

# What notebooks link to; pages of before are gone.
define WITH_PAGES
rm -rf $(RUN)/docs $(RUN)/data $(RUN)/web $(RUN)/reference $(RUN)/*.md
mkdir $(RUN)/data $(RUN)/web
cp -R *.md LICENSE CITATION.cff docs docs/book/index.md docs/book/reference.rst $(RUN)
cp data/README.md $(RUN)/data
cp web/README.md $(RUN)/web
endef

site: $(STAMP) $(if $(SMALL),build/small,$(EXECUTED))
	$(WITH_PAGES)
	rm -rf build/book
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going \
		--conf-dir docs/book --doctree-dir build/book/doctrees $(RUN) build/book/html
	if [ -d build/throw ]; then cp -R build/throw build/book/html/throw; fi
	@echo "build/book/html/index.html: open it in a browser"

slides: $(STAMP) $(if $(SMALL),build/small,$(EXECUTED))
	$(WITH_PAGES)
	$(BIN)/jupyter nbconvert --log-level ERROR --to slides --config docs/course/slides.py --output-dir build/slides $(RUN)/notebooks/*.ipynb
	@echo "build/slides: open the pages in a browser; the arrow keys lead on"

##@ To compute the results again

paper: $(STAMP)  ## the paper's results once, from nothing, in build/paper; goes on where it stopped
	$(BIN)/python scripts/reproduce.py paper $(OPTIONS)

results: $(STAMP)  ## every experiment at full size, with fresh simulation; NAMES="control" chooses
	$(BIN)/python scripts/reproduce.py results $(NAMES)

data: $(STAMP)
	$(BIN)/python scripts/reproduce.py record $(NAMES)

train: $(STAMP)
	$(BIN)/python scripts/reproduce.py train $(NAMES)

checksums: $(STAMP)
	$(BIN)/python -c "from clothlab import data; data.write_checksums()"

worlds: $(STAMP)
	$(BIN)/python scripts/reproduce.py worlds $(OPTIONS)

reproduce: $(STAMP)
	$(BIN)/python scripts/reproduce.py everything $(OPTIONS)

##@ To change it

check: $(STAMP)  ## linter, types and quick tests
	$(call CHECKED)

# The linters, then types beside tests, whose options stand behind it.
define CHECKED
@$(SYSTEM) $(NODE) || true
$(BIN)/ruff check .
$(BIN)/ruff format --check .
$(BIN)/lint-imports --no-logo
$(BIN)/mypy & types=$$!; $(PYTEST) $(1); tests=$$?; wait $$types && exit $$tests
endef

test: doctor tested notebooks  ## the same, every slow test, every notebook

# What `make check` does and the slow tests, in one run: each process imports everything once.
tested: $(STAMP)
	$(call CHECKED,-rs -m 'not browser and not book')

notebooks: $(STAMP)
	rm -rf build/small && $(BIN)/python scripts/solutions.py solve --into build/small/notebooks $(NOTEBOOKS)
	CLOTHLAB_MINE= CLOTHLAB_SMALL=1 $(BIN)/pytest --nbmake -p nbmake --overwrite --nbmake-timeout=300 --durations=0 --numprocesses=auto $$(ls -r build/small/notebooks/*.ipynb)

# What `make notebooks` leaves, for site and slides; it is not made again where it is there.
build/small:
	$(MAKE) notebooks

test-browser: chromium build/small  ## what opens in a browser: the live lab, the site, the page "Throw a cloth"
	$(MAKE) --jobs=2 --keep-going test-lab test-site test-throw

test-lab: $(STAMP) chromium
	$(BIN)/pytest -m browser -s tests/browser

test-site: chromium build/small
	$(MAKE) site SMALL=1
	$(MAKE) slides SMALL=1
	$(BIN)/pytest -m book -rs tests/browser/test_site.py

test-throw: build/throw/index.html chromium
	$(BIN)/pytest -rs -m '' web/tests

# The system's package, else Playwright's own. Where neither can be had, the first is asked again, so that the last words are
# those that say what to type.
chromium: $(STAMP)
	@$(SYSTEM) $(BROWSER) || $(BIN)/playwright install chromium || $(SYSTEM) $(BROWSER)

findings: $(STAMP)
	$(BIN)/python scripts/editions.py $(NOTEBOOKS)

picture: $(STAMP)
	$(BIN)/python scripts/make_picture.py

format: $(STAMP)  ## format code and notebooks, write links and times into the pages
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/nbstripout --keep-id $(NOTEBOOKS)
	$(BIN)/python scripts/solutions.py format $(NOTEBOOKS)
	$(BIN)/python scripts/repository.py
	$(BIN)/python scripts/series.py

# Pinned versions stay, unless UPGRADE=1. What CUDA consists of is left out: an installer takes what the build of PyTorch at
# hand asks for.
lock: $(STAMP)  ## pin the packages of pyproject.toml in environment.txt; UPGRADE=1 for the newest
	UV_FIND_LINKS= $(BIN)/uv pip compile pyproject.toml --quiet --universal --python-version 3.11.2 --fork-strategy fewest \
		--group dev --group book --group web --no-header --no-annotate $(if $(UPGRADE),--upgrade) --output-file environment.txt
	{ echo "# Every package and its version: \`make lock\` writes it from pyproject.toml."; \
		grep -Ev '^(nvidia-|cuda-|triton)' environment.txt; echo "-e ."; } > build/environment.txt
	mv build/environment.txt environment.txt

# What takes hours to compute stays: build/experiments, build/paper, build/reproduce, build/worlds.
clean:  ## delete what was built, but no results of experiments
	if [ -d build ]; then find build -mindepth 1 -maxdepth 1 ! -name experiments ! -name paper ! -name reproduce ! -name worlds -exec rm -rf {} +; fi
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
