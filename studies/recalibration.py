"""Camera recalibration: the robot finds out where its camera has been moved to.

It looks at pictures of the bar in its own hand. Its joint angles say where the ends of
the bar are, and nothing else in the picture is as dark. From a dozen postures follow
the six numbers of the camera's pose. Masks are then warped to what the camera would
have seen from its old pose, as if the cloth were flat, at the distance of the hand:
exact for a turned camera, not for a shifted one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from clothlab._validation import HEIGHT, WIDTH, check_array, check_masks
from clothlab.simulation._dimensions import BAR_RADIUS, SHOULDER_POSITION
from clothlab.simulation._pinhole import focal_length
from clothlab.simulation.arm import Arm, Camera
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial

# Of 255: the bar is darker in every colour, shaded skin, cloth and floor are not
_DARK = 75
_FEWEST = 4  # pictures from which six numbers follow with some certainty
# [pixel] of a part of the bar, whose middle the hand may cover; what is smaller is the
# shade in a corner
_LEAST_PART = 50
_MARGIN = 0.1  # of the joints' ranges, left out at both ends
_HOLD = 8  # [step] for each posture
# Beyond 2 pixels of the picture in full size an end counts less: cloth may hide it
_DOUBTFUL = 2.0 / HEIGHT / 5


class View(NamedTuple):
    """One picture of the bar."""

    ends: np.ndarray  # of the bar in space [2, 3] [m]
    # Where they are in the picture [2, 2], column and row as parts of its height
    seen: np.ndarray


@dataclass(frozen=True, eq=False)
class Recalibration:
    """The camera's pose, and what the camera would have seen from its old one."""

    arm: Arm  # with its camera in the old pose
    camera: Camera  # in the estimated pose
    # Root mean square reprojection error of the bar's ends, as a part of the picture's
    # height
    residual: float = 0.0

    def homography(self, theta: ArrayLike) -> np.ndarray:
        """From the old camera's pixels (column, row, 1) to the new one's, `[3, 3]`.

        On the plane through the hand that faces the old camera, for joint angles `[2]`
        [rad].
        """
        old = self.arm.camera
        angles = check_array("theta", theta, (2,))
        hand = _bar_ends(self.arm, angles).mean(axis=0)

        # Rays of the old camera through the corners of its image
        corners = np.array(list(product((0.0, WIDTH - 1.0), (0.0, HEIGHT - 1.0))))
        focal = focal_length(old.fovy)
        middle = (WIDTH / HEIGHT / 2, 0.5)
        rays = np.column_stack([(corners + 0.5) / HEIGHT - middle, np.ones(4)])
        rays *= [1 / focal, -1 / focal, -1]

        # Where they meet the plane, and where the new camera sees that
        depth = (np.array(old.position) - hand) @ old.axes[2]
        points = old.position + depth * rays @ old.axes
        there = _project(self.camera, points) * HEIGHT - 0.5
        return cv2.getPerspectiveTransform(
            corners.astype(np.float32), there.astype(np.float32)
        )

    def warp(self, mask: ArrayLike, theta: ArrayLike) -> np.ndarray:
        """What the old camera would have seen where the new one sees a mask `[H, W]`.

        With joint angles `[2]` [rad].
        """
        grey = check_masks(mask).astype(np.uint8) * np.uint8(255)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = (WIDTH, HEIGHT)
        warped = cv2.warpPerspective(grey, self.homography(theta), size, flags=flags)
        return warped > 127

    def trial(self, trial: Trial) -> Trial:
        """The same trial with the images of the old camera."""
        angles = trial.robot[:, self.arm.sensed_angles]
        images = []
        for mask, theta in zip(trial.images, angles, strict=True):
            images.append(self.warp(mask, theta))
        return replace(trial, images=np.array(images))


