"""The drone's study in a world that is known: a drone of four lines, without files."""

import hashlib
import json
import lzma

import numpy as np
import pandas as pd
import pytest
import torch

import studies
from clothlab.method.data import Run
from clothlab.method.model import DPMPB, Memory
from studies import _drone_models as models, drone, neural_fly
from studies._rival_models import Kind, TrainedKind
from studies.neural_fly import CHANGING, STEP, WINDS, Flight, stated_wind

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


def fly(controller, condition):
    """A figure of eight whose tilt holds against the wind, at random around that."""
    rng = np.random.default_rng([ord(controller[0]), len(condition)])
    time = STEP * np.arange(STEPS)
    wind = stated_wind(condition, time)
    s = np.zeros(8)
    states, commands = [], []
    for w in wind:
        hold = [-DRAG * (w - s[0]) / 9.81 - 0.1 * s[0], -0.1 * s[1]]
        upwards = 1.03 - 0.1 * s[2] / 9.81
        u = np.array([upwards, *hold]) + rng.normal(0, [0.1, 0.05, 0.05])
        states.append(s)
        commands.append(u)
        s = after(s, u, np.array([w]))
        s[5:] = rng.normal(size=3)
    return Flight(time, wind, Run(np.array(states), np.array(commands), condition))


class Windy(DPMPB):
    """The same drone as a model: its p is the wind over ten."""

    def __init__(self):
        super().__init__(8, 3, 1)

    def forward(self, s, u, p, memory=None):
        wind = 10 * p.expand(len(s), 1)[:, None, :]
        following = after(s, u, wind, torch.sqrt, torch.cat)
        return following, Memory(torch.zeros(2, 1, 30), torch.zeros(2, 1, 30))


def learned(kind, recordings, seed, updates=0):
    biases = {name: np.array([WINDS[name] / 10]) for name in recordings.winds}
    return TrainedKind(Windy().eval().requires_grad_(False), biases, Kind(bias_size=1))


@pytest.fixture
def world(monkeypatch):
    kept = {}

    def load_flight(*which):
        if which not in kept:
            kept[which] = fly(*which)
        return kept[which]

    for module in (models, drone):
        monkeypatch.setattr(module, "load_flight", load_flight)
    monkeypatch.setattr(models, "train", learned)
    drone._mean_tilts.cache_clear()
    drone._hover_model.cache_clear()
    yield load_flight
    drone._mean_tilts.cache_clear()
    drone._hover_model.cache_clear()


@pytest.mark.slow
def test_a_wind_that_can_be_known_is_found_and_where_it_lies_is_said(world):
    row = drone._estimate("NF", "70wind", 0)
    assert row["nearest"] == "70wind"
    assert row["p"] == pytest.approx([0.85], abs=0.01)
    assert row["seconds"] < 5
    assert row["path"].shape == (50, 1)
    assert row["nearest_by_tilt"] == "70wind"
    unseen = drone._unseen("NF", "35wind", 0)
    assert unseen["place_by_speed"] == pytest.approx(4.2 / 8.5)
    assert unseen["place"] == pytest.approx(4.2 / 8.5, abs=0.01)
    assert unseen["biases"].shape == (3, 1)


@pytest.mark.slow
def test_a_changing_wind_is_followed_and_a_constant_one_is_not(world):
    changing = drone._changing("NF", CHANGING, 20, 0)
    constant = drone._changing("NF", "70wind", 20, 0)
    assert changing["r"] > 0.95
    assert changing["r_by_kernel"] > 0.9
    assert len(changing["wind_by_kernel"]) == len(changing["wind"])
    assert 0.3 <= changing["delay"] <= 1.5  # half of the window is 1 s
    assert abs(constant["r_at_once"]) < 0.4


def test_an_order_is_that_of_a_way_or_a_round_in_either_direction():
    line = np.array([[0, 0], [1, 0], [2, 0.1], [3, 0]])
    for points in (line, line[::-1]):
        assert drone.visiting_order(points) == (0, 1, 2, 3)
        assert drone.order_along_first_axis(points) == (0, 1, 2, 3)
    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
    assert drone.visiting_order(square, closed=True) == (0, 1, 2, 3)
    assert drone.visiting_order(square[[0, 2, 1, 3]], closed=True) == (0, 2, 1, 3)
    assert drone.visiting_order(line[[1, 0, 2, 3]]) == (1, 0, 2, 3)
    bent = np.array([[0, 0], [3, 0], [6, 0.5], [1, 0.5]])
    assert drone.order_along_first_axis(bent) == (0, 3, 1, 2)


