"""A robot is moved 20 times a second, by estimator and controller in one thread.

The robot is a swing whose weight nobody tells, driven by a weak motor; its simulation
goes on with the clock, as a robot would. What a loop has to decide stands in `Loop`:

* A cycle that took too long is counted. In the next one the plan at hand goes on
  without a solve, which costs next to nothing, so that the loop catches up.
* After a gap the estimator forgets its window and keeps p: what lies before and after
  it is no step of the model.
* Where a sensor leaves the range of the training, or says nothing, the robot is sent
  to rest, and a warning names the sensor. p is not moved by such a state: outside, a
  few steps would drive it away.
* While too little was seen to judge p, the loop says so; and where an `alarm` is given,
  it says when a material is predicted worse than all that was trained on.

`python examples/loop_at_20_hz.py` trains for half a minute, drives for 20 seconds and
reports; `--stall 0.3` lets a cycle take so long once in 5 seconds, and `--rates` prints
how long a cycle's work takes on this machine.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from clothlab.method.checkpoint import Checkpoint
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run
from clothlab.method.deploy import Beat, Ranges, RangeWatch
from clothlab.method.gauss_newton import (
    Linearisation,
    NewtonEstimator,
    NewtonSettings,
    linearise,
)
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb

STEP = 0.05  # [s], 20 Hz
WEIGHTS = {"light": 0.5, "middle": 0.7, "heavy": 1.0}  # [kg]
TORQUE = 2.0  # largest [N m]
GOAL = 0.35  # angle [rad]
STATES = ("angle [rad]", "speed [rad/s]")
SETTINGS = ControlSettings(horizon=8, period=8)
TRAINING = ModelTraining(
    epochs=40, batch_size=50, sequence_length=20, bias_size=1, stride=2
)
WINDOW = NewtonSettings(window=60)  # steps, 3 s
# Marks around the table of `--rates` in `docs/your_own_robot.md`
BEGIN = (
    "<!-- python examples/loop_at_20_hz.py --rates --page docs/your_own_robot.md -->"
)
END = "<!-- end of rates -->"


# From how p predicts, and p [D_p]: is this like nothing that was trained on?
Alarm = Callable[[Linearisation, np.ndarray], bool]


class Swing:
    """A weight [kg] on a rod of half a metre, with a motor at its hinge."""

    def __init__(self, weight: float, clock: Callable[[], float]):
        self.weight = weight
        self._clock = clock
        self._now = clock()
        self.state = np.zeros(2)  # angle [rad], speed [rad/s]
        self._torque = 0.0

    def read(self) -> tuple[np.ndarray, float]:
        """State `[2]` and its time [s]; the last command was held until now."""
        now = self._clock()
        while self._now < now:
            dt = min(0.005, now - self._now)
            angle, speed = self.state
            pull = self._torque - 9.81 * self.weight * 0.5 * np.sin(angle)
            speed += dt * (pull / (0.25 * self.weight) - 0.5 * speed)
            self.state = np.array([angle + dt * speed, speed])
            self._now += dt
        return self.state.copy(), now

    def send(self, u: np.ndarray) -> None:
        """Hold this torque `[1]` [N m] from now on."""
        self._torque = float(u[0])


class SimulatedClock:
    """A clock that goes on only when somebody sleeps, to record in no time."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let so many seconds pass."""
        self.now += seconds


def record(name: str, seed: int, steps: int = 1200) -> Run:
    """A run under torques that grow slowly in size, each held for one to six steps."""
    rng = np.random.default_rng(seed)
    clock = SimulatedClock()
    swing = Swing(WEIGHTS[name], clock)
    states = []
    commands = []

    # A small motion first, so that a wrong wire shows before it hurts.
    while len(states) < steps:
        size = TORQUE * min(1, 0.2 + len(states) / 300)
        u = rng.uniform(-size, size, 1)
        for _ in range(rng.integers(1, 7)):
            states.append(swing.read()[0])
            commands.append(u)
            swing.send(u)
            clock.sleep(STEP)

    # With names and step, which the model and its file take over.
    kept = slice(None, steps)
    return Run(
        np.array(states)[kept],
        np.array(commands)[kept],
        name,
        step=STEP,
        state_names=STATES,
        command_names=("torque [N m]",),
    )


