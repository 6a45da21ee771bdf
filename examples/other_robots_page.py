"""What `other_robots.py` measured, as tables with verdicts for *Your own robot*.

Margins, set before anything was measured at full size:

* a property, or a material, is *found* where more than two thirds of new runs get the
  right one, and *not found* where fewer do;
* p *pays* in control where the wrong p loses more than a tenth of what the controller
  gains over random commands, and makes *no difference* where it loses and gains less;
* a network of one's own is *better* or *worse* than the paper's by more than that
  tenth, *as good* where it is not worse; and *faster* where a command takes a tenth
  less time.

The 95 % interval decides, and what it leaves open is *inconclusive*. That of a share of
runs is Wilson's, as if all runs were independent; that of prediction is over materials
and trainings at once. In control it is over trainings, for the lightest, the middle and
the heaviest material: over materials, too, three say nothing, which was seen after the
first training.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from clothlab.analysis import crossed_interval, rate_interval
from studies import _pages

FOUND = 2 / 3  # of new runs
MATTERS = 0.1  # of what control gains
BEGIN = "<!-- python examples/other_robots.py --tell --page docs/your_own_robot.md -->"
END = "<!-- end of other robots -->"
OPEN = "inconclusive"
ROBOTS = {"pendulum": "pendulum: mass, length", "cheetah": "cheetah: mass, damping"}
FEEDBACK = ("every step", "every 8 steps")


class Interval(NamedTuple):
    """A mean and its 95 % interval."""

    mean: float
    low: float
    high: float


def as_percent(low: float, high: float) -> str:
    """An interval of a share."""
    return f"{100 * low:.0f} to {100 * high:.0f} %"


def share_of(values: pd.Series, gain: float) -> tuple[str, Interval]:
    """Values over what control gains, as a share with its interval."""
    share = over_trainings(values / gain)
    text = f"{100 * share.mean:.0f} % ({as_percent(share.low, share.high)})"
    return text, share


def chosen(rows: pd.DataFrame, task: str, measure: str) -> pd.DataFrame:
    """Rows of one measure of one task."""
    found = rows[(rows["task"] == task) & (rows["measure"] == measure)]
    if found.empty:
        raise ValueError(f"nothing is stored of {task}: {measure}")
    return found.fillna({"case": "", "arm": ""})


def by_arm(rows: pd.DataFrame, task: str, measure: str) -> pd.DataFrame:
    """Values with a row for each arm, and a column for each case and seed."""
    found = chosen(rows, task, measure)
    return found.pivot_table("value", "arm", ["case", "seed"], sort=False)


def crossed(values: pd.Series) -> Interval:
    """Mean over cases and seeds, and its interval over both at once."""
    return Interval(*crossed_interval(values.unstack("seed").to_numpy()))


def of_each(shares: pd.Series) -> str:
    """Means of the cases, as percentages."""
    means = shares.groupby("case", sort=False).mean()
    return ", ".join(f"{100 * mean:.0f}" for mean in means) + " %"


def over_trainings(values: pd.Series) -> Interval:
    """Mean of these cases, and its interval over seeds alone."""
    means = values.groupby("seed").mean()
    return Interval(*crossed_interval(means.to_numpy()[None]))


def found(low: float, high: float) -> str:
    """Whether new runs get the right one."""
    if low > FOUND:
        return "**found**"
    return "**not found**" if high < FOUND else OPEN


def worth(low: float, high: float) -> str:
    """What p is worth in control, by what the wrong one loses."""
    if low > MATTERS:
        return "**p pays**"
    if low > -MATTERS and high < MATTERS:
        return "**no difference**"
    return "the wrong p is better" if high < -MATTERS else OPEN


def beside(low: float, high: float) -> str:
    """How a network controls beside the paper's, by what it gains."""
    if low > MATTERS:
        return "**better**"
    if high < -MATTERS:
        return "**worse**"
    return "**as good**" if low > -MATTERS else OPEN


def count(rows: pd.DataFrame) -> str:
    """How many of how many were right."""
    return f"{rows['value'].sum():.0f} of {len(rows)}"


def right(rows: pd.DataFrame) -> dict[str, str]:
    """The same with its interval, and the verdict."""
    _, low, high = rate_interval(rows["value"].to_numpy() > 0.5)
    return {
        "right one": f"{count(rows)} ({as_percent(low, high)})",
        "verdict": found(low, high),
    }


def markdown(table: list[dict[str, str]]) -> str:
    """Rows of text as a table."""
    lines = [tuple(row.values()) for row in table]
    return _pages.table([tuple(table[0]), *lines])


def finding(rows: pd.DataFrame) -> list[dict[str, str]]:
    """Whether p tells nine materials, or eight loads, apart."""
    table = []
    for task, title in ROBOTS.items():
        explained = chosen(rows, task, "R²").groupby("arm", sort=False)["value"]
        errors = np.log(by_arm(rows, task, "error ahead"))
        ratio = np.exp(crossed(errors.loc["p = 0"] - errors.loc["estimated p"]))
        table.append(
            {
                "not told": title,
                **right(chosen(rows, task, "right")),
                "R²": ", ".join(f"{each:.2f}" for each in explained.mean()),
                "error with p = 0": "{:.1f} ({:.1f} to {:.1f})".format(*ratio),
            }
        )
    for arm, cases in chosen(rows, "logs", "right").groupby("arm"):
        title = f"eight loads of a pendulum, forty {arm}"
        line = {"not told": title, **right(cases), "R²": "", "error with p = 0": ""}
        table.append(line)
    return table


