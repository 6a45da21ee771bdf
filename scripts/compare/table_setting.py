"""Setting the table. The method "descent" is gone, and so are its runs."""

NAMES = ["table_setting"]


def tables(name, record):
    """Episodes, first motions and the border; the seed of a first motion says which repetition it is."""
    first_seed = record["settings"]["first_seed"]
    dropped = [{key: value for key, value in guess.items() if key != "seed"} for guess in record["guesses"]]
    repeats = [guess["seed"] - first_seed for guess in record["guesses"]]
    return {
        name: [_without_empty(run) for run in record["runs"] if run["method"] != "descent"],
        f"{name}_material": [each | {"repeat": k} for each, k in zip(dropped, repeats, strict=True)],
        f"{name}_border": record["border"],
    }


def _without_empty(run):
    """Empty words are missing values in a table."""
    return {key: None if value == "" else value for key, value in run.items()}


FIGURES = {
    "table_setting/grasped": "cloth grasped, of 50",
    "table_setting/spread": "cloth spread by a throw, of 50",
    "table_setting/placed": "basket placed, given a spread cloth, of 49",
    "table_setting/success": "the whole run, of 50",
    "table_setting/spread/slow": "cloth spread, slow, of 50",
    "table_setting/spread/best recorded": "cloth spread, best recorded, of 50",
    "table_setting/difference": "cloth spread: by a throw minus slowly (95 %)",
    "table_setting/material": "p after the first swing: nearest of 4 foams is the right one, of 100",
}