def learn(training: ModelTraining = TRAINING, steps: int = 1200) -> Checkpoint:
    """Record all weights, train, and keep what a loop needs to know."""
    runs = [record(name, seed, steps) for seed, name in enumerate(WEIGHTS)]
    model, biases, trace = train_dpmpb(runs, training, progress=False)
    return Checkpoint(
        name="swing",
        model=model,
        biases=biases,
        losses=trace.losses,
        settings=training,
        step=STEP,
        state_names=STATES,
        command_names=("torque [N m]",),
        ranges=Ranges.of(runs),
        steps={run.material: len(run) for run in runs},
    )


def towards_goal(states: Tensor, commands: Tensor, t: int) -> Tensor:
    """Loss `[B]`: distance to the goal, with a price for speed."""
    distance = (states[..., 0] - GOAL).square()
    return (distance + 0.01 * states[..., 1].square()).sum(-1)


@dataclass
class Report:
    """What happened in a drive."""

    late: int = 0  # cycles that took longer than a period
    missed: int = 0  # cycles that did not take place
    gaps: int = 0  # in the sensor's times, after which the window was forgotten
    alarms: int = 0  # looks that found a material like none trained on
    rests: int = 0  # cycles in which the robot was out of range, and sent to rest
    work: list[float] = field(default_factory=list)  # of each cycle [s]
    states: list[np.ndarray] = field(default_factory=list)  # [2]
    biases: list[np.ndarray] = field(default_factory=list)  # p after each cycle [D_p]