def _project(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Where points `[N, 3]` [m] are in the picture, `[N, 2]`.

    Column and row as parts of its height.
    """
    axes = camera.axes * [[1], [-1], [-1]]  # for OpenCV: right, down, forward
    focal = focal_length(camera.fovy)
    intrinsic = np.array([[focal, 0, WIDTH / HEIGHT / 2], [0, focal, 0.5], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(axes)
    shift = -axes @ camera.position
    seen, _ = cv2.projectPoints(points, rotation, shift, intrinsic, None)
    return seen.reshape(-1, 2)


def _bar_ends(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """The ends of the bar in the world `[2, 3]` [m], right and left.

    For joint angles `[2]` [rad].
    """
    forward, up = arm.hand(theta)
    reach = arm.bar_length / 2
    return SHOULDER_POSITION + np.array([[forward, -reach, up], [forward, reach, up]])


def _project_tips(camera: Camera, ends: np.ndarray) -> np.ndarray:
    """Where the outlines of bars end in the picture `[N, 2, 2]`, as `_project`.

    The ends of the bars `[N, 2, 3]` [m] are half balls.
    """
    centres = _project(camera, ends.reshape(-1, 3)).reshape(-1, 2, 2)
    along = centres[:, 1] - centres[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    depth = (camera.position - ends) @ camera.axes[2]
    radius = BAR_RADIUS * focal_length(camera.fovy) / depth  # [N, 2]
    return centres + radius[..., None] * np.stack([-along, along], axis=1)


def _find_bar(picture: np.ndarray) -> np.ndarray | None:
    """Both tips of the bar in a colour picture `[h, w, 3]`, `[2, 2]`.

    Column and row as parts of its height. None where the bar is not to be seen, or
    leaves the picture.
    """
    # Dark parts that are large enough
    below = np.asarray((picture < _DARK).all(axis=2), np.uint8)
    _, labels, parts, _ = cv2.connectedComponentsWithStats(below)
    areas = parts[1:, cv2.CC_STAT_AREA]
    dark = np.isin(labels, 1 + np.flatnonzero(areas >= _LEAST_PART))
    if not dark.any() or dark[[0, -1]].any() or dark[:, [0, -1]].any():
        return None

    # The line along which they lie, and how far they reach along it
    points = np.argwhere(dark)[:, ::-1] + 0.5  # column and row
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre, full_matrices=False)[2][0]
    reach = (points - centre) @ along
    ends = [reach.min() - 0.5, reach.max() + 0.5]  # the outer side of outermost pixels
    return (centre + np.outer(ends, along)) / len(picture)


def take_views(env: ClothEnv, shoulder: int = 4, elbow: int = 3) -> list[View]:
    """Pictures of the bar from postures on a grid of so many joint angles.

    Those in which it is not found are left out.
    """
    arm = env.arm
    if arm.sensed_angles == slice(0, 0):
        raise ValueError(
            f"the {arm.name} arm does not sense its joint angles, and so cannot say "
            "where its hand is"
        )

    # Postures within the joints' ranges
    span = np.subtract(arm.upper, arm.lower) * _MARGIN
    lowest = arm.lower + span
    highest = arm.upper - span
    shoulders = np.linspace(lowest[0], highest[0], shoulder)
    elbows = np.linspace(lowest[1], highest[1], elbow)

    # Go there and look
    views = []
    u = arm.home_command
    env.start()
    for posture in product(shoulders, elbows):
        u[arm.angle_command] = posture
        for _ in range(_HOLD):
            env.advance(u)
        seen = _find_bar(env.picture())
        if seen is not None:
            theta = arm.state(env.data)[arm.sensed_angles]
            views.append(View(_bar_ends(arm, theta), seen))
    return views


def recalibrate(arm: Arm, views: Sequence[View]) -> Recalibration:
    """Estimate the camera's pose from views of the bar.

    By robust least squares of the reprojection errors. The arm has its camera in the
    old pose.
    """
    if len(views) < _FEWEST:
        raise ValueError(
            f"the bar is in {len(views)} pictures; {_FEWEST} are needed: is the camera "
            "turned away?"
        )
    ends = np.array([view.ends for view in views])
    seen = np.array([_in_order(arm.camera, view) for view in views])

    def moved(move: np.ndarray) -> Camera:
        """The camera, shifted by three numbers [m] and turned by three [rad]."""
        return arm.camera.moved(move[:3], np.rad2deg(move[3:]))

    def errors(move: np.ndarray) -> np.ndarray:
        return (_project_tips(moved(move), ends) - seen).ravel()

    # Not cv2.solvePnP with solvePnPRefineLM: of 22 poses it misses the median one by 57
    # mm, since the outline of a bar's end is not the picture of its centre (this misses
    # it by 3 mm). With centres computed from outlines it is as good, but for one pose
    # where cloth hides an end, which it misses by 92 mm (4 mm).
    found = least_squares(errors, np.zeros(6), loss="soft_l1", f_scale=_DOUBTFUL)
    residual = float(np.sqrt(np.mean(found.fun**2) * 2))
    return Recalibration(arm, moved(found.x), residual)


def _in_order(camera: Camera, view: View) -> np.ndarray:
    """The tips in the order in which they are in space, `[2, 2]`.

    No camera is turned by a quarter.
    """
    wanted = np.subtract(*_project(camera, view.ends))
    got = np.subtract(*view.seen)
    return view.seen if wanted @ got > 0 else view.seen[::-1]
