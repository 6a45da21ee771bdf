"""What p is worth: throws are chosen by what was seen and what is predicted, and compared over random commands."""

import numpy as np
import pandas as pd
import pytest
import torch

from clothlab.experiments import _runs, transfer
from clothlab.experiments.transfer import METHODS, NEW, Throws, _gaps, choose_throw, difference, over_random
from clothlab.learning.trained import Trained
from clothlab.simulation.cloth import CLOTHS, FOAMS

BIASES = {"a": np.array([1.0, 0.0]), "b": np.array([-1.0, 0.0])}


@pytest.fixture
def throws():
    u = torch.arange(4.0)[:, None, None].expand(4, 8, 2)
    return Throws(u, np.array([0.1, 0.2, 0.3, 0.4]), torch.zeros(4, 8, 3), np.array(["a", "b", "a", "b"]))


def test_new_cloths_were_never_recorded_and_can_be_told_from_those_that_were():
    for arm, known in {"torque": CLOTHS, "muscle": FOAMS}.items():
        assert len({cloth.name for cloth in NEW[arm]} - set(known)) == len(NEW[arm]) >= 8
        materials = {(each.mass, each.damping, each.bending) for each in known.values()}
        assert not materials & {(each.mass, each.damping, each.bending) for each in NEW[arm]}


def test_a_throw_is_chosen_by_what_was_seen_what_is_predicted_and_how_alike_the_materials_are(throws, monkeypatch):
    learned = Trained("x", None, None, None, BIASES, np.zeros(1), "x")
    predicted = np.array([0.9, 0.1, 0.1, 0.0])

    def predict(learned, s, u, p):
        z = torch.zeros(len(u), 3, 8, 3)
        z[..., 0] = torch.as_tensor(predicted)[:, None, None]
        return z

    monkeypatch.setattr(transfer, "_predicted", predict)
    assert _gaps(throws, BIASES["a"], BIASES) == pytest.approx([0, 4, 0, 4])
    assert choose_throw(learned, throws, torch.zeros(7), torch.zeros(3), BIASES["a"]) == 2
    assert choose_throw(learned, throws, torch.zeros(7), torch.zeros(3), BIASES["b"]) == 1


def test_differences_are_over_random_commands_and_paired():
    rows = [
        {"model": model, "repeat": repeat, "cloth": cloth, "random": 2.0}
        | {"distance": np.full((len(METHODS), 2), 1.0) - 0.5 * np.eye(len(METHODS), 2, -METHODS.index("both, zero"))}
        for model in range(2)
        for repeat in range(2)
        for cloth in "ab"
    ]
    table = pd.DataFrame(rows)
    assert over_random(table, "both, zero").tolist() == [0.25] * 8
    assert difference(table, "both, zero", "both, none") == pytest.approx((-0.25, -0.25, -0.25))


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "cloth"), [("torque", "damp0.03-mass0.05"), ("muscle", NEW["muscle"][0].name)])
def test_a_row_has_every_method_that_its_cloth_allows(arm, cloth, monkeypatch):
    few = {"torque": "train", "muscle": "muscle-train"}[arm]
    monkeypatch.setattr(transfer, "recorded_runs", lambda learned: _runs._encoded(learned.autoencoder_name, few)[::3])
    monkeypatch.setattr(transfer, "_without_p", lambda arm, model: transfer.trained(f"{arm}-{model}"))
    monkeypatch.setattr(transfer, "_EXCITED", 30)
    monkeypatch.setitem(transfer._run_first.__globals__, "_by_chance", lambda *_: 1.0)
    transfer._throws.cache_clear()
    row = transfer._run_first(arm, transfer.TARGETS[arm][0], cloth, 0, 0, steps=16)
    transfer._throws.cache_clear()
    missing = {METHODS[k] for k in np.flatnonzero(np.isnan(row["distance"][:, 0]))}
    assert missing <= {"replay, this cloth", "both, right"}
    assert bool(missing) == (cloth not in {**CLOTHS, **FOAMS})
    assert ((row["iou"] >= 0) | np.isnan(row["iou"])).all()
