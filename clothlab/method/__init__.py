"""The method of the paper, for any robot, and one step beyond it.

K. Kawaharazuka et al., "Dynamic Cloth Manipulation Considering Variable Stiffness and
Material Change Using Deep Predictive Model with Parametric Bias".

To be read in this order: `model`, `data`, `training`, `estimation`, `control`,
`rollout`, `autoencoder`, `cloth_task`. All of it in six lines:

    from clothlab import Controller, estimate_bias, rollout, train_dpmpb

    run = rollout(env, policy, 500, material="heavy")  # one of many
    model, biases, _ = train_dpmpb(runs)  # W, and p of each material
    p, _ = estimate_bias(model, new_run)  # W stays, p moves
    loss = lambda states, commands, t: (states[..., 0] - 0.5).abs().amin(1)
    controller = Controller(model, loss, p, lower, upper)
    u = controller.act(s)  # W and p stay, the commands move

| symbol | what it is |
| --- | --- |
| s | state; with a cloth (z, robot state), where z stands for the image |
| u | command; with a robot of variable stiffness (θ_ref, k_ref): k is one number more |
| p | parametric bias, one for each material |
| W | weights of the network |
| B, T, K | sequences of a batch, control steps, materials |
| D_s, D_u, D_p, D_z | numbers in s, u, p, z |

How a stiffness becomes lengths of muscles is the robot's own (eq. 2), and stands in
`clothlab.simulation.arm`, as do limits and layout of its states. Beyond the paper are
`estimation.NewtonEstimator`, recorded plans and `warm_start="earlier"` of `control`,
and `iterative`. Of other packages the method takes torch, numpy and tqdm.
"""
