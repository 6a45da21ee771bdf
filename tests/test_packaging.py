"""A wheel works outside the clone: what it holds, what it imports, where it finds data,
and that its method runs on the four packages that it asks for.
"""

import os
import re
import subprocess
import sys
import sysconfig
import threading
import tomllib
import venv
import zipfile
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
ALONE = Path(__file__).with_name("method_alone.py")
DEPLOYED = Path(__file__).with_name("deployed_alone.py")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The built wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel"]
    build += ["--directory", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel):
    """A folder with the unpacked wheel, far from the clone."""
    zipfile.ZipFile(wheel).extractall(wheel.parent / "site")
    return wheel.parent / "site"


def run(installed, tmp_path, code, data="", **more):
    """Run a line of Python with the unpacked wheel."""
    environment = os.environ | {
        "PYTHONPATH": str(installed),
        "CLOTHLAB_DATA": str(data),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "CLOTHLAB_DATA_URL": "http://127.0.0.1:9",  # where nothing answers
    }
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment | more,
        capture_output=True,
        text=True,
    )


def needs_of(names) -> dict[str, Distribution]:
    """The packages of these names and all that they need, as far as they are here.

    What is not here is not needed on this machine: CUDA, where PyTorch was built
    without.
    """
    found: dict[str, Distribution] = {}
    left = [canonicalize_name(name) for name in names]
    while left:
        name = left.pop()
        if name in found:
            continue
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:
            continue
        for line in found[name].requires or []:
            asked = Requirement(line)
            if asked.marker is None or asked.marker.evaluate({"extra": ""}):
                left.append(canonicalize_name(asked.name))
    return found


def fresh_environment(wheel, folder, packages) -> Path:
    """Python of a new environment that has the wheel and these packages alone.

    PyTorch is not installed once more, which would take minutes: the environment gets
    links to the files of the packages, and to no others.
    """
    venv.create(folder / "venv", with_pip=False)
    base = {"base": str(folder / "venv"), "platbase": str(folder / "venv")}
    site = Path(sysconfig.get_path("purelib", "venv", base))
    for package in packages.values():
        tops = {file.parts[0] for file in package.files or []} - {"..", "__pycache__"}
        for top in tops:
            if not (site / top).exists():
                (site / top).symlink_to(package.locate_file(top))

    binaries = "Scripts" if sys.platform == "win32" else "bin"
    python = folder / "venv" / binaries / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], check=True)
    return python


def asked_for(extra: str = "") -> set[str]:
    """Names of the packages that the wheel asks for, with an extra or without."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = list(project["dependencies"])
    if extra:
        lines += project["optional-dependencies"][extra]
    return {Requirement(each).name for each in lines}


@pytest.fixture(scope="module")
def bare(wheel, tmp_path_factory):
    """Python of a fresh environment that has the wheel, and what it asks for, alone."""
    asked = asked_for()
    assert asked == {"torch", "numpy", "tqdm", "safetensors"}
    packages = needs_of(asked)
    assert asked <= set(packages)
    return fresh_environment(wheel, tmp_path_factory.mktemp("bare"), packages)


@pytest.fixture(scope="module")
def deploying(wheel, tmp_path_factory):
    """The same with what exports graphs and runs them."""
    packages = needs_of(asked_for("onnx"))
    return fresh_environment(wheel, tmp_path_factory.mktemp("deploying"), packages)


def in_bare(bare, *words, check=True):
    """Run that Python without anything of this environment."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PYTHON", "CLOTHLAB"))
    }
    return subprocess.run(
        [str(bare), *words],
        cwd=bare.parent,
        env=environment,
        capture_output=True,
        text=True,
        check=check,
    )


def test_the_method_is_trained_saved_loaded_and_steers_in_a_fresh_environment(bare):
    where = in_bare(bare, "-c", "import clothlab; print(clothlab.__file__)").stdout
    assert Path(where.strip()).is_relative_to(bare.parents[1])
    assert in_bare(bare, str(ALONE)).stdout == "\n", "something else was imported"


@pytest.mark.nightly
def test_logs_become_a_graph_on_a_robot_in_a_fresh_environment(deploying):
    assert in_bare(deploying, str(DEPLOYED)).stdout == "\n", "something was imported"


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (
            "from clothlab import ClothEnv",
            "clothlab.ClothEnv needs mujoco: pip install 'clothlab[cloth]'",
        ),
        (
            "from clothlab import load",
            "clothlab.load needs mujoco: pip install 'clothlab[cloth]'",
        ),
        (
            "import clothlab.simulation",
            "clothlab.simulation needs mujoco: pip install 'clothlab[cloth]'",
        ),
        (
            "from clothlab import tables",
            "clothlab.tables needs pandas: pip install 'clothlab[notebooks]'",
        ),
    ],
)
def test_what_is_missing_there_says_which_extra_brings_it(bare, code, message):
    failed = in_bare(bare, "-c", code, check=False)
    assert failed.returncode
    sentence = failed.stderr.splitlines()[-1]
    assert sentence == f"ModuleNotFoundError: {message}"


