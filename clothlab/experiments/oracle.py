"""Search for commands where nothing has to be learned: cross-entropy search over plans, and on the true simulator.

What the simulator itself allows is the yardstick of every controller. A robot could not do this: it has no second
world in which to try 220 plans before it sends one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import Checked, check_array, setting
from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.policies import Policy
from clothlab.simulation.arm import Arm
from clothlab.simulation.env import ClothEnv, Observation
from clothlab.simulation.vision import check_mask

Cost = Callable[[np.ndarray], np.ndarray]  # plans [N, T, D_u] → cost of each [N]


@dataclass(frozen=True)
class SearchSettings(Checked):
    """How many plans are tried, and where."""

    starts: int = setting(60, at_least=1)  # plans that are tried first
    remembered: int = setting(8, at_least=0)  # of these: the best of the search before; the others are recorded ones
    rounds: int = setting(4, at_least=0)
    tries: int = setting(40, at_least=1)  # plans drawn in each round
    elite: int = setting(8, at_least=1)  # the best so far, around which a round draws
    first_width: float = setting(0.1, "range of the command", above=0)  # least standard deviation of the first round
    least_width: float = setting(0.02, "range of the command", above=0)  # and of the others

    @property
    def total(self) -> int:
        """Number of plans tried."""
        return self.starts + self.rounds * self.tries


def cross_entropy(
    cost: Cost,
    starts: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: SearchSettings | None = None,
    *,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw plans around the best ones so far, again and again, and keep the best.

    The first round draws around the single best start, since starts that are good in different ways have a mean that is
    good in none. A command whose range is a point stays there.

    Args:
        cost: of each plan, called once with the starts and once a round.
        starts: plans to begin with `[N, T, D_u]`; what is out of range is clipped.
        lower: smallest command `[D_u]`.
        upper: largest command `[D_u]`.
        settings: rounds, tries, widths; how many starts there are, the starts say.
        rng: random numbers.

    Returns:
        The best plans found, best first `[elite, T, D_u]` (fewer where fewer were tried); and the lowest cost after the
        starts and after each round `[rounds + 1]`, which never rises.

    Raises:
        ValueError: no starts, or starts of another shape or not finite.
    """
    settings = settings or SearchSettings()
    lower = check_array("lower", lower, ("D_u",))
    upper = check_array("upper", upper, lower.shape)
    plans = np.clip(check_array("starts", starts, ("N", "T", len(lower))), lower, upper)
    if not len(plans):
        raise ValueError("a search needs starts: one plan at the least")
    costs, trace = cost(plans), []
    for left in reversed(range(settings.rounds + 1)):
        best = np.argsort(costs, kind="stable")[: settings.elite]
        plans, costs = plans[best], costs[best]
        trace.append(costs[0])
        if left:
            first = left == settings.rounds
            centre = plans[0] if first else plans.mean(axis=0)
            width = (settings.first_width if first else settings.least_width) * (upper - lower)
            spread = np.maximum(plans.std(axis=0), width)
            drawn = np.clip(rng.normal(centre, spread, (settings.tries, *centre.shape)), lower, upper)
            plans, costs = np.concatenate([plans, drawn]), np.concatenate([costs, cost(drawn)])
    return plans, np.array(trace)


def copy_state(env: ClothEnv, copy: ClothEnv) -> None:
    """Put `copy` where `env` is, bit for bit; `env` is only read.

    Raises:
        ValueError: two scenes with different arms or cloths.
    """
    if (copy.arm, copy.cloth, copy.scene) != (env.arm, env.cloth, env.scene):
        raise ValueError("a state fits only a scene with the same arm, cloth and time step")
    mujoco.mj_copyData(copy.data, copy.model, env.data)


class SimulatorSearch(Policy):
    """Knows the simulator: tries plans in a copy of the scene, and sends the one that ends nearest to the target.

    What it sees plays no part: it reads the scene's true state, at the beginning of each period, and leaves it as it
    is. A plan is judged by its last step alone, since each picture takes as long as four steps of physics.

    Args:
        env: the scene that is controlled.
        autoencoder: by whose z distances are measured.
        target: mask `[H, W]` of the cloth to realise.
        plans: recorded stretches `[N, period, D_u]`, such as `recorded_plans`. Each search starts from the best plans
            of the one before, and for the rest from these, drawn at random.
        settings: how much is tried.
        arm: one with other limits, such as `env.arm.with_stiffness(10)`.

    Raises:
        ValueError: a target of another size or without a cloth; plans of another shape, or none.

    Attributes:
        trace: lowest distance ‖z_ref - z‖₂ at the period's end, after the starts and after each round, for each search
            since the reset: a list of `[rounds + 1]` [s.d. of z].
    """

    name = "simulator search"

    def __init__(
        self,
        env: ClothEnv,
        autoencoder: Autoencoder,
        target: ArrayLike,
        plans: ArrayLike,
        settings: SearchSettings | None = None,
        *,
        arm: Arm | None = None,
    ):
        self.env, self.autoencoder, self.arm = env, autoencoder, arm or env.arm
        self.settings = settings or SearchSettings()
        self.plans = check_array("plans", plans, ("N", "T", len(self.arm.command_names)))
        if not self.plans.size:
            raise ValueError("the search starts from recorded plans: one at the least, of one step at the least")
        self._copy = ClothEnv(env.arm, env.cloth, scene=env.scene)
        self.set_target(target)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last run; the same seed tries the same plans."""
        self.trace: list[np.ndarray] = []
        self._rng = np.random.default_rng(seed)
        self._elite = self.plans[:0]
        self._left: Iterator[np.ndarray] = iter(())

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next search on.

        Raises:
            ValueError: another shape, or no cloth in it.
        """
        self.z_ref = encode(self.autoencoder, check_mask(mask))

    def __call__(self, observation: Observation) -> np.ndarray:
        u = next(self._left, None)
        if u is None:
            self._left = iter(self.search())
            u = next(self._left)
        return u

    def search(self) -> np.ndarray:
        """Look for the plan `[period, D_u]` that brings the scene as it is now nearest to the target."""
        if self._copy.cloth != self.env.cloth:
            self._copy.hold(self.env.cloth)
        remembered = self._elite[: min(self.settings.remembered, self.settings.starts)]
        drawn = min(self.settings.starts - len(remembered), len(self.plans))
        starts = np.concatenate([remembered, self._rng.choice(self.plans, drawn, replace=False)])
        lower, upper = self.arm.command_lower, self.arm.command_upper
        self._elite, trace = cross_entropy(self.distances, starts, lower, upper, self.settings, rng=self._rng)
        self.trace.append(trace)
        return self._elite[0].copy()

    def distances(self, plans: np.ndarray) -> np.ndarray:
        """Distance ‖z_ref - z‖₂ to the target after each of the plans `[N, T, D_u]` is sent from here, `[N]`."""
        images = []
        for plan in plans:
            copy_state(self.env, self._copy)
            for u in plan:
                self._copy.advance(u)
            images.append(self._copy.observe()["image"])
        return np.linalg.norm(encode(self.autoencoder, np.stack(images)) - self.z_ref, axis=1)

    def close(self) -> None:
        """Release the copy's OpenGL context."""
        self._copy.close()
