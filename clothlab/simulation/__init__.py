"""The simulated world: cloth, muscles, two arms, the camera's mask, and a Gymnasium
environment of them.
"""

from clothlab._extras import require

require("clothlab.simulation", "mujoco", "cloth")
