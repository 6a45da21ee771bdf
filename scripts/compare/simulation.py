"""The paper's section on the simulation."""

NAMES = [f"control{end}" for end in ("", "-paper")]


def tables(name, record):
    """The runs, with the settings that are parameters of `run_one`."""
    settings = record["settings"]
    return {name: [run | {key: settings[key] for key in ("weights", "steps")} for run in record["runs"]]}
