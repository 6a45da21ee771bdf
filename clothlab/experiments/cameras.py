"""The camera is knocked out of its place: what becomes of p, z and control, and how much of it registration mends.

A camera is moved by some centimetres along its own axes or turned by some degrees about them, one at a time, and both
at once in directions drawn at random. Everything is judged from the old place: the same run is simulated again with
the camera there. For the mending see `clothlab.experiments.recalibration`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, choose_all, setting
from clothlab.analysis import best_per_period, bias_error, nearest_material, target_distance
from clothlab.experiments._kept import piece
from clothlab.experiments._record import Reached, converter, new_trial, run_jobs, sort_out, trained
from clothlab.experiments.practice import GRADIENT, METHODS, PRACTICE, aim
from clothlab.experiments.recalibration import Registered, Registration, RegistrationSettings, look, register
from clothlab.learning.autoencoder import encode, iou
from clothlab.learning.estimation import NewtonSettings, estimate_bias
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import Arm, Camera, get_arm
from clothlab.simulation.cloth import CLOTHS, cloth_name
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import HEIGHT
from clothlab.trials import Trial

FOLDER = Path("build/cameras")  # where each piece is kept as soon as it is done
UNMOVED, BOTH = "unmoved", "both"
SHIFTS, TURNS = ("right", "up", "backward"), ("pitch", "yaw", "roll")  # along and about the camera's own axes
MATTERS = ("weights", "steps", "first_seed", "target", "control_steps")  # others only say which pieces there are


@dataclass(frozen=True)
class Place:
    """Where the camera is.

    Attributes:
        name: of the direction, `"unmoved"`, or `"both"`.
        size: of the displacement [m] or [degree]; for `"both"`, the number of the draw.
        shift: to its right, upward and backward [m].
        turn: about these axes: pitch, yaw, roll [degree].
    """

    name: str
    size: float
    shift: tuple[float, float, float]
    turn: tuple[float, float, float]

    def camera(self, arm: Arm) -> Camera:
        """That of an arm, moved there."""
        return arm.camera if self.name == UNMOVED else arm.camera.moved(self.shift, self.turn)


@dataclass(frozen=True)
class Settings(Checked):
    """Which displacements, trainings and cloths; the defaults are the full size."""

    weights: str = setting("torque")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # trainings for the unmoved camera and for both
    control_models: tuple[int, ...] = setting((0, 1, 2), at_least=0)  # those of them that realise the target, too
    curve_models: tuple[int, ...] = setting((0,), at_least=0)  # trainings for displacements of one kind
    directions: tuple[str, ...] = setting((*SHIFTS, *TURNS))
    shifts: tuple[float, ...] = setting((0.01, 0.05, 0.2), "m", above=0)
    turns: tuple[float, ...] = setting((1.0, 3.0, 10.0), "degree", above=0, at_most=45)
    draws: int = setting(3, at_least=0)  # of random directions in which it is both shifted and turned
    both_shift: float = setting(0.05, "m", above=0)
    both_turn: float = setting(3.0, "degree", above=0, at_most=45)
    draw_seed: int = setting(53_000, at_least=0)
    cloths: tuple[str, ...] = setting(tuple(CLOTHS))
    steps: int = setting(200, "step", at_least=12)  # of random commands, while p is estimated from 0
    first_seed: int = setting(50_000, at_least=0)  # of them: this + 20 model + number of the cloth, for every place
    target: str = setting("target-2")
    held: tuple[str, ...] = setting((cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)))  # cloths to realise it with
    methods: tuple[str, ...] = setting((GRADIENT, PRACTICE))  # for the unmoved camera and for both
    curve_methods: tuple[str, ...] = setting((GRADIENT,))  # for displacements of one kind
    control_steps: int = setting(200, "step", at_least=16)  # 25 periods

    def __post_init__(self) -> None:
        """Refuse what would only be noticed hours later.

        Raises:
            KeyError: an unknown direction, cloth or method; the message lists the choices.
        """
        super().__post_init__()
        choose_all("direction", self.directions, dict.fromkeys((*SHIFTS, *TURNS)))
        choose_all("cloth", self.cloths, CLOTHS)
        choose_all("method", self.methods + self.curve_methods, METHODS)

    @property
    def places(self) -> list[Place]:
        """Where the camera is put, the old place first."""
        found = [Place(UNMOVED, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
        for name in self.directions:
            axes, sizes = (SHIFTS, self.shifts) if name in SHIFTS else (TURNS, self.turns)
            for size in sizes:
                way = tuple(size * (each == name) for each in axes)
                still = (0.0, 0.0, 0.0)
                found.append(Place(name, size, *((way, still) if axes is SHIFTS else (still, way))))
        for number in range(self.draws):
            rng = np.random.default_rng(self.draw_seed + number)
            ways = rng.normal(size=(2, 3))
            ways *= np.array([[self.both_shift], [self.both_turn]]) / np.linalg.norm(ways, axis=1, keepdims=True)
            found.append(Place(BOTH, float(number), *map(tuple, ways.tolist())))
        return found


@dataclass(frozen=True, eq=False)
class Found:
    """A registration.

    Attributes:
        place: name of the direction.
        size: of the displacement [m] or [degree].
        views: in so many pictures the bar was found.
        residual: of its ends, root mean square [pixel].
        shift_error: of the position [m].
        turn_error: of the direction of sight and of what is up, as one turn [degree].
    """

    place: str
    size: float
    views: int
    residual: float
    shift_error: float
    turn_error: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """One estimation of p from 0.

    Attributes:
        place: name of the direction.
        size: of the displacement [m] or [degree].
        mended: whether images were warped to the old place.
        model: seed of the training.
        cloth: name of the cloth in the hand.
        nearest: the material whose trained p is nearest in the end.
        distance: final distance to the right p [spreads of the trained p].
        z_error: distance of z to that of the old place's image, mean over steps [s.d. of z].
        overlap: IoU of these two images, mean over the steps at which there is cloth in either.
    """

    place: str
    size: float
    mended: bool
    model: int
    cloth: str
    nearest: str
    distance: float
    z_error: float
    overlap: float


@dataclass(frozen=True, eq=False)
class Control(Reached):
    """One run towards the target.

    Attributes:
        place: name of the direction.
        size: of the displacement [m] or [degree].
        mended: whether images were warped to the old place.
        model: seed of the training.
        method: `"gradient"`, the paper's, or `"practice"`.
        cloth: name of the cloth in the hand.
        best: smallest distance in each period but the first, seen from the old place [s.d. of z].
        believed: the same as the robot sees it.
    """

    place: str
    size: float
    mended: bool
    model: int
    method: str
    cloth: str
    best: np.ndarray
    believed: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        registrations: one for each place.
        estimates: one for each place, with and without mending, training and cloth.
        control: one for each place, with and without mending, training, method and cloth.
    """

    settings: Settings
    registrations: tuple[Found, ...]
    estimates: tuple[Estimate, ...]
    control: tuple[Control, ...]

    def _of(self, runs: tuple, place: str, mended: bool, size: float | None, models: tuple[int, ...] | None) -> list:
        found = [run for run in runs if (run.place, run.mended) == (place, mended) and size in (None, run.size)]
        return [run for run in found if models is None or run.model in models]

    def nearest_rate(self, place: str, mended: bool, size: float | None = None, models: Any = None) -> float:
        """How often p comes nearest to the right one, 0 to 1; of all sizes and trainings where none are named."""
        runs = self._of(self.estimates, place, mended, size, models)
        return float(np.mean([run.nearest == run.cloth for run in runs]))

    def distance(self, place: str, mended: bool, size: float | None = None, models: Any = None) -> float:
        """Distance of the estimate to the right p, median [spreads]; likewise."""
        return float(np.median([run.distance for run in self._of(self.estimates, place, mended, size, models)]))

    def z_error(self, place: str, mended: bool, size: float | None = None, models: Any = None) -> float:
        """Distance of z to that of the old place's image, mean [s.d. of z]; likewise."""
        return float(np.mean([run.z_error for run in self._of(self.estimates, place, mended, size, models)]))

    def last(self, method: str, place: str, mended: bool, size: float | None = None, models: Any = None) -> float:
        """Distance to the target in the last ten periods, mean [s.d. of z]; likewise."""
        runs = self._of(self.control, place, mended, size, models)
        return float(np.mean([run.last for run in runs if run.method == method]))

    def lost(self, method: str, mended: bool) -> np.ndarray:
        """How much farther from the target with a camera shifted and turned than unmoved, `[models, runs]` [s.d. of z].

        The same training, the same cloth; one run for each cloth and draw of directions.
        """
        runs = [run for run in self.control if run.method == method]
        here = {(run.model, run.cloth): run.last for run in runs if (run.place, run.mended) == (UNMOVED, False)}
        there = [run for run in runs if (run.place, run.mended) == (BOTH, mended)]
        differences = {k: [run.last - here[k, run.cloth] for run in there if run.model == k] for k, _ in here}
        return np.array([*differences.values()])

    def over_unmoved(self, place: str, mended: bool, size: float | None = None, models: Any = None) -> dict[str, float]:
        """Rate of nearest p, and distance to the target by each method, over the unmoved camera's, same trainings.

        The rate is not a number where the unmoved camera's is zero.
        """
        if models is None:
            models = self.settings.models if place == BOTH else self.settings.curve_models
        methods = self.settings.methods if place in (UNMOVED, BOTH) else self.settings.curve_methods
        here = self.nearest_rate(UNMOVED, False, None, models)
        found = {"nearest": self.nearest_rate(place, mended, size, models) / here if here else np.nan}
        for method in methods:
            there, here = (
                self.last(method, place, mended, size, models),
                self.last(method, UNMOVED, False, None, models),
            )
            found[method] = there / here
        return found


