"""The drone's study in a world that is known: a drone of four lines, without files."""

import hashlib
import json
import lzma

import numpy as np
import pandas as pd
import pytest
import torch

from clothlab.method.data import Run
from clothlab.method.model import DPMPB, Memory
from studies import drone, neural_fly
from studies.neural_fly import STEP, WINDS

APPROACH, DRAG = 0.4, 0.3  # a step, 1/s
STEPS = 503


def after(s, u, wind, sqrt=np.sqrt, join=np.concatenate):
    """The state after a command `[..., 8]`, in such a wind `[..., 1]` along x."""
    tilt = s[..., 3:5] + APPROACH * (u[..., 1:] - s[..., 3:5])
    between = (s[..., 3:5] + tilt) / 2
    upwards = sqrt(1 - (between**2).sum(-1))[..., None]
    push = 9.81 * u[..., :1] * join([between, upwards], -1)
    push = push - join([0 * upwards, 0 * upwards, 9.81 + 0 * upwards], -1)
    still = join([-wind + 0 * upwards, 0 * upwards, 0 * upwards], -1)
    speed = s[..., :3] + STEP * (push - DRAG * (s[..., :3] + still))
    return join([speed, tilt, 0 * s[..., 5:]], -1)


def fly(controller, wind):
    """A figure of eight whose tilt holds against the wind, at random around that."""
    rng = np.random.default_rng([ord(controller[0]), len(wind)])
    w = WINDS[wind]
    s = np.zeros(8)
    states, commands = [], []
    for _ in range(STEPS):
        hold = [-DRAG * (w - s[0]) / 9.81 - 0.1 * s[0], -0.1 * s[1]]
        upwards = 1.03 - 0.1 * s[2] / 9.81
        u = np.array([upwards, *hold]) + rng.normal(0, [0.1, 0.05, 0.05])
        states.append(s)
        commands.append(u)
        s = after(s, u, np.array([w]))
        s[5:] = rng.normal(size=3)
    return Run(np.array(states), np.array(commands), wind)


class Windy(DPMPB):
    """The same drone as a model: its p is the wind over ten."""

    def __init__(self):
        super().__init__(8, 3, 1)

    def forward(self, s, u, p, memory=None):
        wind = 10 * p.expand(len(s), 1)[:, None, :]
        following = after(s, u, wind, torch.sqrt, torch.cat)
        return following, Memory(torch.zeros(2, 1, 30), torch.zeros(2, 1, 30))


def learned(recordings, seed):
    biases = {name: np.array([speed / 10]) for name, speed in WINDS.items()}
    return drone.Trained(Windy().eval().requires_grad_(False), biases)


@pytest.fixture
def world(monkeypatch):
    kept = {}

    def load_flight(*which):
        if which not in kept:
            kept[which] = fly(*which)
        return kept[which]

    monkeypatch.setattr(drone, "load_flight", load_flight)
    monkeypatch.setattr(drone, "train", learned)
    drone._mean_tilts.cache_clear()
    yield load_flight
    drone._mean_tilts.cache_clear()


@pytest.mark.slow
def test_a_wind_that_can_be_known_is_found(world):
    row = drone._estimate("NF", "70wind", 0)
    assert row["nearest"] == "70wind"
    assert row["p"] == pytest.approx([0.85], abs=0.01)
    assert row["seconds"] < 5
    assert row["path"].shape == (50, 1)
    assert row["nearest_by_tilt"] == "70wind"


def test_an_order_is_that_of_a_way_or_a_round_in_either_direction():
    line = np.array([[0, 0], [1, 0], [2, 0.1], [3, 0]])
    for points in (line, line[::-1]):
        assert drone.visiting_order(points) == (0, 1, 2, 3)
    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
    assert drone.visiting_order(square, closed=True) == (0, 1, 2, 3)
    assert drone.visiting_order(square[[0, 2, 1, 3]], closed=True) == (0, 2, 1, 3)
    assert drone.visiting_order(line[[1, 0, 2, 3]]) == (1, 0, 2, 3)


