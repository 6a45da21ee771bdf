"""What the paper says in numbers is what this project does by default.

The sections are those of Kawaharazuka et al., "Dynamic Cloth Manipulation Considering
Variable Stiffness and Material Change Using Deep Predictive Model with Parametric Bias".
"""

from itertools import product

import numpy as np
import torch
from torch import nn

from clothlab._validation import HEIGHT, WIDTH
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.control import ControlSettings
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import CLOTHS
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv


def shapes(layers, kind):
    return [tuple(each.weight.shape) for each in layers if isinstance(each, kind)]


def test_the_network_has_ten_layers_of_these_sizes():
    """ "Network Structure of DPMPB"."""
    model = DPMPB(state_size=7, command_size=2)
    into = [(300, 2 + 7 + 2), (100, 300), (30, 100)]
    out = [(30, 30), (100, 30), (300, 100), (7, 300)]
    assert shapes(model.fc_in, nn.Linear) == into
    assert shapes(model.fc_out, nn.Linear) == out
    lstm = model.lstm
    assert (lstm.input_size, lstm.hidden_size, lstm.num_layers) == (30, 30, 2)
    x = torch.linspace(-3, 3, 13)
    assert torch.allclose(model.fc_in[1](x), torch.tanh(x), atol=1e-6)


def test_the_autoencoder_halves_the_image_five_times():
    """ "Network Structure of DPMPB": 256 and 3 units, batch normalisation, ReLU."""
    assert (WIDTH, HEIGHT) == (128, 96)
    encoder = Autoencoder().eval().encoder
    convolutions = [each for each in encoder if isinstance(each, nn.Conv2d)]
    assert [each.kernel_size for each in convolutions] == [(3, 3)] * 5
    assert [each.stride for each in convolutions] == [(2, 2)] * 5
    units = [shape[0] for shape in shapes(encoder, nn.Linear)]
    assert units == [256, 3]
    sizes = []
    image = torch.zeros(1, 1, 96, 128)
    for layer in encoder:
        image = layer(image)
        if isinstance(layer, nn.Conv2d):
            sizes.append(tuple(image.shape[2:]))
    assert sizes == [(48, 64), (24, 32), (12, 16), (6, 8), (3, 4)]
    kinds = [type(each) for each in encoder]
    assert sum(kind in (nn.BatchNorm2d, nn.BatchNorm1d) for kind in kinds) == 7
    assert kinds.count(nn.ReLU) == 6  # z has none


def test_training_has_the_settings_of_the_simulation():
    """ "Simulation Experiment": LSTM expansions, batches, epochs; p of two numbers."""
    found = ModelTraining()
    assert (found.sequence_length, found.batch_size, found.epochs) == (30, 300, 300)
    assert found.bias_size == 2


def test_control_has_the_constants_of_the_paper():
    """ "Dynamic Cloth Manipulation Using DPMPB": N_seq, N_batch, γ_max, N_iter, N_periodic."""
    found = ControlSettings()
    assert (found.horizon, found.candidates, found.largest_step) == (8, 30, 1.0)
    assert (found.iterations, found.period, found.warm_start) == (3, 8, "last")
    sizes = found.step_sizes()
    assert len(sizes) == 30
    assert sizes[0] == 0
    assert sizes[-1] == 1
    ratios = sizes[2:] / sizes[1:-1]  # equal intervals of the logarithm
    assert torch.allclose(ratios, ratios[0], rtol=1e-4)


def test_the_world_has_the_paper_s_rates_cloths_and_tensions():
    """ "Simulation Experiment": 3 × 6 points, C_damp, C_mass; 5 Hz; f_const."""
    assert CONTROL_PERIOD == 1 / 5
    materials = [(cloth.damping, cloth.mass) for cloth in CLOTHS.values()]
    assert materials == [*product((0.03, 0.05, 0.07), (0.05, 0.10, 0.15))]
    assert {(c.rows, c.columns) for c in CLOTHS.values()} == {(6, 3)}
    assert MuscleArm().tension_range == (10, 70)
    env = ClothEnv()
    env.advance(env.arm.home_command)
    assert np.isclose(env.data.time, 0.2)