@cache
def registered(arm: str, place: Place) -> tuple[Registration, int]:
    """The registration at a place, and how many pictures it stands on; once in each process."""
    before = get_arm(arm)
    env = ClothEnv(replace(before, camera=place.camera(before)))
    try:
        views = look(env, how := RegistrationSettings())
    finally:
        env.close()
    return register(before, views, how), len(views)


def register_one(settings: Settings, place: Place) -> Found:
    """How well the camera's place is found."""
    arm = trained(f"{settings.weights}-{settings.models[0]}").arm
    found, views = registered(arm.name, place)
    right = place.camera(arm)
    off = float(np.linalg.norm(np.subtract(found.camera.position, right.position)))
    cosine = (np.trace(found.camera.axes @ right.axes.T) - 1) / 2
    turned = float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    return Found(place.name, place.size, views, found.residual * HEIGHT, off, turned)


def _seen_from(arm: Arm, trial: Trial) -> Trial:
    """The same run, seen by another camera."""
    return new_trial(ReplayPolicy(trial.commands), arm, trial.cloth, len(trial), trial.seed)


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    some = (a | b).any(axis=(1, 2))
    return float(iou(a[some], b[some]).mean())


@lru_cache(maxsize=2)  # from a moved place, and from the old one, with which it is compared
def _seen(arm: Arm, cloth: str, steps: int, seed: int) -> Trial:
    """A run with random commands, the same whatever is seen."""
    return new_trial(RandomPolicy(arm), arm, cloth, steps, seed)


