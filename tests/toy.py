"""A world that is known in closed form: what a study finds in it can be said beforehand.

Its camera says z plainly: each number is a count of pixels in a third of the image. Its
cloth obeys at once: z[t+1] = ((1 + p) u[t], 0), where p follows from the material. Its
model knows all of that but p. It is no network: where control predicts with it, its own
`forward` is asked.
"""

import numpy as np
import torch
from torch import nn

from clothlab.method import control, iterative
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.model import DPMPB, Memory, predict
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS, get_cloth
from clothlab.trials import Trial
from clothlab.weights import ClothCheckpoint

PIXELS = 32 * 128  # of a third of the image
UNIT = 512  # pixels for 1 s.d. of z; PIXELS / 2 of them are z = 0


def image_of(z):
    """The image `[96, 128]` of z `[3]`: so many pixels in each third."""
    counts = np.round(np.asarray(z) * UNIT).astype(int) + PIXELS // 2
    return (np.arange(PIXELS) < counts[:, None]).reshape(96, 128)


class _Count(nn.Module):
    def forward(self, images):
        return (images.reshape(-1, 3, PIXELS).sum(-1) - PIXELS / 2) / UNIT


class _Draw(nn.Module):
    def __init__(self, lost):
        super().__init__()
        self.lost = lost

    def forward(self, z):
        counts = z * UNIT + PIXELS / 2 - self.lost
        drawn = torch.arange(PIXELS) < counts.round()[..., None]
        return (20.0 * drawn - 10).reshape(-1, 1, 96, 128)


def camera(lost=0):
    """An autoencoder that is exact, but for pixels that its pictures of a third lack."""
    made = Autoencoder()
    made.encoder = _Count()
    made.decoder = _Draw(lost)
    return made.eval()


class Obedient(DPMPB):
    """z[t+1] = ((1 + p) u[t], 0), and a robot that senses nothing."""

    def __init__(self, arm):
        super().__init__(3 + len(arm.state_names), len(arm.command_names))
        self.u_std.fill_(0.5)

    def forward(self, s, u, p, memory=None):
        angles = (1 + p.expand(len(u), 2))[:, None] * u[..., :2]
        predicted = nn.functional.pad(angles, (0, self.state_size - 2))
        zeros = torch.zeros(2, len(u), 30)
        return predicted, Memory(zeros, zeros) if memory is None else memory


def _predict(model, s, u, p, memory=None):
    if not isinstance(model, Obedient):
        return predict(model, s, u, p, memory)
    predicted, _ = model(s, u, p, memory)
    return predicted


control.predict = _predict
iterative.predict = _predict


def bias_of(cloth):
    """The right p of a material `[2]`: a straight map of log C_damp and log C_mass."""
    cloth = get_cloth(cloth)
    logs = np.log([cloth.damping / 0.05, cloth.mass / 0.1])
    return (logs * (0.8, 0.4)).astype(np.float32)


def learned(arm="torque", names=CLOTHS, lost=0):
    """What a training would have found."""
    arm = get_arm(arm)
    biases = {name: bias_of(name) for name in names}
    model = Obedient(arm).eval().requires_grad_(False)
    return ClothCheckpoint(
        name=f"{arm.name}-0",
        model=model,
        biases=biases,
        arm=arm,
        autoencoder=camera(lost),
        autoencoder_name=arm.name,
    )


def trial_of(z, commands=None, arm="torque", cloth="damp0.05-mass0.10", seed=0):
    """A trial that shows these z `[T, 3]`."""
    arm = get_arm(arm)
    if commands is None:
        commands = np.tile(arm.home_command, (len(z), 1))
    images = np.array([image_of(each) for each in z])
    robot = np.zeros((len(z), len(arm.state_names)))
    return Trial(images, robot, commands, get_cloth(cloth), arm, "toy", seed)


def new_trial(policy, arm, cloth, steps, seed):
    """A policy in this world, from z = 0 on."""
    arm, p = get_arm(arm), bias_of(cloth)
    z = [np.zeros(3)]
    commands = []
    policy.reset(seed)
    for _ in range(steps):
        robot = np.zeros(len(arm.state_names))
        observation = {"image": image_of(z[-1]).astype(np.int8), "robot": robot}
        commands.append(np.asarray(policy(observation), dtype=np.float64))
        z.append(np.append((1 + p) * commands[-1][:2], 0.0))
    return trial_of(z[:-1], commands, arm, cloth, seed)


def random_trial(arm, cloth, steps, seed):
    """Random commands in this world."""
    rng, arm = np.random.default_rng(seed), get_arm(arm)
    size = (steps, len(arm.command_lower))
    commands = rng.uniform(arm.command_lower, arm.command_upper, size)
    shown = np.pad((1 + bias_of(cloth)) * commands[:-1, :2], ((1, 0), (0, 1)))
    return trial_of(shown, commands, arm, cloth, seed)
