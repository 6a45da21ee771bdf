"""What both results recipes share: trained networks, random runs, jobs side by side, the table of what was found."""

from collections import defaultdict
from collections.abc import Callable, Sequence

import joblib
import numpy as np
import torch
from tqdm.auto import tqdm

from clothlab import artifacts
from clothlab._files import atomic_write
from clothlab.autoencoder import Autoencoder
from clothlab.cloth import Cloth
from clothlab.dpmpb import DPMPB
from clothlab.env import ClothEnv
from clothlab.trials import RandomPolicy, Trial, rollout

README = artifacts.DATA.parent / "README.md"


def load_autoencoder(arm: str) -> Autoencoder:
    """The trained autoencoder; jobs run side by side, so each keeps to one core."""
    torch.set_num_threads(1)
    return artifacts.load_autoencoder(arm)[0]


def load_dpmpb(arm: str, k: int) -> tuple[DPMPB, dict[str, np.ndarray]]:
    """Model k and the p of each material."""
    return artifacts.load_dpmpb(f"{arm}-{k}")[:2]


def random_trial(arm: str, cloth: Cloth | str, steps: int, seed: int) -> Trial:
    """Random commands on a fresh scene."""
    env = ClothEnv(arm, cloth)
    trial = rollout(env, RandomPolicy(env.arm, seed=seed), steps, seed=seed, name="random")
    env.close()
    return trial


def run_jobs(jobs: Sequence[tuple[Callable, tuple]], workers: int) -> dict[str, list]:
    """Call each `function(*arguments)`, several at once; the answers by the function's name, in the order of jobs."""
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator")
    found = parallel(joblib.delayed(function)(*arguments) for function, arguments in jobs)
    answers = defaultdict(list)
    for (function, _), answer in zip(jobs, tqdm(found, total=len(jobs), desc="results", unit="run"), strict=True):
        answers[function.__name__].append(answer)
    return answers


def row(
    what: str,
    paper: str,
    value: float,
    bound: float | tuple[float, float] | None = None,
    unit: str = "",
    at_least: bool = True,
    spread: str = "",
) -> dict:
    """A row of a results table: what, the paper's figure, ours, the bound (or two), and whether ours is within it."""
    if bound is None:
        text, held = "–", None
    elif isinstance(bound, tuple):
        text, held = f"{bound[0]:.3g} to {bound[1]:.3g}{unit}", bound[0] <= value <= bound[1]
    else:
        text, held = f"{'≥' if at_least else '≤'} {bound:.2g}{unit}", value >= bound if at_least else value <= bound
    here = f"{value:.2f}{unit}{spread}"
    return {"what": what, "paper": paper, "here": here, "bound": text, "held": None if held is None else bool(held)}


def publish(results: dict, rows: list[dict], name: str) -> None:
    """Print the table, write `data/results/NAME.json`, and put the table into the README between its marks."""
    artifacts.save_results(results | {"table": rows}, name)
    artifacts.write_checksums()
    text = README.read_text()
    before, rest = text.split(f"<!-- {name} -->")
    _, after = rest.split(f"<!-- /{name} -->")
    with atomic_write(README) as temporary:
        temporary.write_text(f"{before}<!-- {name} -->\n{_markdown(rows)}\n<!-- /{name} -->{after}")
    for each in rows:
        mark = {True: "✓", False: "✗", None: " "}[each["held"]]
        print(f"{mark} {each['what']}: {each['here']} (bound {each['bound']}, paper {each['paper']})")


def _markdown(rows: list[dict]) -> str:
    lines = ["| | paper | here | aim | |", "| --- | --- | --- | --- | --- |"]
    for each in rows:
        mark = {True: "✓", False: "short of it", None: ""}[each["held"]]
        lines.append(f"| {each['what']} | {each['paper']} | {each['here']} | {each['bound']} | {mark} |")
    return "\n".join(lines)
