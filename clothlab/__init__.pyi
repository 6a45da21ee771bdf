"""The table of contents: what `from clothlab import ...` brings."""

from . import (
    analysis as analysis,
    checks as checks,
    lab as lab,
    mine as mine,
    plots as plots,
)
from .data import (
    load as load,
    load_autoencoder as load_autoencoder,
    load_model as load_model,
    load_table as load_table,
    load_target as load_target,
    load_targets as load_targets,
    load_trials as load_trials,
)
from .logs import runs_from_table as runs_from_table
from .method.autoencoder import (
    AutoencoderTraining as AutoencoderTraining,
    decode as decode,
    encode as encode,
)
from .method.cloth_task import (
    ControlPolicy as ControlPolicy,
    EstimatingPolicy as EstimatingPolicy,
    observe as observe,
    period_mask as period_mask,
)
from .method.control import Controller as Controller, ControlSettings as ControlSettings
from .method.data import Run as Run
from .method.estimation import (
    BiasEstimator as BiasEstimator,
    NewtonEstimator as NewtonEstimator,
    estimate_bias as estimate_bias,
)
from .method.model import DPMPB as DPMPB, predict as predict
from .method.rollout import Policy as Policy, rollout as rollout
from .method.training import ModelTraining as ModelTraining, train_dpmpb as train_dpmpb
from .policies import (
    OperatorPolicy as OperatorPolicy,
    RandomPolicy as RandomPolicy,
    ReplayPolicy as ReplayPolicy,
)
from .simulation.arm import MuscleArm as MuscleArm
from .simulation.cloth import (
    CLOTHS as CLOTHS,
    Cloth as Cloth,
    cloth_name as cloth_name,
    get_cloth as get_cloth,
)
from .simulation.env import CONTROL_PERIOD as CONTROL_PERIOD, ClothEnv as ClothEnv
from .simulation.scene import Scene as Scene
from .simulation.vision import chamfer_distance as chamfer_distance, iou as iou
from .trials import recorded_plans as recorded_plans
from .weights import Checkpoint as Checkpoint

__version__: str
opengl_named: str
