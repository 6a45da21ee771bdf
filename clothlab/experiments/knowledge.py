"""What can be known of a cloth: the Cramér-Rao bound on log C_damp and log C_mass, from what the robot senses.

The same commands are sent to scenes whose cloths differ in one constant by a factor exp(±step), and the differences of
what is sensed are its sensitivities. The bound is that of an observer who knows the simulator, its arm and its camera,
all but the two constants, so no estimate is better; one that had to learn all this may be much worse.

The noise of z and of the mask is measured: each scene is run several times with a camera that is turned by parts of a
pixel, and with commands and a start that are disturbed by next to nothing. What scatters then, beyond what moves in
proportion to the camera's turn, is what a picture says by chance: the raster, and chaos if there is any. The
difference between z of an image and z of its reconstruction is no such noise, since z is a function of the image and
the image is what is sensed; the record has it for comparison. Joint states and torques are exact in the simulator, so
that their noise has to be stated.

Beside z there is z "as predicted": the noise is then what the network errs a step ahead, on recordings that it was not
trained on. That is the bound of an observer who knows no better than the network how a cloth moves. It is still kind to
the network, whose errors are not independent of the material.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, check_array, choose, setting
from clothlab.experiments._kept import piece
from clothlab.experiments._record import RECORDINGS, run_jobs, trained
from clothlab.experiments.estimation import BETWEEN, get_cloth
from clothlab.experiments.fisher import Noise, cramer_rao, log_det, principal_directions, unbiased_information
from clothlab.learning.autoencoder import Autoencoder, decode, encode
from clothlab.learning.control import recorded_plans
from clothlab.learning.estimation import EstimationSettings
from clothlab.policies import Noisy, OperatorPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import JOINTS, Camera, TorqueArm
from clothlab.simulation.cloth import CLOTHS, Cloth, cloth_name
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.simulation.vision import HEIGHT, WIDTH, check_masks
from clothlab.trials import rollout

FOLDER = Path("build") / "knowledge"  # where runs are kept, from the folder in which the experiment is run
MOTIONS = {"random": RandomPolicy, "operator": OperatorPolicy}
UNKNOWNS = ("damping", "mass")  # of a cloth; F is about their logarithms
SENSORS = ("z", "mask", "joints", "torques")
PREDICTED = "z as predicted"  # by the network
SENSOR_SETS = {
    "z": ("z",),
    "z + joints": ("z", "joints"),
    "z + joints + torques": ("z", "joints", "torques"),
    "mask": ("mask",),
    "mask + joints + torques": ("mask", "joints", "torques"),
    PREDICTED: (PREDICTED,),
}
QUANTITIES = {"C_damp": (1, 0), "C_mass": (0, 1), "C_damp / C_mass": (1, -1), "C_damp · C_mass": (1, 1)}
STRONG = 1000.0  # times the usual arm's masses, servos and damping: it moves alike, and no cloth moves it
LEAST = 1e-5  # share of the best direction's information below which a measured one counts as none
NOISES = ("angle_noise", "velocity_noise", "torque_noise")
MEASURED_WITH = ("weights", "model", "recordings", "steps", "times", "repeats", *NOISES)


@dataclass(frozen=True)
class Variant:
    """What is different in a scene.

    Attributes:
        springs_scale: whether springs and dashpots grow with C_mass, so that of a free point's equation of motion
            m a = -c v + springs + m g, divided by m, nothing but c/m is left.
        strong: whether the arm is so strong that the cloth's weight does not bend it.
    """

    springs_scale: bool = False
    strong: bool = False


VARIANTS = {
    "as it is": Variant(),
    "springs scaled": Variant(springs_scale=True),
    "springs scaled, strong arm": Variant(springs_scale=True, strong=True),
}
USUAL = "as it is"


@dataclass(frozen=True)
class Settings(Checked):
    """Which cloths and motions, how they are measured, and what the sensors are like; the defaults are the full size.

    The robot's sensors: angles as of an encoder of 12 bits, whose rounding has a standard deviation of 2π/4096/√12;
    velocities as of a difference of angles, filtered; torques as of a motor's current, about 1 % of the largest.
    """

    weights: str = setting("torque")  # autoencoder, and with the number of a training the network that errs
    model: int = setting(0, at_least=0)  # of the trainings
    recordings: str = setting("evaluation")  # on which its errors are measured
    cloths: tuple[str, ...] = setting((*CLOTHS, *BETWEEN))
    motions: tuple[str, ...] = setting(tuple(MOTIONS))
    seeds: tuple[int, ...] = setting((7000, 7001, 7002), at_least=0)  # of the commands
    steps: int = setting(200, "step", at_least=5)  # 40 s
    times: tuple[float, ...] = setting((1, 2, 3, 5, 7, 10, 14, 20, 28, 40), "s", at_least=CONTROL_PERIOD)
    step: float = setting(0.05, "log C", above=0, at_most=1)  # half the difference of the logarithms
    repeats: int = setting(4, at_least=4)  # of each scene, with other disturbances: a mean and two slopes are fitted
    disturbance: float = setting(1e-6, "rad", at_least=0)  # of start and commands, to see whether chaos makes it grow
    angle_noise: float = setting(5e-4, "rad", above=0)
    velocity_noise: float = setting(0.02, "rad/s", above=0)
    torque_noise: float = setting(0.1, "N m", above=0)
    control_cloth: str = setting(cloth_name(0.05, 0.10))  # with which the controls, steps and plans are tried
    controls: tuple[str, ...] = setting(tuple(VARIANTS)[1:])
    other_steps: tuple[float, ...] = setting((0.01, 0.02, 0.1, 0.2), "log C", above=0, at_most=1)
    other_disturbances: tuple[float, ...] = setting((1e-4, 1e-3), "rad", at_least=0)  # as a real servo's
    plans: int = setting(20, at_least=0)  # recorded stretches that are ranked by what they tell
    plan_steps: int = setting(50, "step", at_least=5)

    def __post_init__(self) -> None:
        """Refuse times at which nothing has been sensed."""
        super().__post_init__()
        if max(self.times) > self.steps * CONTROL_PERIOD + 1e-9:
            raise ValueError(f"Settings.times end with the run, after {self.steps * CONTROL_PERIOD:g} s")


@dataclass(frozen=True)
class Case:
    """One motion of one cloth.

    Attributes:
        cloth: its name.
        motion: which of `MOTIONS`.
        seed: of the commands.
        step: half the difference of the logarithms.
        disturbance: of start and commands [rad].
        variant: which of `VARIANTS`.
    """

    cloth: str
    motion: str
    seed: int
    step: float
    disturbance: float
    variant: str = USUAL


@dataclass(frozen=True, eq=False)
class Known:
    """What a motion tells.

    Attributes:
        information: F of (log C_damp, log C_mass) in each sensor by itself, and in z as predicted, up to each time
            `{sensor: [N, 2, 2]}`.
        noise: standard deviation of each channel `{sensor: [D]}`, in its unit.
        correlation: ρ, of the noise with that a step later, `{sensor: ρ}`.
        chaos: how far repeats of a run are from each other, root mean square over points and steps [m].
        reconstruction: root mean square of z(image) - z(its reconstruction) `[D_z]`, for comparison.
    """

    information: dict[str, np.ndarray]
    noise: dict[str, np.ndarray]
    correlation: dict[str, float]
    chaos: float
    reconstruction: np.ndarray

    def total(self, sensors: str) -> np.ndarray:
        """F in several sensors together `[N, 2, 2]`; their noises are independent, so that it is a sum.

        Raises:
            KeyError: no such set; the message lists the choices.
        """
        return np.sum([self.information[each] for each in choose("set of sensors", sensors, SENSOR_SETS)], axis=0)

    def bound(self, sensors: str) -> dict[str, np.ndarray]:
        """Least standard deviation of the logarithm of each of `QUANTITIES`, `{quantity: [N]}`; infinite: unknown."""
        bounds = cramer_rao(self.total(sensors), list(QUANTITIES.values()), tolerance=LEAST)
        return dict(zip(QUANTITIES, bounds.T, strict=True))

    def directions(self, sensors: str) -> tuple[np.ndarray, np.ndarray]:
        """Which combinations show in the end, best first: information along them `[2]`, and they, one a row `[2, 2]`.

        A row (a, b) stands for log C_damp^a C_mass^b.
        """
        return principal_directions(self.total(sensors)[-1])


@dataclass(frozen=True, eq=False)
class Run:
    """A case, and what it tells.

    Attributes:
        case: which.
        known: what it tells.
    """

    case: Case
    known: Known


@dataclass(frozen=True, eq=False)
class Plan:
    """A recorded stretch of commands, begun with the cloth at rest.

    Attributes:
        commands: `[T, D_u]`.
        known: what it tells, in the end.
    """

    commands: np.ndarray
    known: Known


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each case.
        plans: recorded stretches.
    """

    settings: Settings
    runs: tuple[Run, ...]
    plans: tuple[Plan, ...]

    def cases(
        self,
        motion: str | None = None,
        cloth: str | None = None,
        *,
        step: float | None = None,
        disturbance: float | None = None,
        variant: str = USUAL,
    ) -> list[Run]:
        """The runs of a motion and a cloth, or of all; with the usual step and disturbance where none is named."""
        usual = self.settings
        asked = {
            "step": usual.step if step is None else step,
            "disturbance": usual.disturbance if disturbance is None else disturbance,
            "variant": variant,
        }
        asked |= {"motion": motion} if motion else {}
        asked |= {"cloth": cloth} if cloth else {}
        return [run for run in self.runs if asked.items() <= asdict(run.case).items()]

    def median(self, sensors: str, motion: str | None = None) -> dict[str, np.ndarray]:
        """Median over the runs of the bound of each of `QUANTITIES`, `{quantity: [N]}`."""
        bounds = [run.known.bound(sensors) for run in self.cases(motion)]
        return {quantity: np.median([each[quantity] for each in bounds], axis=0) for quantity in QUANTITIES}

    def order(self, sensors: str) -> np.ndarray:
        """The plans by what they tell, most first: their numbers `[plans]`."""
        return _by_information([plan.known for plan in self.plans], sensors)[0]


