"""The simulated world: cloth, muscles, two arms, the camera's mask, an environment.

Importing it, or anything in it, registers that environment with Gymnasium, for
`gymnasium.make("clothlab/Cloth-v0")`; so does `import clothlab` after Gymnasium. A name
that needs no import before is `"clothlab.simulation:clothlab/Cloth-v0"`.
"""

import gymnasium

gymnasium.register("clothlab/Cloth-v0", entry_point="clothlab.simulation.env:ClothEnv")
