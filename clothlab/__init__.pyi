"""What `__init__.py` has in its table of contents, for editors and type checkers."""

from clothlab import (
    analysis as analysis,
    checks as checks,
    lab as lab,
    plots as plots,
    tables as tables,
)
from clothlab.data import (
    load as load,
    load_autoencoder as load_autoencoder,
    load_model as load_model,
    load_target as load_target,
    load_targets as load_targets,
    load_trials as load_trials,
)
from clothlab.masks import iou as iou
from clothlab.method.autoencoder import (
    AutoencoderTraining as AutoencoderTraining,
    decode as decode,
    encode as encode,
)
from clothlab.method.checkpoint import Checkpoint as Checkpoint
from clothlab.method.cloth_task import (
    ControlPolicy as ControlPolicy,
    EstimatingPolicy as EstimatingPolicy,
    observe as observe,
    period_mask as period_mask,
)
from clothlab.method.collecting import collect_runs as collect_runs
from clothlab.method.control import (
    Controller as Controller,
    ControlSettings as ControlSettings,
    GradientSearch as GradientSearch,
)
from clothlab.method.data import Run as Run
from clothlab.method.estimation import BiasEstimator as BiasEstimator
from clothlab.method.fast_rollout import FastDPMPB as FastDPMPB
from clothlab.method.gauss_newton import (
    NewtonEstimator as NewtonEstimator,
    estimate_bias as estimate_bias,
)
from clothlab.method.logs import (
    read_runs as read_runs,
    runs_from_dataframe as runs_from_dataframe,
)
from clothlab.method.model import (
    DPMPB as DPMPB,
    PredictiveModel as PredictiveModel,
    predict as predict,
)
from clothlab.method.policy import Policy as Policy
from clothlab.method.rollout import rollout as rollout
from clothlab.method.training import (
    ModelTraining as ModelTraining,
    train_dpmpb as train_dpmpb,
)
from clothlab.policies import (
    OperatorPolicy as OperatorPolicy,
    RandomPolicy as RandomPolicy,
    ReplayPolicy as ReplayPolicy,
)
from clothlab.simulation.arm import MuscleArm as MuscleArm
from clothlab.simulation.cloth import (
    CLOTHS as CLOTHS,
    Cloth as Cloth,
    cloth_name as cloth_name,
    get_cloth as get_cloth,
)
from clothlab.simulation.env import (
    CONTROL_PERIOD as CONTROL_PERIOD,
    ClothEnv as ClothEnv,
)
from clothlab.simulation.scene import Scene as Scene
from clothlab.simulation.vision import chamfer_distance as chamfer_distance
from clothlab.trials import recorded_plans as recorded_plans

__version__: str