def vary(cloth: Cloth, unknown: str, step: float, *, springs_scale: bool = False) -> Cloth:
    """The cloth with one constant multiplied by exp(step).

    Args:
        cloth: the cloth.
        unknown: `damping` or `mass`.
        step: difference of its logarithm.
        springs_scale: whether springs and their dashpots grow with the mass.

    Raises:
        KeyError: another unknown; the message lists the choices.
    """
    choose("unknown", unknown, dict.fromkeys(UNKNOWNS))
    names = {unknown}
    if springs_scale and unknown == "mass":
        names |= {"stiffness", "bending", "spring_damping"}
    return replace(cloth, **{name: getattr(cloth, name) * np.exp(step) for name in names})


def turned(camera: Camera, across: float, up: float) -> Camera:
    """The camera turned by parts of a pixel of its image."""
    distance = np.linalg.norm(np.subtract(camera.target, camera.position))
    pixel = 2 * distance * np.tan(np.deg2rad(camera.fovy) / 2) / HEIGHT  # [m] at the target
    return replace(camera, target=tuple(camera.target + pixel * np.array([across, up]) @ camera.axes[:2]))


def strong_arm() -> TorqueArm:
    """An arm that moves as the usual one, and that no cloth bends."""
    arm = TorqueArm()

    def strengthen(pair: tuple[float, float]) -> tuple[float, float]:
        return STRONG * pair[0], STRONG * pair[1]

    return replace(
        arm,
        link_masses=strengthen(arm.link_masses),
        hinge_damping=STRONG * arm.hinge_damping,
        servo_stiffness=strengthen(arm.servo_stiffness),
        servo_damping=strengthen(arm.servo_damping),
    )


