"""Setting a table: the scene, its environment, perception, servoing, throwing, and the
task phase by phase.
"""
