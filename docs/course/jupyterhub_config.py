"""A class on one server: data and package read-only, a student's recordings at home,
limits on cores and memory.
"""

import os

c = get_config()  # noqa: F821  (JupyterHub provides it)

# The clone; students can read it and not write
CLOTHLAB = os.environ.get("CLOTHLAB", "/srv/clothlab")

# From jupyterhub-systemdspawner, which holds students to the limits below
c.JupyterHub.spawner_class = "systemd"
c.Spawner.cmd = [f"{CLOTHLAB}/.venv/bin/jupyterhub-singleuser"]
c.Spawner.default_url = "/lab"
c.Spawner.environment = {
    "CLOTHLAB_DATA": f"{CLOTHLAB}/data",
    "CLOTHLAB_RECORDINGS": "~/recordings",
    "CLOTHLAB_MINE": "~/mine",  # what students train and write
    "OMP_NUM_THREADS": "1",  # the matrices are small: a second core would only wait
    "MUJOCO_GL": "egl",
}
c.Spawner.cpu_limit = 1.0
# The largest notebook of the series at work, and a second one that was forgotten
c.Spawner.mem_limit = "3G"
c.Spawner.args = [
    f"--config={CLOTHLAB}/jupyter_lab_config.py",
    "--MappingKernelManager.cull_idle_timeout=1800",
    "--MappingKernelManager.cull_connected=True",
]
