"""Where did the camera go? The robot finds out from pictures of its own hand, and sees as before.

The ends of the bar in the hand are two points that the robot knows in space, from its joint angles, and finds in the
picture, since nothing else is as dark. From a dozen postures follow the six numbers by which the camera has moved.
Masks are then warped to what the camera would have seen from its old place, as if the cloth were flat, at the distance
of the hand: a turned camera is undone exactly, a shifted one but for what is nearer or farther than the hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from clothlab._validation import Checked, check_array, setting
from clothlab.policies import Policy, Wrapper
from clothlab.simulation.arm import BAR_RADIUS, SHOULDER_POSITION, Arm, Camera
from clothlab.simulation.env import ClothEnv, Observation
from clothlab.simulation.vision import HEIGHT, WIDTH, check_masks
from clothlab.trials import Trial

DARK = 75  # of 255: the bar is darker in every colour, shaded skin, cloth and floor are not
FEWEST = 4  # pictures from which six numbers follow with some certainty
LEAST_BAR = 20  # [pixel] of it in a picture
LEAST_PART = 50  # [pixel] of it: the hand may cover its middle, and what is smaller is the shade in a corner


@dataclass(frozen=True)
class RegistrationSettings(Checked):
    """How the arm shows itself to its camera."""

    shoulder: int = setting(4, at_least=2)  # so many angles of each joint, evenly over the middle of its range
    elbow: int = setting(3, at_least=2)
    margin: float = setting(0.1, at_least=0, at_most=0.4)  # of the range, left out at both ends
    hold: int = setting(8, "step", at_least=1)  # for each posture
    doubtful: float = setting(2.0, "pixel", above=0)  # beyond it, an end of the bar counts less: cloth may hide it


@dataclass(frozen=True, eq=False)
class View:
    """One picture of the bar.

    Attributes:
        ends: of the bar in space `[2, 3]` [m].
        seen: where they are in the picture `[2, 2]`, column and row as parts of its height.
    """

    ends: np.ndarray
    seen: np.ndarray


@dataclass(frozen=True, eq=False)
class Registration:
    """Where the camera is, and what it would have seen from where it was.

    Attributes:
        arm: with its camera where it was when all was learned.
        camera: where the camera is.
        residual: how far the ends of the bar are from where they should be in the picture, root mean square, as a part
            of the picture's height.
    """

    arm: Arm
    camera: Camera
    residual: float = 0.0

    def homography(self, theta: ArrayLike) -> np.ndarray:
        """From the old camera's pixels (column, row, 1) to the new one's, on the plane through the hand, `[3, 3]`.

        Args:
            theta: joint angles `[2]` [rad].
        """
        old, hand = self.arm.camera, hand_position(self.arm, check_array("theta", theta, (2,)))
        corners = np.array(list(product((0.0, WIDTH - 1.0), (0.0, HEIGHT - 1.0))))
        depth = (np.array(old.position) - hand) @ old.axes[2]
        rays = np.column_stack([(corners + 0.5) / HEIGHT - (WIDTH / HEIGHT / 2, 0.5), np.ones(4)])
        rays *= [1 / _focal_length(old), -1 / _focal_length(old), -1]
        points = old.position + depth * rays @ old.axes
        there = project(self.camera, points) * HEIGHT - 0.5
        return cv2.getPerspectiveTransform(corners.astype(np.float32), there.astype(np.float32))

    def mask(self, mask: ArrayLike, theta: ArrayLike) -> np.ndarray:
        """What the old camera would have seen where the new one sees a mask `[H, W]`, bool.

        Args:
            mask: from the new camera.
            theta: joint angles `[2]` [rad].

        Raises:
            ValueError: no mask, or no two angles.
        """
        grey = check_masks(mask).astype(np.uint8) * np.uint8(255)
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpPerspective(grey, self.homography(theta), (WIDTH, HEIGHT), flags=how) > 127

    def observation(self, observation: Observation) -> Observation:
        """The same observation with the image of the old camera."""
        theta = observation["robot"][self.arm.sensed_angles]
        return observation | {"image": self.mask(observation["image"], theta).astype(np.int8)}

    def trial(self, trial: Trial) -> Trial:
        """The same trial with the images of the old camera."""
        angles = trial.robot[:, self.arm.sensed_angles]
        return replace(trial, images=np.array([self.mask(*each) for each in zip(trial.images, angles, strict=True)]))


class Registered(Wrapper):
    """A policy that sees what the camera would have seen from where it was.

    Args:
        policy: chooses the commands.
        registration: says where the camera is.
    """

    def __init__(self, policy: Policy, registration: Registration):
        self.registration = registration
        super().__init__(policy)

    def __call__(self, observation: Observation) -> np.ndarray:
        return self.policy(self.registration.observation(observation))


def _focal_length(camera: Camera) -> float:
    """As a part of the picture's height."""
    return float(0.5 / np.tan(np.deg2rad(camera.fovy) / 2))


