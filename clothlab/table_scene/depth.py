"""What a camera sees in depth: a cloud of coloured points in the world (paper, "Integrated Table Setting Experiment").

Intrinsics and extrinsics are the model's own: a robot that knows where its camera is. Notebook 12 shows what a camera
costs that has moved.
"""

from dataclasses import dataclass

import numpy as np

from clothlab._validation import check_number
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import depth_points

SIZE = (480, 640)  # [pixel] height and width of a depth image: at 1 m a pixel is 3 mm wide
FARTHEST = 3.0  # [m] what is farther away is of no use to the arm


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Coloured points in the world, as one camera saw them.

    Attributes:
        points: `[N, 3]` [m].
        colours: red, green, blue `[N, 3]`, uint8.
        inside: which of them are not at the picture's border, where things are cut off `[N]`, bool.
        camera: where the camera is `[3]` [m].
    """

    points: np.ndarray
    colours: np.ndarray
    inside: np.ndarray
    camera: np.ndarray

    def __len__(self) -> int:
        """Return the number of points N."""
        return len(self.points)

    def __getitem__(self, which: np.ndarray | slice) -> "PointCloud":
        """Return some of the points, chosen by a mask, by their numbers, or a slice of them."""
        return PointCloud(self.points[which], self.colours[which], self.inside[which], self.camera)


def depth_picture(env: ClothEnv, height: int = SIZE[0], width: int = SIZE[1]) -> np.ndarray:
    """How far each pixel's surface is from the camera, along its line of sight's axis `[height, width]` [m].

    Raises:
        RuntimeError: no OpenGL on this machine; the message says what to install.
        ValueError: a picture larger than `scene.picture_size`.
    """
    return env.camera_picture(height, width, depth=True).astype(np.float64)


def look(
    env: ClothEnv,
    height: int = SIZE[0],
    width: int = SIZE[1],
    *,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> PointCloud:
    """Take a coloured point cloud with the scene's camera, of all that is nearer than `FARTHEST`.

    Args:
        env: the scene.
        height: of the picture [pixel].
        width: of the picture [pixel].
        noise: standard deviation of each pixel's depth at 1 m [m]; it grows with the square of the distance, as that
            of stereo cameras does.
        rng: draws the noise.

    Raises:
        RuntimeError: no OpenGL on this machine; the message says what to install.
        ValueError: a picture larger than `scene.picture_size`, noise below zero or without an rng.
    """
    depth, colours = depth_picture(env, height, width), env.camera_picture(height, width)
    if check_number("noise", noise, at_least=0):
        if rng is None:
            raise ValueError("a noisy depth image needs an rng: numpy.random.default_rng(seed)")
        depth += rng.normal(0.0, noise, depth.shape) * depth**2
    camera, fovy = env.data.camera("camera"), float(env.model.camera("camera").fovy[0])
    points = depth_points(depth, fovy, camera.xpos, camera.xmat.reshape(3, 3).T)
    inside = np.zeros(depth.shape, bool)
    inside[2:-2, 2:-2] = True
    near = depth < FARTHEST
    return PointCloud(points[near], colours[near], inside[near], camera.xpos.copy())
