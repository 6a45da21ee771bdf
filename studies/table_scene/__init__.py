"""Setting a table: a scene, what the robot sees in it, and the task phase by phase.

scene, table_env, perception, servoing, throwing and task stand on one another.
"""