def project(camera: Camera, points: ArrayLike) -> np.ndarray:
    """Where points `[N, 3]` [m] are in the picture: column and row `[N, 2]` as parts of its height."""
    places = check_array("points", points, ("N", 3)) - camera.position
    right, up, backward = camera.axes @ places.T
    scale = _focal_length(camera) / -backward
    return np.column_stack([WIDTH / HEIGHT / 2 + right * scale, 0.5 - up * scale])


def hand_position(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """Where the hand is in the world `[3]` [m], for joint angles `[2]` [rad]."""
    forward, up = arm.hand(theta)
    return SHOULDER_POSITION + np.array([forward, 0.0, up])


def bar_ends(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """The ends of the bar in the world `[2, 3]` [m]: to the robot's right, to its left."""
    reach = arm.bar_length / 2
    return hand_position(arm, theta) + np.array([[0.0, -reach, 0.0], [0.0, reach, 0.0]])


def project_tips(camera: Camera, ends: np.ndarray) -> np.ndarray:
    """Where the outlines of bars end in the picture: column and row `[N, 2, 2]` as parts of its height.

    A bar ends in half a ball, whose outline is a circle from wherever it is seen.

    Args:
        camera: sees the bars.
        ends: of the bars `[N, 2, 3]` [m].
    """
    centres = project(camera, ends.reshape(-1, 3)).reshape(-1, 2, 2)
    along = centres[:, 1] - centres[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    radius = BAR_RADIUS * _focal_length(camera) / ((camera.position - ends) @ camera.axes[2])  # [N, 2]
    return centres + radius[..., None] * np.stack([-along, along], axis=1)


def find_bar(picture: np.ndarray) -> np.ndarray | None:
    """Both tips of the bar in a colour picture `[h, w, 3]`, `[2, 2]`: column and row as parts of its height.

    None where the bar is not to be seen, or leaves the picture.
    """
    below = np.asarray((picture < DARK).all(axis=2), np.uint8)
    _, labels, parts, _ = cv2.connectedComponentsWithStats(below)
    dark = np.isin(labels, 1 + np.flatnonzero(parts[1:, cv2.CC_STAT_AREA] >= LEAST_PART))
    rows, columns = np.nonzero(dark)
    if len(rows) < LEAST_BAR or dark[[0, -1]].any() or dark[:, [0, -1]].any():
        return None
    points = np.column_stack([columns, rows]) + 0.5
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre, full_matrices=False)[2][0]
    reach = (points - centre) @ along
    # To the outer side of the outermost pixels.
    return (centre + np.outer([reach.min() - 0.5, reach.max() + 0.5], along)) / len(picture)


def look(env: ClothEnv, settings: RegistrationSettings | None = None) -> list[View]:
    """Let the arm take some postures, and find its bar in the pictures; those in which it is not found are left out.

    Raises:
        ValueError: an arm that does not sense its joint angles.
    """
    settings, arm = settings or RegistrationSettings(), env.arm
    if arm.sensed_angles == slice(0, 0):
        raise ValueError(f"the {arm.name} arm does not sense its joint angles, and so cannot say where its hand is")
    span = np.subtract(arm.upper, arm.lower) * settings.margin
    angles = (
        np.linspace(low, high, count)
        for low, high, count in zip(
            arm.lower + span, arm.upper - span, (settings.shoulder, settings.elbow), strict=True
        )
    )
    views, u = [], arm.home_command
    env.start()
    for posture in product(*angles):
        u[arm.angle_command] = posture
        for _ in range(settings.hold):
            env.advance(u)
        seen = find_bar(env.picture())
        if seen is not None:
            views.append(View(bar_ends(arm, arm.state(env.data)[arm.sensed_angles]), seen))
    return views


def register(arm: Arm, views: Sequence[View], settings: RegistrationSettings | None = None) -> Registration:
    """Find by how much the camera has moved, by least squares.

    Args:
        arm: with its camera where it was.
        views: pictures of the bar from where it is.
        settings: which ends of the bar are doubtful.

    Raises:
        ValueError: too few views.
    """
    if len(views) < FEWEST:
        raise ValueError(f"the bar is in {len(views)} pictures; {FEWEST} are needed: is the camera turned away?")
    ends = np.array([view.ends for view in views])
    seen = np.array([_in_order(arm.camera, view) for view in views])
    doubtful = (settings or RegistrationSettings()).doubtful / HEIGHT / 5  # of a picture five times as high

    def missed(move: np.ndarray) -> np.ndarray:
        return (project_tips(arm.camera.moved(move[:3], np.rad2deg(move[3:])), ends) - seen).ravel()

    found = least_squares(missed, np.zeros(6), loss="soft_l1", f_scale=doubtful)
    camera = arm.camera.moved(found.x[:3], np.rad2deg(found.x[3:]))
    return Registration(arm, camera, float(np.sqrt(np.mean(found.fun**2) * 2)))


def _in_order(camera: Camera, view: View) -> np.ndarray:
    """The tips in the order in which they are in space: no camera is turned by a quarter."""
    wanted, got = (np.subtract(*tips) for tips in (project(camera, view.ends), view.seen))
    return view.seen if wanted @ got > 0 else view.seen[::-1]
