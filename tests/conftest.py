"""Loads what tests share, in the processes that run them."""

import os
import sys

import pytest

# Nbformat's jsonschema would take a second, in each process, to build a grammar of web
# addresses that no notebook is judged by; without this module it does not.
sys.modules.setdefault("rfc3987_syntax", None)
# What a developer made in the notebooks is no part of any test
os.environ["CLOTHLAB_MINE"] = ""


def pytest_configure(config: pytest.Config) -> None:
    """Load `shared.py`, which imports torch and mujoco: some seconds.

    The process that only hands out tests to others of pytest-xdist does not need it.
    """
    hands_out = config.getoption("dist", "no") != "no"
    if hasattr(config, "workerinput") or not hands_out:
        config.pluginmanager.import_plugin("shared")
