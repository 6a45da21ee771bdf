"""What to expect of four things to try in notebook 08, and of Exercise 3, by script.

A person presses buttons of the panel; here the same `LiveSession` is steered by a
function, several times, so that the answers of the notebook rest on more than one run.
"""

from contextlib import closing
from typing import Any

import numpy as np

from clothlab._validation import choose
from clothlab.lab import LiveSession
from clothlab.simulation.cloth import cloth_name
from studies._grid import Case, Experiment, grid
from studies._runs import HEAVY, LIGHT, MIDDLE

CORNERS = (LIGHT, cloth_name(0.03, 0.15), cloth_name(0.07, 0.05), HEAVY)
_WARM_UP = 30  # [step] that the operator swings before a target is taken from life
_SEEN = 100  # [pixel] of cloth at least, in such a target
_PERIODS = 5  # watched of the control
_ESTIMATED = 75  # [step] watched of an estimate: 15 s
_LEARNED = 15  # [period] of iterative learning
_AIMED = 5  # [period] watched of the control at each recorded image
_IMAGES = 7  # recorded, in the panel


class _Watched:
    """A session and what is kept of it; `pairs` are predicted and achieved [P, 2]."""

    def __init__(self, session: LiveSession, seed: int):
        self.session = session
        session.reset(seed)
        self.pairs: list[tuple[float, float]] = []
        self.best: list[float] = []  # of all images of each period [P]
        self._near = np.inf  # the best of the period so far
        self.p: list[np.ndarray] = []  # while it is estimated [T, D_p]

    def steps(self, count: int) -> np.ndarray:
        """Go on for so many steps; the last image."""
        for _ in range(count):
            moment = self.session.step()
            self._near = min(self._near, moment.distance)
            if moment.period is not None:
                self.pairs.append(moment.period)
                self.best.append(self._near)
            if moment.period is not None or moment.predicted is None:
                self._near = np.inf
            if self.session.estimating:
                self.p.append(moment.p)
        return moment.image

    def periods(self, count: int) -> None:
        """Go on until so many more periods have ended."""
        wanted = len(self.pairs) + count
        while len(self.pairs) < wanted:
            self.steps(1)


def _life(session: LiveSession, seed: int, cloth: str) -> _Watched:
    """1. A target from life: the operator swings, and the control has his image."""
    session.set_driver("operator")
    run = _Watched(session, seed)
    image = run.steps(_WARM_UP)
    while image.sum() < _SEEN:
        image = run.steps(1)
    session.set_target(image)
    session.set_driver("control")
    run.periods(_PERIODS)
    return run


def _wrong(session: LiveSession, seed: int, cloth: str) -> _Watched:
    """2. The p of another cloth, or the right one; then it is estimated."""
    run = _Watched(session, seed)
    run.periods(_PERIODS)
    session.set_p(session.trained.biases[cloth])
    run.periods(_PERIODS)
    session.estimating = True
    run.steps(_ESTIMATED)
    return run


def _other(session: LiveSession, seed: int, cloth: str) -> _Watched:
    """3. Another cloth, while p is estimated."""
    session.estimating = True
    session.set_cloth(cloth)
    run = _Watched(session, seed)
    run.steps(_ESTIMATED)
    return run


def _iterative(session: LiveSession, seed: int, cloth: str) -> _Watched:
    """5. The control, then iterative learning, with the right p of a cloth."""
    session.set_cloth(cloth)
    session.set_p(session.trained.biases[cloth])
    run = _Watched(session, seed)
    run.periods(_PERIODS)
    session.set_driver("iterative")
    run.periods(_LEARNED)
    return run


def _recorded(session: LiveSession, seed: int, cloth: str) -> _Watched:
    """Exercise 3. One of the recorded images below the target, by its number."""
    session.set_target(session.gallery[f"recorded {seed}"])
    run = _Watched(session, seed)
    run.periods(_AIMED)
    return run


_THINGS = {
    "life": _life,
    "p": _wrong,
    "cloth": _other,
    "iterative": _iterative,
    "recorded": _recorded,
}


def _try_one(thing: str, cloth: str, seed: int) -> dict[str, Any]:
    """One thing to try, from the panel as it opens: the middle cloth, Target-2.

    Args:
        thing: one of `_THINGS`.
        cloth: whose p is put in (p), or that is put into the hand (cloth, iterative).
        seed: of the operator and of the learning; or the number of the image
            (recorded).

    Returns: the distance of the `still` cloth and, of each period that ended, those
        `predicted`, `achieved` (its last image under control, its best under iterative)
        and of its `best` image `[P]` [s.d. of z]; `p` while it was estimated
        `[T, D_p]`.
    """
    play = choose("thing", thing, _THINGS)
    with closing(LiveSession("torque")) as session:
        run = play(session, seed, cloth)
        still = session.still_distance
    predicted, achieved = np.reshape(run.pairs, (-1, 2)).T
    return {
        "still": round(still, 4),
        "predicted": predicted.round(4),
        "achieved": achieved.round(4),
        "best": np.round(run.best, 4),
        "p": np.reshape(run.p, (-1, 2)).round(4),
    }


def _cases(seed: int = 0, targets: int = 8) -> list[Case]:
    """Some targets from life; the other things with the cloths at the corners."""
    cases = grid(thing="life", cloth=MIDDLE, seed=range(seed, seed + targets))
    cases += grid(thing=("p", "iterative"), cloth=(MIDDLE, *CORNERS), seed=seed)
    cases += grid(thing="cloth", cloth=CORNERS, seed=seed)
    return cases + grid(thing="recorded", cloth=MIDDLE, seed=range(1, _IMAGES + 1))


EXPERIMENTS = (Experiment("live_lab", _try_one, _cases, seconds=20),)
