"""Camera recalibration: the robot finds where its camera has been moved to from
pictures of the bar in its own hand.

Its joint angles say where the ends of the bar are, and nothing else in the picture is
as dark. From a dozen postures follow the six numbers of the camera's pose. Masks are
then warped to what the camera would have seen from its old pose, as if the cloth were
flat, at the distance of the hand: exact for a turned camera, not for a shifted one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from clothlab._validation import check_array
from clothlab.masks import HEIGHT, WIDTH, check_masks
from clothlab.simulation.arm import BAR_RADIUS, SHOULDER_POSITION, Arm, Camera
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import focal_length
from clothlab.trials import Trial

# Of 255: the bar is darker in every colour, shaded skin, cloth and floor are not
_DARK = 75
_FEWEST = 4  # pictures from which six numbers follow with some certainty
# [pixel] of it: the hand may cover its middle, and what is smaller is the shade in a
# corner
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
        """From the old camera's pixels (column, row, 1) to the new one's, on the plane
        through the hand, `[3, 3]`.
        """
        old, hand = (
            self.arm.camera,
            _bar_ends(self.arm, check_array("theta", theta, (2,))).mean(axis=0),
        )
        corners = np.array(list(product((0.0, WIDTH - 1.0), (0.0, HEIGHT - 1.0))))
        depth, focal = (
            (np.array(old.position) - hand) @ old.axes[2],
            focal_length(old.fovy),
        )
        rays = np.column_stack(
            [(corners + 0.5) / HEIGHT - (WIDTH / HEIGHT / 2, 0.5), np.ones(4)]
        )
        rays *= [1 / focal, -1 / focal, -1]
        points = old.position + depth * rays @ old.axes
        there = _project(self.camera, points) * HEIGHT - 0.5
        return cv2.getPerspectiveTransform(
            corners.astype(np.float32), there.astype(np.float32)
        )

    def warp(self, mask: ArrayLike, theta: ArrayLike) -> np.ndarray:
        """What the old camera would have seen where the new one sees a mask `[H, W]`,
        with joint angles `[2]` [rad].
        """
        grey = check_masks(mask).astype(np.uint8) * np.uint8(255)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return (
            cv2.warpPerspective(
                grey, self.homography(theta), (WIDTH, HEIGHT), flags=flags
            )
            > 127
        )

    def trial(self, trial: Trial) -> Trial:
        """The same trial with the images of the old camera."""
        angles = trial.robot[:, self.arm.sensed_angles]
        return replace(
            trial,
            images=np.array(
                [self.warp(*each) for each in zip(trial.images, angles, strict=True)]
            ),
        )


def _project(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Where points `[N, 3]` [m] are in the picture: column and row `[N, 2]` as parts of
    its height.
    """
    axes = camera.axes * [[1], [-1], [-1]]  # for OpenCV: right, down, forward
    focal = focal_length(camera.fovy)
    intrinsic = np.array([[focal, 0, WIDTH / HEIGHT / 2], [0, focal, 0.5], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(axes)
    return cv2.projectPoints(
        points, rotation, -axes @ camera.position, intrinsic, None
    )[0].reshape(-1, 2)


def _bar_ends(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """The ends of the bar in the world `[2, 3]` [m], right and left, for joint angles
    `[2]` [rad].
    """
    (forward, up), reach = arm.hand(theta), arm.bar_length / 2
    return SHOULDER_POSITION + np.array([[forward, -reach, up], [forward, reach, up]])


def _project_tips(camera: Camera, ends: np.ndarray) -> np.ndarray:
    """Where the outlines of bars end `[N, 2, 2]`, whose ends `[N, 2, 3]` [m] are half
    balls, as `_project`.
    """
    centres = _project(camera, ends.reshape(-1, 3)).reshape(-1, 2, 2)
    along = centres[:, 1] - centres[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # [N, 2]
    radius = (
        BAR_RADIUS
        * focal_length(camera.fovy)
        / ((camera.position - ends) @ camera.axes[2])
    )
    return centres + radius[..., None] * np.stack([-along, along], axis=1)


def _find_bar(picture: np.ndarray) -> np.ndarray | None:
    """Both tips of the bar in a colour picture `[h, w, 3]`, `[2, 2]`: column and row as
    parts of its height.

    None where the bar is not to be seen, or leaves the picture.
    """
    below = np.asarray((picture < _DARK).all(axis=2), np.uint8)
    _, labels, parts, _ = cv2.connectedComponentsWithStats(below)
    dark = np.isin(
        labels, 1 + np.flatnonzero(parts[1:, cv2.CC_STAT_AREA] >= _LEAST_PART)
    )
    if not dark.any() or dark[[0, -1]].any() or dark[:, [0, -1]].any():
        return None
    points = np.argwhere(dark)[:, ::-1] + 0.5  # column and row
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre, full_matrices=False)[2][0]
    reach = (points - centre) @ along
    # To the outer side of the outermost pixels.
    return (centre + np.outer([reach.min() - 0.5, reach.max() + 0.5], along)) / len(
        picture
    )


def take_views(env: ClothEnv, shoulder: int = 4, elbow: int = 3) -> list[View]:
    """Pictures of the bar from postures on a grid of so many joint angles, where it is
    found in them.
    """
    arm = env.arm
    if arm.sensed_angles == slice(0, 0):
        raise ValueError(
            f"the {arm.name} arm does not sense its joint angles, and so cannot say where its hand is"
        )
    span = np.subtract(arm.upper, arm.lower) * _MARGIN
    ranges = zip(arm.lower + span, arm.upper - span, (shoulder, elbow), strict=True)
    views, u = [], arm.home_command
    env.start()
    for posture in product(
        *(np.linspace(low, high, count) for low, high, count in ranges)
    ):
        u[arm.angle_command] = posture
        for _ in range(_HOLD):
            env.advance(u)
        seen = _find_bar(env.picture())
        if seen is not None:
            views.append(
                View(_bar_ends(arm, arm.state(env.data)[arm.sensed_angles]), seen)
            )
    return views


def recalibrate(arm: Arm, views: Sequence[View]) -> Recalibration:
    """Estimate the camera's pose from views of the bar, by robust least squares of the
    reprojection errors.

    The arm has its camera in the old pose.
    """
    if len(views) < _FEWEST:
        raise ValueError(
            f"the bar is in {len(views)} pictures; {_FEWEST} are needed: is the camera turned away?"
        )
    ends = np.array([view.ends for view in views])
    seen = np.array([_in_order(arm.camera, view) for view in views])

    def errors(move: np.ndarray) -> np.ndarray:
        return (
            _project_tips(arm.camera.moved(move[:3], np.rad2deg(move[3:])), ends) - seen
        ).ravel()

    # Not cv2.solvePnP with solvePnPRefineLM: of 22 poses it misses the median one by 57
    # mm, since the outline of a bar's end is not the picture of its centre (this misses
    # it by 3 mm). With centres computed from outlines it is as good, but for one pose
    # where cloth hides an end, which it misses by 92 mm (4 mm).
    found = least_squares(errors, np.zeros(6), loss="soft_l1", f_scale=_DOUBTFUL)
    camera = arm.camera.moved(found.x[:3], np.rad2deg(found.x[3:]))
    return Recalibration(arm, camera, float(np.sqrt(np.mean(found.fun**2) * 2)))


def _in_order(camera: Camera, view: View) -> np.ndarray:
    """The tips in the order in which they are in space: no camera is turned by a
    quarter.
    """
    wanted, got = (
        np.subtract(*tips) for tips in (_project(camera, view.ends), view.seen)
    )
    return view.seen if wanted @ got > 0 else view.seen[::-1]
