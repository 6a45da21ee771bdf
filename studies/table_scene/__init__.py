"""Setting a table: scene, environment, perception, servoing, throwing, and the task.

Importing it registers the environment: `gymnasium.make("clothlab/Table-v0")`.
"""

import gymnasium

gymnasium.register(
    "clothlab/Table-v0", entry_point="studies.table_scene.table_env:TableEnv"
)
