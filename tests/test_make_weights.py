"""Training of the stored weights: which are trained."""

import make_weights

from clothlab.training_configs import RECIPES


def test_only_those_without_borrowed_eyes_train_an_autoencoder():
    found = make_weights.autoencoders(list(RECIPES))
    assert found == ["torque-paper", "muscle-paper", "torque", "muscle", "table"]