def estimate_one(settings: Settings, place: Place, mended: bool, model: int, cloth: str) -> Estimate:
    """Estimate p of one cloth from what the moved camera sees."""
    learned = trained(f"{settings.weights}-{model}")
    there = replace(learned.arm, camera=place.camera(learned.arm))
    seed = settings.first_seed + 20 * model + list(CLOTHS).index(cloth)
    right, trial = (_seen(arm, cloth, settings.steps, seed) for arm in (learned.arm, there))
    if mended:
        trial = registered(learned.arm.name, place)[0].trial(trial)
    p, _ = estimate_bias(learned.model, learned.sequences(trial), settings=NewtonSettings())
    z, z_right = (encode(learned.autoencoder, each.images) for each in (trial, right))
    return Estimate(
        place=place.name,
        size=place.size,
        mended=mended,
        model=model,
        cloth=cloth,
        nearest=nearest_material(p, learned.biases),
        distance=bias_error(p, cloth, learned.biases),
        z_error=float(np.linalg.norm(z - z_right, axis=1).mean()),
        overlap=_overlap(trial.images, right.images),
    )


def control_one(settings: Settings, place: Place, mended: bool, model: int, method: str, cloth: str) -> Control:
    """Aim at the target, which was set from the old place, with what the moved camera sees."""
    learned, mask = trained(f"{settings.weights}-{model}"), artifacts.load_target(settings.target)
    there = replace(learned.arm, camera=place.camera(learned.arm))
    policy = aim(method, learned, settings.target, cloth)
    if mended:
        policy = Registered(policy, registered(learned.arm.name, place)[0])
    trial = new_trial(policy, there, cloth, settings.control_steps, model)
    right = trial if there == learned.arm else _seen_from(learned.arm, trial)
    if mended:
        trial = registered(learned.arm.name, place)[0].trial(trial)
    best, believed = (best_per_period(target_distance(learned.autoencoder, each, mask)) for each in (right, trial))
    return Control(place.name, place.size, mended, model, method, cloth, best.round(4), believed.round(4))