def test_a_wind_is_read_off_the_line_through_trained_p():
    corner = [[0, 0], [1, 0], [2, 1], [1, 2]]
    biases = dict(zip(WINDS, np.array(corner, dtype=float), strict=True))
    on_the_line = np.array([[0.5, 0], [1.5, 0.5], [0.5, 2.5]])
    read = drone.wind_read_from(on_the_line, biases)
    assert read == pytest.approx([2.1, 6.35, 12.1 + 3.6 / 2])
    outside = np.array([[2.2, 1.02], [2.2, 0.98], [2.3, 1.1]])
    assert drone.wind_read_from(outside, biases) == pytest.approx(8.5)


def test_wrong_names_are_other_winds_for_each_controller():
    straight = drone.Recordings(("NF", "indi", "L1", "NF-C"))
    asked = []

    def load_flight(controller, wind):
        asked.append(wind)
        return Run(np.zeros((1, 8)), [[0]], wind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drone, "load_flight", load_flight)
        right = [run.material for run in straight.runs()]
        wrong = [run.material for run in drone.replace(straight, shuffled=True).runs()]
    assert right == asked[:16]
    pairs = set(zip(asked[:16], wrong, strict=True))
    assert len(pairs) == 16  # each name is that of each wind once


# The folder that a reader fetched


def as_recorded(rows=11):
    """The published columns that are read, as text."""
    table = pd.DataFrame({"t": 0.02 * np.arange(rows)})
    table["v"] = json.dumps([1.0, 2.0, 3.0])
    table["R"] = json.dumps([[1, 0, 0.1], [0, 1, 0.2], [0, 0, 0.97]])
    table["w"] = json.dumps([4.0, 5.0, 6.0])
    table["T_sp"] = json.dumps([0.6])
    table["hover_throttle"] = json.dumps([0.5])
    half = np.sqrt(0.5)  # a quarter turn about y: z becomes x
    table["q_sp"] = json.dumps([0.0, half, 0.0, half])
    return table.to_csv().encode()


@pytest.fixture
def fetched(monkeypatch, tmp_path):
    content = as_recorded()
    name = "custom_figure8_NF_70wind.csv"
    sums = tmp_path / "sums"
    sums.write_text(f"{hashlib.sha256(content).hexdigest()}  {name}\n")
    monkeypatch.setattr(neural_fly, "_SUMS", sums)
    monkeypatch.setenv(neural_fly.VARIABLE, str(tmp_path))
    neural_fly._load.cache_clear()
    yield tmp_path, name, content
    neural_fly._load.cache_clear()


@pytest.mark.parametrize("packed", [False, True])
def test_a_flight_is_read_plain_or_compressed(fetched, packed):
    root, name, content = fetched
    folder = root / "data" / "experiment"
    folder.mkdir(parents=True)
    if packed:
        (folder / f"{name}.xz").write_bytes(lzma.compress(content))
    else:
        (folder / name).write_bytes(content)
    run = neural_fly.load_flight("NF", "70wind")
    assert len(run) == 3
    assert run.s[0] == pytest.approx([1, 2, 3, 0.1, 0.2, 4, 5, 6])
    assert run.u[0] == pytest.approx([1.2, 1, 0], abs=1e-6)
    assert run.material == "70wind"


def test_what_lacks_or_was_changed_says_what_to_do(fetched, monkeypatch):
    root, name, content = fetched
    with pytest.raises(FileNotFoundError, match=r"no custom_figure8.*git clone"):
        neural_fly.load_flight("NF", "70wind")
    (root / name).write_bytes(content + b"\n")
    with pytest.raises(ValueError, match="not as published"):
        neural_fly.load_flight("NF", "70wind")
    with pytest.raises(KeyError, match="choose from baseline"):
        neural_fly.load_flight("NG", "70wind")
    monkeypatch.delenv(neural_fly.VARIABLE)
    assert not neural_fly.here()
    with pytest.raises(FileNotFoundError, match="not part of this repository"):
        neural_fly.load_flight("NF", "70wind")


def test_the_published_sums_are_of_every_flight():
    names = [line[66:] for line in neural_fly._SUMS.read_text().splitlines()]
    expected = [
        f"custom_figure8_{controller}_{wind}.csv"
        for controller in neural_fly.CONTROLLERS
        for wind in WINDS
    ]
    assert sorted(names) == sorted(expected)