def controlling(rows: pd.DataFrame) -> list[dict[str, str]]:
    """Rewards with each p, and what the wrong one loses."""
    table = []
    for task in ROBOTS:
        drawn = by_arm(rows, task, "reward, random commands").loc[""]
        for feedback in FEEDBACK:
            rewards = by_arm(rows, task, f"reward, {feedback}")
            means = rewards.mean(axis=1)
            line = {
                "robot": task,
                "plans anew": feedback,
                "random": f"{drawn.mean():.2f}",
                **{str(arm): f"{mean:.2f}" for arm, mean in means.items()},
            }
            table.append(line | lost(rewards, drawn))
    return table


def lost(rewards: pd.DataFrame, drawn: pd.Series) -> dict[str, str]:
    """What the wrong p loses of what the right one gains on random commands."""
    gain = rewards.loc["right p"] - drawn
    if over_trainings(gain).low <= 0:  # nothing that could be lost
        return {
            "lost with the wrong p": "",
            "of each material": "",
            "verdict": "**no control** with any p",
        }
    less = rewards.loc["estimated p"] - rewards.loc["wrong p"]
    text, share = share_of(less, gain.mean())
    return {
        "lost with the wrong p": text,
        "of each material": of_each(less / gain.mean()),
        "verdict": worth(share.low, share.high),
    }


def hopping(rows: pd.DataFrame) -> list[dict[str, str]]:
    """What is found of the hopper, recorded in each of the ways."""
    table = []
    seen = chosen(rows, "hopper", "moves a step")
    for way, moved in seen.groupby("case", sort=False):
        shares = moved.groupby("arm")["value"].mean()
        row = {"recorded": str(way)}
        for quality in ("mass", "damping"):
            row[f"{quality} moves a step by"] = f"{shares[quality]:.2f}"

        # Guesses of both, each by its own means
        masses = guesses(rows, str(way), "mass")
        dampings = guesses(rows, str(way), "damping")
        row["mass by p"] = count(masses["nearest p"])
        by_p = right(dampings["nearest p"])
        row["damping by p"] = by_p["right one"]
        row["by least error"] = count(dampings["least error"])
        row["by simulation"] = count(dampings["simulation"])
        table.append(row | {"damping": by_p["verdict"]})
    return table


def guesses(rows: pd.DataFrame, way: str, quality: str) -> dict[str, pd.DataFrame]:
    """Rows of a property of the hopper recorded in one way, by how it was guessed."""
    both = chosen(rows, "hopper", quality)
    mine = both[both["case"].str.startswith(f"{way}: ")]
    return {str(arm): each for arm, each in mine.groupby("arm")}


def own_networks(rows: pd.DataFrame) -> list[dict[str, str]]:
    """Networks of one's own beside the paper's, in control of the pendulum."""
    # What the paper's gains over random commands is the yardstick
    rewards = by_arm(rows, "networks", "reward")
    paper = rewards.loc["DPMPB"]
    gain = paper.mean() - rewards.loc["without control"].mean()
    times = by_arm(rows, "speed", "act [ms]")
    trained = by_arm(rows, "networks", "training [s]").mean(axis=1)

    table = []
    for arm in trained.index:
        # How much more each gains, and in which time
        text, share = share_of(rewards.loc[arm] - paper, gain)
        verdict = beside(share.low, share.high)
        network = str(arm).removesuffix(", as long")
        ratio = crossed(times.loc[network] / times.loc["DPMPB"])
        if ratio.high < 1 - MATTERS:
            verdict += ", **faster**"
        own = arm != "DPMPB"
        table.append(
            {
                "network": str(arm),
                "training [s]": f"{trained[arm]:.0f}",
                "a command [ms]": f"{times.loc[network].mean():.1f}",
                "reward": f"{rewards.loc[arm].mean():.2f}",
                "gains over DPMPB": text if own else "",
                "verdict": verdict if own else "",
            }
        )
    return table


PARTS = {  # the tasks of each table, how it is made, and what it shows
    ("pendulum", "cheetah", "logs"): (
        finding,
        "**Is it found?** p from zero, from 200 new steps of random commands. *R²*: of "
        "both properties from p, by a straight map, with one material left out. *Error "
        "with p = 0*: 20 steps ahead, squared, over that with the estimate.",
    ),
    ("pendulum", "cheetah"): (
        controlling,
        "**Is it worth anything in control?** Gymnasium's reward of a step, mean of "
        "100 (more is better), of the lightest, the middle and the heaviest. *Lost*: "
        "what the farthest p costs beside the estimate, over what the right p gains on "
        "random commands.",
    ),
    ("hopper",): (
        hopping,
        "**Where is the hopper's damping?** *Moves a step by*: how far the next state "
        "moves from one factor of mass or damping to the next, over the network's "
        "error in a step. *Least error*: the trained p that predicts best. "
        "*Simulation*: the true equations with nine candidates, and sensors of 1 % "
        "noise. Chance is one in three.",
    ),
    ("networks", "speed"): (
        own_networks,
        "**A network of one's own** swings up the pendulum, with the p that it "
        "estimates (reward: more is better). *Gains*: over the paper's network "
        "(DPMPB), as a share of what that one gains on random commands.",
    ),
}


def tell(rows: pd.DataFrame) -> str:
    """All tables, each under what it shows."""
    parts = []
    for tasks, (make, title) in PARTS.items():
        counts = rows[rows["task"].isin(tasks)].groupby("task")["seed"].nunique()
        trainings = f"Trainings of each: {counts.min()}."
        parts += [f"{title} {trainings}", markdown(make(rows))]
    return "\n\n".join(parts)