def mask_moments(images: ArrayLike, order: int = 3) -> np.ndarray:
    """Coarse summary of masks: means of x^i y^j over the image, where there is cloth, for i + j up to the order.

    Args:
        images: masks `[T, H, W]`; x and y go from -1 to 1 across them.
        order: largest i + j.

    Returns:
        `[T, D]`, 10 moments up to the third order; zero for an empty mask.
    """
    y, x = np.meshgrid(np.linspace(-1, 1, HEIGHT), np.linspace(-1, 1, WIDTH), indexing="ij")
    powers = [x**i * y**j for i, j in product(range(order + 1), repeat=2) if i + j <= order]
    return np.tensordot(check_masks(images), np.stack(powers), axes=((1, 2), (1, 2))) / (HEIGHT * WIDTH)


def commands_of(motion: str, seed: int, steps: int) -> np.ndarray:
    """The commands of a motion `[steps, D_u]`, which nothing seen has a part in.

    Raises:
        KeyError: unknown motion; the message lists the choices.
    """
    policy = choose("motion", motion, MOTIONS)(TorqueArm())
    policy.reset(seed)
    return np.array([policy({}) for _ in range(steps)])


def _sense(env: ClothEnv, commands: np.ndarray, disturbance: float, seed: int) -> tuple[np.ndarray, ...]:
    """What is sensed after each command: images, joint states, torques [N m]; and where the points are [m]."""
    rows = []

    def watch() -> None:
        rows.append(([env.data.actuator(joint).force[0] for joint in JOINTS], env.cloth_points()[1:].ravel()))

    replayed = ReplayPolicy(
        [*commands, commands[-1]]
    )  # the first look is before the first command: one more at the end
    policy = Noisy(replayed, env.arm, disturbance)
    trial = rollout(env, policy, len(commands) + 1, seed=seed, watch=watch, samples=1)
    torques, points = (np.array(column)[:-1] for column in zip(*rows, strict=True))
    return trial.images[1:], trial.robot[1:], torques, points


