"""Somebody who touches everything for hours: a session stays finite, small and alone.

`CLOTHLAB_SOAK` says for how many simulated minutes; `make nightly` asks for 480.
Hostile values are given, too.
"""

import gc
import json
import os
import threading
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import psutil
import pytest

from clothlab.lab._drivers import DRIVERS
from clothlab.lab._messages import KNOWN_ERRORS
from clothlab.lab._session import LiveSession
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.trials import load_trial

# Simulated, of both arms together
MINUTES = float(os.environ.get("CLOTHLAB_SOAK", "0.3"))
GROWTH = 20.0  # [MiB] at most, of either arm
EVERY = 12  # [step] between operations, on average
WARM = 10  # [step] of each driver before memory is measured
# [step]; it needs more memory the more it knows
WARM_ITERATIVE = 40 if MINUTES < 10 else 300
SPOILED = (np.nan, np.inf, -1e30, 1e39, None, "x", [])


class Player:
    """Touches the controls of a session at random, now and then with what they cannot
    take.
    """

    def __init__(self, session: LiveSession, rng: np.random.Generator):
        self.session, self.rng = session, rng
        self.refused: Counter[str] = Counter()
        self.done: Counter[str] = Counter()
        low, high = session.arm.command_lower - 0.05, session.arm.command_upper + 0.05
        self.operations = {
            "driver": lambda: session.set_driver(self.spoiled(self.one_of(DRIVERS))),
            "explore": lambda: setattr(session, "exploring", not session.exploring),
            "estimate": lambda: setattr(session, "estimating", not session.estimating),
            "target": lambda: session.set_target(
                self.spoiled(session.gallery[self.one_of(session.gallery)])
            ),
            "drawn target": lambda: session.set_target(self.box()),
            "cloth": lambda: session.set_cloth(
                self.spoiled(self.one_of(session.trained.biases))
            ),
            "material": lambda: session.set_material(
                self.spoiled(rng.uniform(0, 0.2)), self.spoiled(rng.uniform(0, 0.3))
            ),
            "p": lambda: session.set_p(self.spoiled(rng.normal(0, 3, session.p.shape))),
            "hand": lambda: session.set_hand(self.spoiled(rng.uniform(low, high))),
            "tension": lambda: session.set_tension(
                self.spoiled(rng.choice([None, rng.uniform(0, 80)]))
            ),
            "reset": session.reset,
            "picture": session.env.picture,
            "record": session.record,
            "save": self.save,
            "discard": session.recorder.discard,
        }

    def warm_up(self) -> None:
        """Do everything once, so that what is loaded at its first use is there."""
        self.session.estimating = True
        for driver in DRIVERS:
            self.session.set_driver(driver)
            for _ in range(WARM_ITERATIVE if driver == "iterative" else WARM):
                self.session.step()
        for name in self.operations:
            self.touch(name)

    def touch(self, name: str) -> None:
        """One operation; a refusal in a sentence is an answer too."""
        try:
            self.operations[name]()
        except KNOWN_ERRORS as error:
            self.refused[name if len(str(error)) > 10 else "without a sentence"] += 1
        else:
            self.done[name] += 1

    def one_of(self, names: Iterable[str]) -> str:
        return str(self.rng.choice(list(names)))

    def spoiled(self, value: object) -> object:
        return (
            SPOILED[self.rng.integers(len(SPOILED))]
            if self.rng.random() < 0.15
            else value
        )

    def box(self) -> np.ndarray:
        mask = np.zeros((96, 128), bool)
        x, y, w, h = self.rng.integers((0, 0, 0, 0), (100, 70, 60, 60))
        mask[y : y + h, x : x + w] = True
        return mask

    def save(self) -> None:
        path = self.session.recorder.save(
            self.spoiled(f"run-{self.rng.integers(1000)}")
        )
        assert np.isfinite(load_trial(path).robot).all()
        path.unlink()


def play(arm: str, steps: int, folder: Path, seed: int) -> dict[str, object]:
    """Play on one arm; what happened."""
    rng = np.random.default_rng(seed)
    session = LiveSession(arm, recordings=folder, picture_size=(96, 128))
    player, seconds, memory = Player(session, rng), [], []
    player.warm_up()
    for k in range(steps):
        if rng.random() < 1 / EVERY:
            player.touch(player.one_of(player.operations))
        # Of this thread alone: what others do meanwhile is not its fault
        start = time.thread_time()
        moment = session.step()
        seconds.append(time.thread_time() - start)
        for value in (
            moment.reconstruction,
            moment.distance,
            moment.command,
            moment.theta,
            moment.p,
        ):
            assert np.isfinite(value).all(), moment
        if k % min(300, steps // 10) == 0:
            gc.collect()
            memory.append(psutil.Process().memory_info().rss / 2**20)
    # The camera's, and the picture's of another size
    assert len(session.env._renderers) <= 2
    session.close()
    assert not session.env._renderers
    assert memory[-1] - memory[0] < GROWTH
    assert not player.refused["without a sentence"]
    if steps > 2000:
        assert set(player.operations) == set(player.done)
    return {
        "steps": steps,
        "operations": sum(player.done.values()),
        "refused": sum(player.refused.values()),
        "step [ms]": round(1e3 * float(np.median(seconds)), 1),
        "slowest step [ms]": round(1e3 * max(seconds)),
        "late": int((np.array(seconds) > CONTROL_PERIOD).sum()),
        "growth [MiB]": round(memory[-1] - memory[0], 1),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "arm", ["torque", pytest.param("muscle", marks=pytest.mark.nightly)]
)
def test_a_session_can_be_played_with_for_hours(arm, tmp_path):
    threads, steps = threading.active_count(), round(MINUTES * 60 / CONTROL_PERIOD / 2)
    print(f"{arm}: {json.dumps(play(arm, steps, tmp_path, seed=arm == 'muscle'))}")
    # Tqdm's monitor, if anybody shows progress
    assert threading.active_count() <= threads + 1