def test_the_doctor_says_so_too(bare):
    done = in_bare(bare, "-m", "clothlab", "doctor", check=False)
    assert done.returncode == 1, done.stderr
    assert "mujoco missing" in done.stdout
    assert "pip install 'clothlab[cloth]'" in done.stdout


def test_it_holds_all_that_it_needs_and_nothing_else(installed):
    held, ours = (
        {
            path.relative_to(root).as_posix()
            for path in (root / "clothlab").rglob("*")
            if path.is_file()
        }
        for root in (installed, ROOT)
    )
    ours = {name for name in ours if "__pycache__" not in name}
    assert held == ours | {"clothlab/SHA256SUMS"}
    assert ours > {"clothlab/py.typed", "clothlab/__init__.pyi"}


def test_it_holds_neither_studies_nor_course_nor_notebooks(wheel):
    names = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert names == {"clothlab", f"clothlab-{clothlab.__version__}.dist-info"}
    copied = zipfile.ZipFile(wheel).read("clothlab/SHA256SUMS")
    assert copied == (ROOT / "data" / "SHA256SUMS").read_bytes()


def test_its_modules_come_when_they_are_asked_for(installed, tmp_path):
    code = "import clothlab, sys; print('mujoco' in sys.modules); from clothlab.simulation import muscle; print(muscle.__file__)"
    done = run(installed, tmp_path, code)
    assert done.stdout.split() == [
        "False",
        str(installed / "clothlab" / "simulation" / "muscle.py"),
    ], done.stderr


IN_FOLDERS = """
import os
from clothlab import load_target

for folder in {folders}:
    os.environ["CLOTHLAB_DATA"] = folder
    try:
        print(load_target("target-1").sum() > 100)
    except OSError as error:
        print(type(error).__name__, error, sep=": ")
"""


def test_it_finds_the_data_whose_folder_is_named_or_says_in_one_sentence_why_not(
    installed, tmp_path
):
    folders = [str(ROOT / "data"), str(tmp_path / "nowhere"), ""]
    done = run(installed, tmp_path, IN_FOLDERS.format(folders=folders))
    found, nowhere, unfetched = done.stdout.splitlines()
    assert found == "True"
    assert nowhere.startswith("FileNotFoundError: no data in")
    assert "set CLOTHLAB_DATA to that folder" in nowhere
    assert re.match(
        r"ConnectionError: cannot fetch targets/target-1.png from http://127.0.0.1:9/ "
        r"\(\w+\): go online, or set CLOTHLAB_DATA to the folder data/ of a clone",
        unfetched,
    )


def test_the_address_is_the_repositorys(installed, tmp_path):
    code = "from clothlab import _store; print(_store.address())"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = run(installed, tmp_path, code, CLOTHLAB_DATA_URL="").stdout.strip()
    repository = project["urls"]["Repository"]
    assert found == f"{repository}/raw/v{clothlab.__version__}/data/"


@pytest.fixture(scope="module")
def server():
    """The address of a server that has the repository's data."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(ROOT / "data"))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


def test_trained_weights_come_from_an_address_that_one_line_sets(
    installed, tmp_path, server
):
    code = "from clothlab import load; print(load('torque-0').autoencoder_name)"
    done = run(installed, tmp_path, code, CLOTHLAB_DATA_URL=server)
    assert done.stdout == "torque\n", done.stderr
    cache = tmp_path / "cache" / "clothlab" / clothlab.__version__
    fetched = {path.name for path in cache.rglob("*") if path.is_file()}
    assert fetched == {"dpmpb-torque-0.safetensors", "autoencoder-torque.safetensors"}
    again = run(installed, tmp_path, code)  # offline now
    assert again.stdout == "torque\n", again.stderr


def test_the_command_line_fetches_a_part(installed, tmp_path, server):
    code = "import sys; from clothlab.__main__ import main; sys.exit(main())"
    code = f"import sys; sys.argv = ['clothlab', 'fetch', 'targets/drawn']; {code}"
    done = run(installed, tmp_path, code, CLOTHLAB_DATA_URL=server)
    drawn = len(list((ROOT / "data" / "targets" / "drawn").glob("*.png")))
    assert done.stdout.startswith(f"{drawn} files are in "), done.stderr
    assert run(installed, tmp_path, code, ROOT / "data").stdout.startswith("nothing to")
    wrong = run(installed, tmp_path, code.replace("targets/drawn", "target"))
    assert wrong.returncode == 1
    assert "nothing to fetch in 'target': name a part such as weights" in wrong.stderr


def test_the_doctor_runs_without_the_clone(installed, tmp_path):
    code = "import sys; sys.argv = ['clothlab', 'doctor']; from clothlab.__main__ import main; sys.exit(main())"
    done = run(installed, tmp_path, code)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "left to fetch" in done.stdout