@dataclass(frozen=True, eq=False)
class _Sensed:
    """What R repeats of 2 × 2 scenes sensed: each unknown made smaller and larger.

    Attributes:
        channels: `{sensor: [2, 2, R, T, D]}`, unknown and sign first.
        points: where the cloth is `[2, 2, R, T, points]` [m].
        turns: of the camera in each repeat `[R, 2]` [pixel].
        images: of one run `[T, H, W]`.
    """

    channels: dict[str, np.ndarray]
    points: np.ndarray
    turns: np.ndarray
    images: np.ndarray


def _sense_all(
    settings: Settings, autoencoder: Autoencoder, cloth: Cloth, commands: np.ndarray, variant: Variant
) -> _Sensed:
    scenes = [
        vary(cloth, unknown, sign * settings.step, springs_scale=variant.springs_scale)
        for unknown, sign in product(UNKNOWNS, (-1, 1))
    ]
    arm, found, turns, images = strong_arm() if variant.strong else TorqueArm(), [], [], []
    for repeat in range(settings.repeats):
        rng = np.random.default_rng(repeat)
        turns.append(rng.uniform(-0.5, 0.5, 2))
        home = tuple(arm.home + rng.normal(0, settings.disturbance, len(arm.home)))
        env = ClothEnv(replace(arm, camera=turned(arm.camera, *turns[-1]), home=home), cloth)
        for scene in scenes:
            env.hold(scene)
            seen, robot, torques, points = _sense(env, commands, settings.disturbance, repeat)
            images.append(seen)
            found.append((encode(autoencoder, seen), mask_moments(seen), robot, torques, points))
        env.close()
    # [R, 2, 2, T, D] → [2, 2, R, T, D]
    shape = (settings.repeats, len(UNKNOWNS), 2)
    arrays = [np.array(each, np.float64) for each in zip(*found, strict=True)]
    arrays = [np.moveaxis(each.reshape(*shape, *each.shape[1:]), 0, 2) for each in arrays]
    return _Sensed(dict(zip(SENSORS, arrays[:-1], strict=True)), arrays[-1], np.array(turns), images[0])


