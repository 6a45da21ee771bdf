"""`make picture`: the README's moving picture and its gallery.

The gallery is from the run of `make findings`. The moving picture shows iterative
learning control after 28 periods, what the camera sees, and the target.
"""

import base64
import io
from pathlib import Path

import cv2
import nbformat
import numpy as np
from PIL import Image
from repository import number_of

from clothlab import data
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from clothlab.simulation.vision import cloth_mask, iou
from clothlab.trials import rollout

ROOT = Path(__file__).resolve().parents[1]
GALLERY_SIZE = (640, 400)  # [pixel], at most
CLOTH = "damp0.03-mass0.05"
STEPS = 248
FIRST_STEP = 224  # that is shown
PICTURES_PER_STEP = 3
HALT = 1200  # [ms] at the best image of a period
# [pixel] of the moving picture's larger part
HEIGHT = 288
WIDTH = 384
SMALL = (WIDTH // 2, HEIGHT // 2)  # [pixel] of what stands beside it
FONT = cv2.FONT_HERSHEY_SIMPLEX
GREY = (140, 140, 140)


def labelled(mask: np.ndarray, text: str) -> np.ndarray:
    """A mask as a small grey picture, with a caption in its upper left corner."""
    grey = np.where(mask, 235, 40).astype(np.uint8)
    grey = cv2.resize(grey, SMALL, interpolation=cv2.INTER_AREA)
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB)
    return cv2.putText(picture, text, (8, 20), FONT, 0.5, GREY, 1, cv2.LINE_AA)


def best_of_periods(overlap: np.ndarray) -> np.ndarray:
    """The frame of each period with the largest overlap with the target.

    That is what the controller aims at, which learns from each throw. Of each control
    step, the camera sees the last frame.
    """
    last = np.arange(PICTURES_PER_STEP - 1, len(overlap), PICTURES_PER_STEP)
    periods = last.reshape(-1, 8)
    best = overlap[periods].argmax(axis=1)
    return periods[np.arange(len(periods)), best]


def gallery() -> None:
    """Write `docs/gallery/NN.png`: a figure of each notebook but the appendices.

    That is the one of its cell tagged `gallery`, or its first.
    """
    for path in sorted((ROOT / "build" / "full" / "notebooks").glob("[0-9]*.ipynb")):
        cells = nbformat.read(path, as_version=4).cells
        tagged = [cell for cell in cells if "gallery" in cell.metadata.get("tags", [])]
        outputs = [each for cell in tagged or cells for each in cell.get("outputs", [])]
        shown = [each.get("data", {}) for each in outputs]
        first = next(data["image/png"] for data in shown if "image/png" in data)
        picture = Image.open(io.BytesIO(base64.b64decode(first))).convert("RGB")
        picture.thumbnail(GALLERY_SIZE)

        # Few colours: these pictures lie in the repository
        target = ROOT / "docs" / "gallery" / f"{number_of(path)}.png"
        target.parent.mkdir(exist_ok=True)
        picture.quantize(64, kmeans=3).save(target, optimize=True)
        print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")


def moving_picture() -> None:
    """Run 31 periods and write the last three to `docs/control.gif`."""
    # A controller that has learned for 28 periods
    learned = data.load()
    target = data.load_target("target-1")
    runs = [learned.to_run(trial) for trial in data.load_trials("train")]
    policy = learned.iterative_controller(target, CLOTH, runs)
    env = ClothEnv(learned.arm, CLOTH, scene=Scene(picture_size=(HEIGHT, WIDTH)))
    pictures: list[np.ndarray] = []
    rollout(
        env,
        policy,
        STEPS,
        watch=lambda: pictures.append(env.picture()),
        samples=PICTURES_PER_STEP,
        progress=True,
    )

    # The scene, and beside it the target and what the camera sees of the cloth
    frames, overlap = [], []
    for picture in pictures[FIRST_STEP * PICTURES_PER_STEP :]:
        small = cv2.resize(picture, (128, 96), interpolation=cv2.INTER_AREA)
        mask = cloth_mask(small)
        overlap.append(iou(mask, target))
        side = np.vstack([labelled(target, "target"), labelled(mask, "seen")])
        frames.append(Image.fromarray(np.hstack([picture, side])).quantize(64))

    # GIF counts in hundredths of a second
    milliseconds = round(200 / PICTURES_PER_STEP / 10) * 10
    durations = [milliseconds] * len(frames)
    halts = best_of_periods(np.array(overlap))
    for k in halts:
        durations[k] = HALT

    # It goes round, and begins at a halt, for those who see it stand still
    first = max(halts, key=lambda k: overlap[k])
    frames = frames[first:] + frames[:first]
    path = ROOT / "docs" / "control.gif"
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=durations[first:] + durations[:first],
        loop=0,
        optimize=True,
    )
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    gallery()
    moving_picture()
