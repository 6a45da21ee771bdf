"""Small things that several tests share.

Nothing here reads `data/`, and what costs time is made once a session. `conftest.py`
loads them in a process that runs tests.
"""

import copy
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_limits

from clothlab.lab.recorder import Recorder
from clothlab.lab.session import LiveSession
from clothlab.method.model import DPMPB, Memory
from clothlab.policies import RandomPolicy
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, rollout
from studies.table_scene.table_env import TableEnv


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> Iterator[None]:
    """Tiny matrices run faster on one core, and two runs add up in the same order."""
    torch.set_num_threads(1)
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session")
def table_scene() -> Iterator[TableEnv]:
    """The scene in which a table is set; `start` comes first."""
    env = TableEnv()
    yield env
    env.close()


@pytest.fixture(scope="session")
def _torque_env() -> Iterator[ClothEnv]:
    env = ClothEnv("torque", "damp0.05-mass0.10")
    yield env
    env.close()


@pytest.fixture(scope="session")
def _muscle_env() -> Iterator[ClothEnv]:
    env = ClothEnv("muscle", "hard-1")
    yield env
    env.close()


@pytest.fixture
def env(_torque_env: ClothEnv) -> ClothEnv:
    """A torque arm at the start.

    A test that changes the cloth or closes it makes its own.
    """
    _torque_env.start()
    return _torque_env


@pytest.fixture
def muscle_env(_muscle_env: ClothEnv) -> ClothEnv:
    """A muscle arm at the start, for reading likewise."""
    _muscle_env.start()
    return _muscle_env


@pytest.fixture(scope="session")
def trial(_torque_env: ClothEnv) -> Trial:
    return rollout(_torque_env, RandomPolicy(_torque_env.arm), 12)


@pytest.fixture(scope="session")
def muscle_trial(_muscle_env: ClothEnv) -> Trial:
    return rollout(_muscle_env, RandomPolicy(_muscle_env.arm), 12)


@pytest.fixture
def model() -> DPMPB:
    """Random weights in double precision, so that finite differences are exact enough
    to compare with.
    """
    torch.manual_seed(0)
    model = DPMPB(state_size=7, command_size=2).double()
    model.s_mean.copy_(torch.linspace(-1, 1, 7))
    model.s_std.copy_(torch.linspace(0.5, 2, 7))
    model.u_std.fill_(0.6)
    return model.requires_grad_(False)


@pytest.fixture
def memory() -> Memory:
    generator = torch.Generator().manual_seed(1)
    h, c = (
        torch.randn(2, 1, 30, generator=generator, dtype=torch.float64) * 0.3
        for _ in range(2)
    )
    return Memory(h, c)


@pytest.fixture
def square() -> np.ndarray:
    """A mask with a square of cloth in it."""
    mask = np.zeros((96, 128), bool)
    mask[30:50, 40:70] = True
    return mask


@pytest.fixture
def full_disk() -> Callable[[], AbstractContextManager]:
    """While inside, no file can be written: the system itself refuses, as it does when
    a disk is full.
    """
    resource = pytest.importorskip(
        "resource", reason="Windows has no limit on the size of files"
    )

    @contextmanager
    def full() -> Iterator[None]:
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return full


class _Silent(SimpleHTTPRequestHandler):
    asked: list[str]  # paths, in order

    def __init__(self, asked, *arguments, **options):
        self.asked = asked
        super().__init__(*arguments, **options)

    def do_GET(self):
        self.asked.append(self.path.lstrip("/"))
        super().do_GET()

    def log_message(self, *arguments):
        pass


@contextmanager
def serving(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """A folder that is served: its address, and what is asked of it."""
    asked: list[str] = []
    handler = partial(_Silent, asked, directory=str(folder))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", asked
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(autouse=True)
def few_yardsticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A live session compares drawn targets with a tenth of its reference_images:
    making one takes half as long.
    """
    monkeypatch.setattr("clothlab.lab.targets.REFERENCE_EVERY", 200)


@pytest.fixture(scope="session")
def _equipped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveSession]:
    session = LiveSession(
        recordings=tmp_path_factory.mktemp("none"), picture_size=(96, 128)
    )
    yield session
    session.close()


@pytest.fixture
def new_session(_equipped: LiveSession, tmp_path: Path) -> Callable[[], LiveSession]:
    """Makes a session as at its start, with the weights and the scene of one that is
    made only once.
    """

    def make() -> LiveSession:
        session = copy.copy(_equipped)
        session.recorder = Recorder(tmp_path / "mine")
        session.env.hold("damp0.05-mass0.10")
        session.set_tension(None)
        session.reset()
        return session

    return make


def shaken(network: torch.nn.Module) -> torch.nn.Module:
    """Random numbers in all that is saved, buffers too, so that a forgotten one shows."""
    torch.manual_seed(1)
    with torch.no_grad():
        for tensor in network.state_dict().values():
            if tensor.is_floating_point():
                tensor += torch.rand(tensor.shape)
    return network.eval()