def left_over(repeats: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """What scatters over the repeats of scenes, beyond what goes in proportion to the camera's turn.

    A camera that stands a little otherwise moves all of its images alike, and that could be calibrated.

    Args:
        repeats: what was sensed `[S, R, T, D]`.
        turns: of the camera in each repeat `[R, 2]`.

    Returns:
        Residuals `[S R, T, D]`, enlarged for what the means and the slopes have fitted away.
    """
    fitted = np.column_stack([np.ones(len(turns)), turns])
    residuals = np.tensordot(np.eye(len(turns)) - fitted @ np.linalg.pinv(fitted), repeats, axes=(1, 1)).swapaxes(0, 1)
    left = len(turns) - np.linalg.matrix_rank(fitted)
    return np.sqrt(len(turns) / left) * residuals.reshape(-1, *repeats.shape[2:])


@cache
def prediction_noise(name: str, recordings: str) -> Noise:
    """How far a network's z, a step ahead and with the right p, is from the z that comes.

    Args:
        name: of its weights.
        recordings: set of trials, with cloths that it was trained on.
    """
    learned, errors = trained(name), []
    for trial in artifacts.load_trials(recordings):
        run, p = learned.sequences(trial), torch.as_tensor(learned.biases[trial.cloth.name])
        s, u = torch.as_tensor(run.s), torch.as_tensor(run.u)
        with torch.no_grad():
            predicted, _ = learned.model(s[None, :-1], u[None, :-1], p[None])
        errors.append((predicted[0] - s[1:])[EstimationSettings.warmup :, learned.layout.z].numpy())
    shortest = min(map(len, errors))
    return Noise.measured([each[:shortest] for each in errors])


def _noise_and_slopes(settings: Settings, sensed: _Sensed) -> tuple[dict[str, Noise], dict[str, np.ndarray]]:
    """Noise of each sensor, and its sensitivities in each repeat `[R, T, D, P]`."""
    stated = {
        "joints": [settings.angle_noise] * 2 + [settings.velocity_noise] * 2,
        "torques": [settings.torque_noise] * 2,
    }
    noises, slopes = {}, {}
    for sensor, values in sensed.channels.items():
        noises[sensor] = Noise.measured(
            left_over(values.reshape(-1, *values.shape[2:]), sensed.turns), stated.get(sensor)
        )
        slopes[sensor] = np.moveaxis(values[:, 1] - values[:, 0], 0, -1) / (2 * settings.step)  # [R, T, D, P]
    return noises, slopes


def measure(
    settings: Settings,
    autoencoder: Autoencoder,
    cloth: Cloth,
    commands: ArrayLike,
    times: tuple[float, ...],
    *,
    variant: str = USUAL,
    predicting: Noise | None = None,
) -> Known:
    """What a motion tells of a cloth.

    Args:
        settings: sensors, repeats, step, disturbance.
        autoencoder: by which the robot sees.
        cloth: around which the constants are varied.
        commands: of the motion, from rest at the arm's home `[T, D_u]`.
        times: at which F is wanted [s].
        variant: which of `VARIANTS`.
        predicting: noise of z as predicted; that of z as seen when left out.

    Raises:
        KeyError: unknown variant; the message lists the choices.
        ValueError: commands that the arm refuses, or times after the last of them.
    """
    commands, kind = check_array("commands", commands, ("T", len(JOINTS))), choose("variant", variant, VARIANTS)
    index = np.round(np.array(times) / CONTROL_PERIOD).astype(int) - 1
    if not len(index) or index.min() < 0 or index.max() >= len(commands):
        raise ValueError(f"times are within the motion's {len(commands) * CONTROL_PERIOD:g} s, got {times}")
    sensed = _sense_all(settings, autoencoder, cloth, commands, kind)
    noises, slopes = _noise_and_slopes(settings, sensed)
    noises[PREDICTED], slopes[PREDICTED] = predicting or noises["z"], slopes["z"]
    information = {
        sensor: unbiased_information(slopes[sensor], noise)[index].round(3) for sensor, noise in noises.items()
    }
    apart = sensed.points - sensed.points.mean(axis=2, keepdims=True)
    again = encode(autoencoder, decode(autoencoder, encode(autoencoder, sensed.images)) > 0.5)
    off = again - encode(autoencoder, sensed.images)
    return Known(
        information=information,
        noise={sensor: noise.deviations for sensor, noise in noises.items()},
        correlation={sensor: noise.correlation for sensor, noise in noises.items()},
        chaos=float(np.sqrt(3 * (apart**2).mean())),
        reconstruction=np.sqrt((off**2).mean(axis=0)).astype(np.float64),
    )


def cases(settings: Settings) -> list[Case]:
    """All that is measured: every motion of every cloth; with one cloth, controls, other steps, other disturbances."""
    how = settings.step, settings.disturbance
    usual = [Case(*each, *how) for each in product(settings.cloths, settings.motions, settings.seeds)]
    for motion in settings.motions:
        first = Case(settings.control_cloth, motion, settings.seeds[0], *how)
        usual += [replace(first, variant=variant) for variant in settings.controls]
        usual += [replace(first, step=step) for step in settings.other_steps]
        usual += [replace(first, disturbance=disturbance) for disturbance in settings.other_disturbances]
    return usual


def _network(settings: Settings) -> tuple[Autoencoder, Noise]:
    name = f"{settings.weights}-{settings.model}"
    return trained(name).autoencoder, prediction_noise(name, settings.recordings)


def run_case(settings: Settings, case: Case) -> Known:
    """What one motion of one cloth tells."""
    autoencoder, predicting = _network(settings)
    commands = commands_of(case.motion, case.seed, settings.steps)
    settings = replace(settings, step=case.step, disturbance=case.disturbance)
    cloth, times = get_cloth(case.cloth), settings.times
    return measure(settings, autoencoder, cloth, commands, times, variant=case.variant, predicting=predicting)


def run_plan(settings: Settings, commands: np.ndarray) -> Known:
    """What one recorded stretch tells of the control cloth."""
    autoencoder, predicting = _network(settings)
    times = (len(commands) * CONTROL_PERIOD,)
    return measure(settings, autoencoder, get_cloth(settings.control_cloth), commands, times, predicting=predicting)


def _by_information(known: list[Known], sensors: str) -> tuple[np.ndarray, np.ndarray]:
    """Which tells most, first; and log det F of each in the end."""
    size = np.array([log_det(each.total(sensors)[-1]) for each in known], dtype=np.float64)
    return np.argsort(-size, kind="stable"), size


def most_informative(
    plans: ArrayLike, sensors: str = "z + joints", settings: Settings | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Rank motions by log det of their information of the control cloth (D-optimal), each begun with the cloth at rest.

    Args:
        plans: recorded stretches of commands `[N, T, D_u]`, such as `control.recorded_plans` has them.
        sensors: one of `SENSOR_SETS`.
        settings: sensors, cloth, step, repeats.

    Returns:
        Numbers of the plans, that which tells most first `[N]`, and log det F of each `[N]`; minus infinity where not
        both constants can be told.

    Raises:
        KeyError: unknown sensors; the message lists the choices.
        ValueError: plans of another shape, or commands that the arm refuses.
    """
    settings, plans = settings or Settings(), check_array("plans", plans, ("N", "T", len(JOINTS)))
    choose("set of sensors", sensors, SENSOR_SETS)
    return _by_information([run_plan(settings, plan) for plan in plans], sensors)


def _kept(folder: Path, settings: Settings, about: dict, how: dict, measured: Callable[[], Known]) -> Known:
    made_with = about | how | {each: getattr(settings, each) for each in MEASURED_WITH}
    return piece(about.values(), made_with, measured, Known, folder)


def _case_kept(folder: Path, settings: Settings, case: Case) -> Known:
    return _kept(folder, settings, asdict(case), {}, lambda: run_case(settings, case))


def _plan_kept(folder: Path, settings: Settings, number: int, commands: np.ndarray) -> Known:
    how = {"commands": commands.tolist(), "cloth": settings.control_cloth}
    how |= {"step": settings.step, "disturbance": settings.disturbance}
    return _kept(folder, settings, {"what": "plan", "number": number}, how, lambda: run_plan(settings, commands))


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """Every case, and the recorded plans.

    Args:
        settings: what is run.
        workers: processes.
        progress: show a progress bar.
        folder: where each case is kept as soon as it is done; an interrupted experiment goes on from there.
    """
    settings, folder = settings or Settings(), Path(folder)
    todo = cases(settings)
    jobs = [(folder, settings, case) for case in todo]
    known = run_jobs(_case_kept, jobs, workers=workers, progress=progress, what="knowledge")
    runs = tuple(Run(case, each) for case, each in zip(todo, known, strict=True))
    if not settings.plans:
        return Record(settings, runs, ())
    trials = artifacts.load_trials(RECORDINGS["torque"])
    plans = recorded_plans(trials, settings.plan_steps, settings.plans)
    ranked = [(folder, settings, number, plan) for number, plan in enumerate(plans)]
    known = run_jobs(_plan_kept, ranked, workers=workers, progress=progress, what="plans")
    return Record(settings, runs, tuple(Plan(plan, each) for plan, each in zip(plans, known, strict=True)))