def test_a_place_is_a_foot_and_beside_it_a_distance():
    lower, upper = np.array([1.0, 0.0]), np.array([1.0, 2.0])
    p = np.array([2.0, 0.5])
    assert drone.place_between(p, lower, upper) == pytest.approx(0.25)
    assert drone.beside(p, lower, upper) == pytest.approx(0.5)


def test_a_line_with_a_corner_holds_readings_back_and_a_kernel_does_not():
    corner = [[0, 0], [1, 0], [2, 1], [1, 2]]
    biases = dict(zip(WINDS, np.array(corner, dtype=float), strict=True))
    outside = np.array([[2.2, 1.02], [2.2, 0.98], [2.3, 1.1]])
    assert drone.wind_read_from(outside, biases) == pytest.approx(8.5)
    assert np.ptp(drone.wind_by_kernel(outside, biases)) > 0.1
    line = {name: np.array([speed, 0.0]) for name, speed in WINDS.items()}
    read = drone.wind_by_kernel(np.array([[-99.0, 0], [6.0, 0], [99.0, 0]]), line)
    assert read == pytest.approx([0, 6.3, 12.1], abs=1)
    assert (np.diff(read) > 0).all()


def test_a_sine_is_followed_with_any_phase():
    time = np.arange(0, 20 * np.pi, 0.1)
    both = np.sin(time), np.cos(time)
    assert drone.at_any_phase(np.sin(time - 2), *both) == pytest.approx(1)
    noise = np.random.default_rng(0).normal(size=len(time))
    assert drone.at_any_phase(noise, *both) < 0.2


def test_a_prediction_is_as_good_as_what_is_held(world):
    found = {}
    for method in (drone.ESTIMATED, drone.RIGHT, drone.FARTHEST, drone.DRAG):
        row = drone._predict(method, "NF", "100wind", 0)
        assert row["velocity"].shape == (len(drone.HISTORY), len(drone.HORIZONS))
        found[method] = row["velocity"][0]
    assert found[drone.RIGHT] == pytest.approx(np.zeros(6), abs=1e-4)
    assert found[drone.ESTIMATED][3] < 0.02
    # 12.1 m/s of wind too little, for 1 s
    lost = 12.1 * DRAG
    assert found[drone.FARTHEST][0] == pytest.approx(lost * STEP, rel=0.01)
    assert found[drone.DRAG][3] < 0.1 < found[drone.FARTHEST][3]


def test_a_memory_is_kept_over_a_pause_or_empty(world, monkeypatch):
    torch.manual_seed(0)
    model = DPMPB(8, 3, 0).eval().requires_grad_(False)
    trained = TrainedKind(model, {}, Kind())
    monkeypatch.setattr(models, "train", lambda *which: trained)
    for name, value in {"_STARTS": [250], "PAUSED": [250], "_SECOND": 1}.items():
        monkeypatch.setattr(drone, name, value)
    run = world("NF", "70wind").run
    found = {}
    for method, begin in {drone.KEPT: 0, drone.LONG_MEMORY: 250}.items():
        s, u = (torch.as_tensor(each[None, begin:251]) for each in (run.s, run.u))
        last = model(s, u, torch.zeros(0))[0][0, -1, :3].numpy()
        found[method] = np.linalg.norm(last - run.s[251, :3])
        row = drone._predict(method, "NF", "70wind", 0)
        assert row["velocity"][0, 0] == pytest.approx(found[method], abs=2e-5)
        row = drone._after_pause(method, "NF", "70wind", 0)
        assert row["error"] == pytest.approx([found[method]], abs=1e-3)
    assert abs(found[drone.KEPT] - found[drone.LONG_MEMORY]) > 1e-4


