"""JupyterLab, started here, asks no server on the web for news or newer versions."""

c = get_config()  # noqa: F821  (JupyterLab provides it)
c.LabApp.news_url = None
c.LabApp.check_for_updates_class = "jupyterlab.NeverCheckForUpdate"