_KINDS: dict[str, tuple[Callable[..., Any], type]] = {
    "register": (register_one, Found),
    "estimate": (estimate_one, Estimate),
    "control": (control_one, Control),
}


def run_kept(folder: Path, settings: Settings, pieces: list[tuple]) -> list[Any]:
    """Some pieces of the work, or what they said before."""
    found = []
    for kind, place, *job in pieces:
        function, made = _KINDS[kind]
        made_with = {each: getattr(settings, each) for each in MATTERS} | {"place": converter.unstructure(place)}
        about = (kind, place.name, f"{place.size:g}", *job)
        found.append(piece(about, made_with, partial(function, settings, place, *job), made, folder))
    return found


def jobs(settings: Settings) -> list[list[tuple]]:
    """The pieces of the work, each its kind, the place, and what else it is about; together those with the same run."""
    found: list[list[tuple]] = [[("register", place)] for place in settings.places]
    for model in sorted({*settings.models, *settings.curve_models}):
        for_both, for_curve = model in settings.models, model in settings.curve_models
        tried = {UNMOVED: True, BOTH: for_both}
        places = [place for place in settings.places if tried.get(place.name, for_curve)]
        ways = list(product(places, (False, True), (model,)))
        found += [[("estimate", *way, cloth) for way in ways] for cloth in settings.cloths]
        for place, *rest in ways if model in settings.control_models else ():
            methods = settings.methods if place.name in tried else settings.curve_methods
            found += [[("control", place, *rest, *each)] for each in product(methods, settings.held)]
    return found


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Every place, with and without mending.

    Args:
        settings: what is run.
        workers: processes.
        progress: show a progress bar.
        folder: where each piece is kept as soon as it is done; an interrupted experiment goes on from there.
    """
    settings, folder = settings or Settings(), Path(folder)
    todo = [(folder, settings, pieces) for pieces in jobs(settings)]
    found = list(chain(*run_jobs(run_kept, todo, workers=workers, progress=progress, what="cameras")))
    return Record(settings, *sort_out(found, (made for _, made in _KINDS.values())))
