"""The paper's method, for any robot, and what goes beyond it.

To be read in this order: `model`, `data`, `training`, `estimation`, `control`,
`autoencoder`, `cloth_task`. Beyond the paper are `gauss_newton`, `iterative` and
`fast_rollout`; around it, `policy`, `rollout` and `checkpoint`. Of other packages it
takes torch, numpy, tqdm and safetensors.
"""