class Loop:
    """Estimator, controller and robot in one thread, cycle after cycle.

    Args:
        robot: to read and to send to.
        learned: model, ranges and names.
        beat: says when a cycle begins.
        alarm: whether a material is like none trained on, from how its p predicts, such
            as `Calibration.out_of_distribution`; it is asked once a second.
        say: what is worth telling.
        clock: by which the work of a cycle is timed [s].
    """

    def __init__(
        self,
        robot: Swing,
        learned: Checkpoint,
        beat: Beat,
        *,
        alarm: Alarm | None = None,
        say: Callable[[str], None] = print,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.robot = robot
        self.beat = beat
        self.report = Report()
        self._alarm = alarm
        self._say = say
        self._clock = clock
        self._stamp: float | None = None  # of the last state [s]
        self._judged = False  # whether there was enough to judge p

        # From where the robot is, which need not be at rest.
        model = learned.model
        self.estimator = NewtonEstimator(model, settings=WINDOW, from_rest=False)
        self.controller = Controller(
            model, towards_goal, self.estimator.p, [-TORQUE], [TORQUE], SETTINGS
        )
        self.watch = RangeWatch(learned.ranges, learned.state_names)

    def cycle(self) -> None:
        """Wait for the beat, read, send, and only then estimate."""
        self.beat.wait()
        started = self._clock()
        late = self.beat.late > self.report.late
        s, stamp = self.robot.read()

        # A gap is no step of the model, and nothing is to be learned outside its
        # ranges. The sensor's own time tells a gap: reading may have taken long, too.
        gap = self._stamp is not None and abs(stamp - self._stamp - STEP) > STEP / 2
        unknown = bool(self.watch(s).any())
        if gap or unknown:
            self.estimator.forget()
        self._stamp = stamp

        # To rest, where the model knows nothing; from there control begins anew.
        if unknown:
            self.controller.resume()
            self.report.rests += 1
            u = np.zeros(1)
        else:
            u = self.controller.act(s, solve=not late)
        self.robot.send(u)

        # The estimate is for the next cycle, and the robot does not wait for it.
        p = self.estimator.p
        if not unknown:
            p = self.estimator.update(s, u, time=stamp)
            self.controller.set_bias(p)
        if len(self.report.work) % int(1 / STEP) == 0:
            self._look(p)
        self._note(s, p, gap, self._clock() - started)

    def _look(self, p: np.ndarray) -> None:
        """Whether what is handled is like anything that was trained on."""
        fit = linearise(self.estimator)
        if self._alarm is None or fit is None or not self._alarm(fit, p):
            return
        if not self.report.alarms:
            self._say("this is predicted worse than all that was trained on")
        self.report.alarms += 1

    def _note(self, s: np.ndarray, p: np.ndarray, gap: bool, work: float) -> None:
        """What happened, for the report; what changed is said."""
        if gap and not self.report.gaps:
            self._say("a gap: p stays, and its window begins anew")
        self.report.gaps += gap
        judged = self.estimator.window is not None
        if judged != self._judged:
            self._say("p moves" if judged else "too few steps to move p")
            self._judged = judged

        # Late, missed, and how it went.
        self.report.late = self.beat.late
        self.report.missed = self.beat.missed
        self.report.states.append(s)
        self.report.biases.append(p)
        self.report.work.append(work)


def rates(repeats: int = 100) -> str:
    """A table of how long the work of a cycle takes, by horizon and size of the state.

    Networks are not trained, since that does not change the time. Times are those of
    the processor: what else runs on the machine comes on top.
    """
    lines = [
        "| states | horizon | `act` median [ms] | 99 of 100 below [ms] |"
        " `update`, window 60 [ms] | 99 of 100 below [ms] |",
        "| --: | --: | --: | --: | --: | --: |",
    ]
    for states in (2, 17, 30):
        for horizon in (8, 12, 20):
            act, update = _timed(states, horizon, repeats)
            cells = [f"{1e3 * each:.1f}" for each in (*act, *update)]
            lines.append(f"| {states} | {horizon} | {' | '.join(cells)} |")
    return "\n".join(lines)


def put_into(page: Path, table: str) -> None:
    """Put the table between its marks in a page; a ValueError where it has none."""
    from studies._pages import put_between  # a loop of yours does without the clone

    put_between(page, f"\n{table}\n", BEGIN, END)


def _timed(
    states: int, horizon: int, repeats: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Median and 99th percentile [s] of `act` and of `update`."""
    # Any network of this size, and any loss.
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    model = DPMPB(states, 3, 2).eval().requires_grad_(False)
    estimator = NewtonEstimator(model, settings=WINDOW, from_rest=False)
    controller = Controller(
        model,
        lambda s, u, t: s.square().sum((1, 2)),
        np.zeros(2),
        -np.ones(3),
        np.ones(3),
        ControlSettings(horizon=horizon),
    )

    # A full window first, of which each later step costs the same.
    acting = []
    updating = []
    for step in range(WINDOW.window + repeats):
        s = rng.normal(size=states)
        before = time.thread_time()
        u = controller.act(s, solve=step >= WINDOW.window)
        between = time.thread_time()
        estimator.update(s, u)
        after = time.thread_time()
        if step >= WINDOW.window:
            acting.append(between - before)
            updating.append(after - between)
    return _summary(acting), _summary(updating)


def _summary(times: list[float]) -> tuple[float, float]:
    return float(np.median(times)), float(np.quantile(times, 0.99))


def calibrated(learned: Checkpoint) -> Alarm | None:
    """The alarm of a calibration by further runs; that needs SciPy."""
    if find_spec("scipy") is None:
        return None
    from clothlab.calibration import calibrate

    runs = [record(name, seed, 60) for name in WEIGHTS for seed in range(10, 20)]
    found = calibrate(learned.model, learned.biases, runs, lengths=(WINDOW.window,))
    return found.out_of_distribution


class Stalling(Swing):
    """A swing whose sensors make the loop wait, once in 5 seconds."""

    def __init__(self, weight: float, stall: float):
        super().__init__(weight, time.monotonic)
        self._stall = stall  # [s]
        self._reads = 0

    def read(self) -> tuple[np.ndarray, float]:
        seen = super().read()
        self._reads += 1
        if self._reads % int(5 / STEP) == 0:
            time.sleep(self._stall)
        return seen


def main() -> None:
    """Train, drive, and say what happened."""
    # What is asked for.
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--weight", type=float, default=1.0, help="[kg]")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--stall", type=float, default=0.0, help="[s]")
    parser.add_argument("--rates", action="store_true", help="only time the work")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    if arguments.rates:
        table = rates()
        print(table)
        if arguments.page:
            put_into(arguments.page, table)
        return

    # The robot that was trained on, with a weight that the loop is not told.
    learned = learn()
    print("trained p:", {k: p.round(2).tolist() for k, p in learned.biases.items()})
    robot = Stalling(arguments.weight, arguments.stall)
    loop = Loop(robot, learned, Beat(STEP), alarm=calibrated(learned))
    for _ in range(int(arguments.seconds / STEP)):
        loop.cycle()
    report = loop.report

    # How it went.
    work = 1e3 * np.array(report.work)
    last = np.array(report.states)[-40:, 0]
    print(f"p at the end: {report.biases[-1].round(2).tolist()}")
    print(f"distance to the goal in the last 2 s: {np.abs(last - GOAL).mean():.3f} rad")
    print(f"{len(work)} cycles, {report.late} late, {report.missed} missed")
    print(f"{report.gaps} gaps, {report.rests} cycles at rest, {report.alarms} alarms")
    p99 = np.quantile(work, 0.99)
    print(f"work of a cycle {np.median(work):.1f} ms, 99 of 100 below {p99:.1f} ms")


if __name__ == "__main__":
    main()