def test_a_velocity_that_stays_is_wrong_by_what_it_changes(world):
    run = world("NF", "70wind").run
    change = run.s[251:471:5, :3] - run.s[250:470:5, :3]
    row = drone._predict(drone.STAYS, "NF", "70wind", 0)
    expected = np.sqrt((change**2).sum(1).mean())
    assert row["velocity"][:, 0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
def test_harder_cases_have_fewer_flights_or_states_without_tilt(world, monkeypatch):
    seen = []

    def train(kind, recordings, seed, updates=0):
        seen.append(recordings)
        size = recordings.runs()[0].s.shape[1]
        model = DPMPB(size, 3, 0).eval().requires_grad_(False)
        return TrainedKind(model, {}, Kind())

    monkeypatch.setattr(models, "train", train)
    for case in drone.HARDER:
        row = drone._predict_harder(case, drone.NO_P, "NF", "70wind", 0)
        assert row["velocity"].shape == (len(drone.HISTORY), len(drone.HORIZONS))
    assert [len(each.controllers) for each in seen] == [1, 2, 4]
    assert all("NF" not in each.controllers for each in seen)
    assert [each.runs()[0].s.shape[1] for each in seen] == [8, 8, 6]


def test_a_setting_is_judged_by_both_histories_and_all_winds():
    def velocity(value):
        errors = np.full((len(drone.HISTORY), len(drone.HORIZONS)), 9.0)
        errors[drone.HISTORY.index(20), 3] = value
        errors[drone.HISTORY.index(0), 3] = value + 0.2
        return errors

    rows = [
        {"method": "no p", "updates": updates, "ridge": None, "wind": wind}
        | {"velocity": velocity(error)}
        for updates, errors in {300: (0.1, 0.3), 600: (0.0, 0.2)}.items()
        for wind, error in zip(("nowind", "35wind"), errors, strict=True)
    ]
    found = drone.development_errors(pd.DataFrame(rows)).set_index("updates")
    assert found["error"].to_dict() == pytest.approx({300: 0.3, 600: 0.2})


def test_what_is_in_use_served_best_in_the_development():
    """A changed setting asks for another look at `drone_development`."""
    lost = drone.lost_by_choice(studies.load("drone_development"))
    assert set(lost.index) >= {drone.ESTIMATED, drone.NO_P, drone.LAST_LAYER}
    assert lost[lost > drone.CLOSE].empty


def test_wrong_names_are_other_winds_for_each_controller():
    straight = models.Recordings(("NF", "indi", "L1", "NF-C"))
    asked = []

    def load_flight(controller, wind):
        asked.append(wind)
        return Flight(np.zeros(1), np.zeros(1), Run(np.zeros((1, 8)), [[0]], wind))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(models, "load_flight", load_flight)
        right = [run.material for run in straight.runs()]
        wrong = [run.material for run in models.replace(straight, shuffled=True).runs()]
    assert right == asked[:16]
    pairs = set(zip(asked[:16], wrong, strict=True))
    assert len(pairs) == 16  # each name is that of each wind once


def test_the_hover_model_is_the_drone_that_made_the_flights(world):
    runs = [world("NF", wind).run for wind in WINDS]
    hover = models.HoverModel.of(runs).with_force(runs[2], drag=True)
    assert hover.approach == pytest.approx(APPROACH, rel=1e-3)
    assert hover.gain == pytest.approx(1, abs=0.02)
    assert hover.drag[0] == pytest.approx(DRAG, abs=0.05)
    constant = hover.with_force(runs[2])
    assert constant.force[0] == pytest.approx(DRAG * 8.5, rel=0.1)
    assert (constant.drag == 0).all()


def test_a_last_layer_is_fitted_and_a_dear_one_stays(world):
    torch.manual_seed(0)
    model = DPMPB(8, 3, 0)
    run = world("NF", "70wind").run
    model.s_mean.copy_(torch.as_tensor(run.s.mean(0)))
    model.s_std.copy_(torch.as_tensor(run.s.std(0)) + 0.1)
    s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)

    def loss(of):
        with torch.no_grad():
            return of.loss(of(s[None, :-1], u[None, :-1], torch.zeros(0))[0][0], s[1:])

    assert loss(models.with_last_layer(model, run, 1e-3)) < 0.9 * loss(model)
    stays = models.with_last_layer(model, run, 1e12)
    assert loss(stays) == pytest.approx(float(loss(model)), rel=1e-4)


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
    flight = neural_fly.load_flight("NF", "70wind")
    assert flight.time == pytest.approx([0, 0.1, 0.2])
    assert flight.run.s[0] == pytest.approx([1, 2, 3, 0.1, 0.2, 4, 5, 6])
    assert flight.run.u[0] == pytest.approx([1.2, 1, 0], abs=1e-6)
    assert flight.run.material == "70wind"
    assert (flight.wind == 8.5).all()


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
        f"custom_figure8_{controller}_{condition}.csv"
        for controller in neural_fly.CONTROLLERS
        for condition in (*WINDS, CHANGING)
    ]
    assert sorted(names) == sorted(expected)
