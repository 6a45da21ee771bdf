"""The method of the paper, for any robot, and one step beyond it.

K. Kawaharazuka et al., "Dynamic Cloth Manipulation Considering Variable Stiffness and
Material Change Using Deep Predictive Model with Parametric Bias".

To be read in this order: `model`, `data`, `training`, `estimation`, `control`,
`autoencoder`, `cloth_task`, `rollout`. All of it in five lines:

    run = rollout(env, policy, 500, material="heavy")  # one of many
    model, biases, _ = train_dpmpb(runs)  # W, and p of each material
    p, _ = estimate_bias(model, new_run)  # W stays, p moves
    controller = Controller(model, loss, p, lower, upper)
    u = controller.act(s)  # W and p stay, the commands move

Beyond the paper are `estimation.NewtonEstimator` and `iterative`. Of other packages the
method takes torch, numpy and tqdm.
"""
