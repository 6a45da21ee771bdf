"""`make picture`: the README's moving picture, and its gallery from the run of `make
notebooks`.

The moving picture shows iterative learning control after 28 periods, what the camera
sees, and the target.
"""

import base64
import io
from pathlib import Path

import cv2
import nbformat
import numpy as np
from PIL import Image

from clothlab import data
from clothlab.simulation.env import ClothEnv, Scene
from clothlab.simulation.vision import cloth_mask
from clothlab.trials import rollout

ROOT = Path(__file__).resolve().parents[1]
GALLERY_SIZE = (640, 400)  # [pixel], at most
CLOTH, STEPS, FIRST_STEP, PICTURES_PER_STEP = "damp0.07-mass0.15", 248, 224, 3
HEIGHT, WIDTH = 288, 384  # [pixel]


def labelled(mask: np.ndarray, text: str) -> np.ndarray:
    """A mask as a small grey picture, with a caption in its upper left corner."""
    grey = np.where(mask, 235, 40).astype(np.uint8)
    grey = cv2.cvtColor(
        cv2.resize(grey, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA),
        cv2.COLOR_GRAY2RGB,
    )
    return cv2.putText(
        grey,
        text,
        (8, 20),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.5,
        (140, 140, 140),
        1,
        cv2.LINE_AA,
    )


def gallery() -> None:
    """Write `docs/gallery/NN.png`, of each notebook the figure of its cell tagged
    `gallery`, or its first.
    """
    for path in sorted((ROOT / "build" / "small").glob("*.ipynb")):
        cells = nbformat.read(path, as_version=4).cells
        tagged = [cell for cell in cells if "gallery" in cell.metadata.get("tags", [])]
        outputs = [each for cell in tagged or cells for each in cell.get("outputs", [])]
        first = next(
            each.data["image/png"]
            for each in outputs
            if "image/png" in each.get("data", {})
        )
        picture = Image.open(io.BytesIO(base64.b64decode(first))).convert("RGB")
        picture.thumbnail(GALLERY_SIZE)
        target = ROOT / "docs" / "gallery" / f"{path.stem[:2]}.png"
        target.parent.mkdir(exist_ok=True)
        picture.quantize(64).save(target, optimize=True)
        print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")


def moving_picture() -> None:
    """Run 31 periods and write the last three to `docs/control.gif`."""
    learned, target = data.load(), data.load_target("target-1")
    runs = [learned.to_run(trial) for trial in data.load_trials("train")]
    env = ClothEnv(learned.arm, CLOTH, scene=Scene(picture_size=(HEIGHT, WIDTH)))
    policy, pictures = learned.iterative_controller(target, CLOTH, runs), []
    watch = {
        "watch": lambda: pictures.append(env.picture()),
        "samples": PICTURES_PER_STEP,
    }
    rollout(env, policy, STEPS, progress=True, **watch)
    frames = []
    for picture in pictures[FIRST_STEP * PICTURES_PER_STEP :]:
        small = cv2.resize(picture, (128, 96), interpolation=cv2.INTER_AREA)
        side = np.vstack(
            [labelled(target, "target"), labelled(cloth_mask(small), "seen")]
        )
        frames.append(Image.fromarray(np.hstack([picture, side])).quantize(64))
    path = ROOT / "docs" / "control.gif"
    # GIF counts in hundredths of a second
    milliseconds = round(200 / PICTURES_PER_STEP / 10) * 10
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=milliseconds,
        loop=0,
        optimize=True,
    )
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    gallery()
    moving_picture()
