"""The method of the paper, for any robot, and what goes beyond it.

K. Kawaharazuka et al., "Dynamic Cloth Manipulation Considering Variable Stiffness and
Material Change Using Deep Predictive Model with Parametric Bias".

To be read in this order: `model`, `data`, `training`, `estimation`, `control`,
`autoencoder`, `cloth_task`. Where `control` speaks of a `Rollout`, read
`model.predict` with p fixed. All of it in five lines:

    run = rollout(env, policy, 500, material="heavy")  # one of many
    model, biases, _ = train_dpmpb(runs)  # W, and p of each material
    p, _ = estimate_bias(model, new_run)  # W stays, p moves
    controller = Controller(model, loss, p, lower, upper)
    u = controller.act(s)  # W and p stay, the commands move

Beyond the paper are `gauss_newton`, `iterative` and `fast_rollout`; around the method
are `rollout`, which records runs, and `checkpoint`, by which a model gets to its robot.
Modules with an underscore hold what several of these share, and need not be read to
follow them. Of other packages the method takes torch, numpy, tqdm and safetensors.
"""
