"""Hours of a live session with somebody who touches everything: it stays quick, finite, small and alone.

`CLOTHLAB_SOAK` says for how many simulated minutes; `make nightly` asks for 480. Hostile values are given, too.
"""

import gc
import json
import os
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil
import pytest

from clothlab.lab.drivers import DRIVERS
from clothlab.lab.messages import KNOWN_ERRORS
from clothlab.lab.session import LiveSession, StepInfo
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.trials import load_trial

MINUTES = float(os.environ.get("CLOTHLAB_SOAK", "10"))  # simulated, of both arms together
GROWTH = 20.0  # [MiB] at most, of either arm
EVERY = 12  # [step] between operations, on average
WARM = (20, 300)  # [step] of each driver before memory is measured, and of practice, which needs more the more it knows
SPOILED = (np.nan, np.inf, -1e30, 1e39, None, "x", [])


class Player:
    """Touches the controls of a session at random, now and then with what they cannot take."""

    def __init__(self, session: LiveSession, rng: np.random.Generator, folder: Path):
        self.session, self.rng, self.folder = session, rng, folder
        self.refused: Counter[str] = Counter()
        self.done: Counter[str] = Counter()
        self.operations = [name for name in vars(type(self)) if name.startswith("do_")]

    def warm_up(self) -> None:
        """Everything once, so that what is loaded when it is first used is there, and what is reserved is reserved."""
        self.session.estimating = True  # its window fills: the more it reaches back, the more memory a step takes
        for driver in DRIVERS:
            self.session.set_driver(driver)
            for _ in range(WARM[driver == "iterative"]):
                self.session.step()
        for name in self.operations:
            self.touch(name)

    def touch(self, name: str = "") -> None:
        """One operation; a refusal in a sentence is an answer too."""
        name = name or str(self.rng.choice(self.operations))
        try:
            getattr(self, name)()
        except KNOWN_ERRORS as error:
            self.refused[name if len(str(error)) > 10 else "without a word"] += 1
        else:
            self.done[name] += 1

    def or_spoiled(self, value: object) -> object:
        return SPOILED[self.rng.integers(len(SPOILED))] if self.rng.random() < 0.15 else value

    def do_driver(self) -> None:
        self.session.set_driver(self.or_spoiled(str(self.rng.choice(DRIVERS))))

    def do_practising(self) -> None:
        self.session.exploring = not self.session.exploring

    def do_estimating(self) -> None:
        self.session.estimating = not self.session.estimating

    def do_target(self) -> None:
        names = list(self.session.gallery)
        self.session.set_target(self.or_spoiled(self.session.gallery[names[self.rng.integers(len(names))]]))

    def do_drawn_target(self) -> None:
        mask = np.zeros((96, 128), bool)
        x, y, w, h = self.rng.integers((0, 0, 0, 0), (100, 70, 60, 60))
        mask[y : y + h, x : x + w] = True
        self.session.set_target(mask)

    def do_cloth(self) -> None:
        self.session.set_cloth(self.or_spoiled(str(self.rng.choice(list(self.session.trained.biases)))))

    def do_material(self) -> None:
        damping, mass = self.rng.uniform((0.0, 0.0), (0.2, 0.3))
        self.session.set_material(self.or_spoiled(float(damping)), self.or_spoiled(float(mass)))

    def do_p(self) -> None:
        self.session.set_p(self.or_spoiled(self.rng.normal(0, 3, self.session.p.shape)))

    def do_hand(self) -> None:
        arm = self.session.arm
        self.session.set_hand(self.or_spoiled(self.rng.uniform(arm.command_lower - 0.05, arm.command_upper + 0.05)))

    def do_tension(self) -> None:
        self.session.set_tension(self.or_spoiled(None if self.rng.random() < 0.4 else float(self.rng.uniform(0, 80))))

    def do_reset(self) -> None:
        self.session.reset()

    def do_picture(self) -> None:
        assert self.session.picture().dtype == np.uint8

    def do_record(self) -> None:
        self.session.record()

    def do_save(self) -> None:
        path = self.session.recorder.save(self.or_spoiled(f"run-{self.rng.integers(1000)}"))
        trial = load_trial(path)
        assert np.isfinite(trial.robot).all()
        path.unlink()

    def do_discard(self) -> None:
        self.session.recorder.discard()


def finite(moment: StepInfo) -> bool:
    """Whether all that a step says is a number."""
    values = [moment.reconstruction, moment.distance, moment.command, moment.theta, moment.p, moment.seconds]
    return all(np.isfinite(value).all() for value in values) and moment.predicted is not False


def contexts(session: LiveSession) -> int:
    return len(session.env._renderers)


def measured() -> float:
    gc.collect()
    return psutil.Process().memory_info().rss / 2**20


def play(arm: str, steps: int, folder: Path, seed: int) -> dict[str, object]:
    """Play on one arm; what happened."""
    rng = np.random.default_rng(seed)
    session = LiveSession(arm, recordings=folder, picture_size=(96, 128))
    player, seconds, memory = Player(session, rng, folder), [], []
    player.warm_up()
    for k in range(steps):
        if rng.random() < 1 / EVERY:
            player.touch()
        start = time.thread_time()  # of this thread alone: what others do meanwhile is not its fault
        moment = session.step()
        seconds.append(time.thread_time() - start)
        assert finite(moment), moment
        if k % min(300, steps // 10) == 0:
            memory.append(measured())
    assert contexts(session) <= 2  # the camera's, and the picture's of another size
    session.close()
    assert not contexts(session)
    assert not player.refused["without a word"]
    return {
        "steps": steps,
        "operations": sum(player.done.values()),
        "refused": sum(player.refused.values()),
        "step [ms]": round(1e3 * float(np.median(seconds)), 1),
        "slowest step [ms]": round(1e3 * max(seconds)),
        "late": int((np.array(seconds) > CONTROL_PERIOD).sum()),
        "memory": memory,
        "untouched": sorted(set(player.operations) - set(player.done)),
    }


@pytest.mark.slow
def test_a_session_can_be_played_with_for_hours(tmp_path):
    threads, start = threading.active_count(), time.perf_counter()
    arms, steps = ("torque", "muscle"), round(MINUTES * 60 / CONTROL_PERIOD / 2)
    found = {arm: play(arm, steps, tmp_path / arm, seed) for seed, arm in enumerate(arms)}
    for arm, each in found.items():
        memory = np.array(each.pop("memory"))
        each["growth [MiB]"] = round(float(memory[-1] - memory[0]), 1)
        print(f"{arm}: {json.dumps(each)}")
    print(f"{MINUTES:g} simulated minutes in {time.perf_counter() - start:.0f} s")
    for each in found.values():
        assert each["growth [MiB]"] < GROWTH
        assert not each["late"]
        if each["steps"] > 2000:
            assert not each["untouched"]
    assert threading.active_count() <= threads + 1  # tqdm's monitor, if anybody shows progress
