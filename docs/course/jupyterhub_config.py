"""A class on one server: data and package read-only, a student's recordings at home, limits on cores and memory."""

import os

c = get_config()  # noqa: F821  (JupyterHub provides it)

CLOTHLAB = os.environ.get("CLOTHLAB", "/srv/clothlab")  # the clone; students can read it and not write

c.JupyterHub.spawner_class = "systemd"  # from jupyterhub-systemdspawner, which holds students to the limits below
c.Spawner.cmd = [f"{CLOTHLAB}/.venv/bin/jupyterhub-singleuser"]
c.Spawner.default_url = "/lab"
c.Spawner.environment = {
    "CLOTHLAB_DATA": f"{CLOTHLAB}/data",
    "CLOTHLAB_RECORDINGS": "~/recordings",
    "OMP_NUM_THREADS": "1",  # the matrices are small: a second core would only wait
    "MUJOCO_GL": "egl",
}
c.Spawner.cpu_limit = 1.0
c.Spawner.mem_limit = "3G"  # the largest notebook of the series at work, and a second one that was forgotten
c.Spawner.args = ["--MappingKernelManager.cull_idle_timeout=1800", "--MappingKernelManager.cull_connected=True"]
