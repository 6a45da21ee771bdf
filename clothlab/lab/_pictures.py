"""Pictures that the widgets show, as files and back."""

import io
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from clothlab import plots
from clothlab._validation import HEIGHT, WIDTH
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.stiffness import static_posture

_FILM_FPS = 20
_ELLIPSE_TEXT = 20  # [point], for a picture 4 inches wide
_ENLARGED = 10  # times, or nobody would see the ellipse


def encoded(picture: np.ndarray | Figure, kind: str = ".png") -> bytes:
    """A figure, picture `[h, w, 3]` uint8 or image `[h, w]` of 0 to 1, as a file.

    Pictures `[N, h, w, 3]` become a PNG that plays them again and again.
    """
    if isinstance(picture, Figure):
        file = io.BytesIO()
        picture.savefig(file, format="png", dpi=80, bbox_inches="tight")
        return file.getvalue()
    if picture.ndim == 4:
        first, *others = (Image.fromarray(each) for each in picture)
        file = io.BytesIO()
        played = {"append_images": others, "duration": 1000 / _FILM_FPS, "loop": 0}
        first.save(file, format="png", save_all=True, compress_level=3, **played)
        return file.getvalue()
    if picture.dtype != np.uint8:
        picture = (255 * picture.astype(float)).astype(np.uint8)
    if picture.ndim == 3:
        picture = picture[..., ::-1]  # OpenCV has blue first
    _, data = cv2.imencode(kind, picture)
    return data.tobytes()


def pixels(mask: np.ndarray) -> bytes:
    """A mask `[H, W]` as the browser takes it: a byte for each pixel, 0 or 1."""
    return np.asarray(mask, np.uint8).tobytes()


def still(frame: Mapping[str, Any], target: Mapping[str, Any]) -> tuple[bytes, str]:
    """A frame and the target as one picture, PNG, with a sentence for it.

    It is made of what was sent to the browser, so that any thread may ask.
    """
    scene = _decoded(frame["scene"], cv2.IMREAD_COLOR)[..., ::-1]
    seen = _decoded(frame["seen"], cv2.IMREAD_GRAYSCALE) > 127
    aim = np.frombuffer(target["image"], bool).reshape(HEIGHT, WIDTH)
    titles = [f"the scene, {frame['clock']}", "what the camera sees", "the target"]
    figure = plots.image_grid([scene, seen, aim], titles, width=4.5)
    figure.set_figheight(figure.get_figheight() + 0.2)
    for ax in figure.axes:
        ax.title.set_fontsize(18)
    return encoded(figure), plots.alt_text(figure)


def _decoded(file: bytes, kind: int) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(file, np.uint8), kind))


def ellipse_at_hand(arm: MuscleArm, theta: np.ndarray, f_const: float) -> Figure:
    """The arm, and ten times how far a push of 1 N from any direction moves its hand.

    The posture θ is `[2]` [rad], the tension of the muscles f_const [N].
    """
    # The arm
    theta = np.clip(theta, arm.lower, arm.upper)
    hand = arm.hand(theta)
    elbow = arm.link_length * np.array([np.cos(theta[0]), -np.sin(theta[0])])

    # Its hand, pushed from all around
    pushed = []
    for angle in np.linspace(0, 2 * np.pi, 25):
        force = np.array([np.cos(angle), np.sin(angle)])
        pushed.append(arm.hand(static_posture(arm, [*theta, f_const], force)))
    ellipse = hand + _ENLARGED * (np.array(pushed) - hand)

    # The figure
    figure, ((ax,),) = plots.new_axes(size=(4.0, 3.6))
    ax.set(aspect="equal", xlim=(-0.35, 1.0), ylim=(-0.75, 0.75))
    ax.set(xticks=(0, 0.5, 1), yticks=(-0.5, 0, 0.5))
    ax.set_xlabel("forward [m]", fontsize=_ELLIPSE_TEXT)
    ax.set_ylabel("up [m]", fontsize=_ELLIPSE_TEXT)
    ax.tick_params(labelsize=_ELLIPSE_TEXT)
    ax.plot(*np.array([[0, 0], elbow, hand]).T, "o-", color="0.6", lw=6, zorder=1)
    ax.plot(*ellipse.T, lw=2, color=plots.COLOURS[0], label=f"{f_const:.0f} N")
    return figure
