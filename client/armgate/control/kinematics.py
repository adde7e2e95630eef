"""Fast kinematics of a robot's camera and bounding spheres.

pinocchio is fast, but each call that requests a result takes time. So each sphere becomes a frame of a
copy of the model, one call places all frames, and the arrays that pinocchio writes into are bound once and
remain valid.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.model import RobotModel
from armgate.cell.motion_bounds import motion_bounds
from armgate.control.spheres import Spheres
from armgate.control.vectors import V3, dot, vector
from armgate.control.weights import Vector


class CameraArm:
    """Kinematics of a robot that carries a camera; call `place` first, then read.

    Attributes:
        J: spatial Jacobian, world axes, at the world's origin, (6, n); its transpose times [f; p × f] gives
            joint forces.
        last: index of the last joint that carries the camera.
        carriers: row j is 1.0 for joint j and the joints that carry it, else 0.0, (n, n).
        camera_moved: 1.0 for the joints that carry the camera, else 0.0, (n,).
        spheres_moved: the same for each sphere, (k, n).
        spin: ∂φ/∂q of the last joint, φ being the roll angle of (15).
        mount: placement of the camera in the frame of that joint.
        moves: True for spheres whose centres a joint moves, (k,); a sphere on the axis of the first joint
            does not move.
        sinks: True for spheres whose height can change, (k,).
        lever: no sphere's centre moves further than lever · |Δq|, (n,), m/rad, in the world or relative to
            another sphere.

    Raises:
        ModelError: for a frame that the model does not have, or that no joint moves.
    """

    def __init__(self, model: RobotModel, frame: str, spheres: Spheres) -> None:
        self.last = model.frame_joint(frame)
        if self.last < 0:
            raise ModelError(
                f"the camera frame {frame!r} is fixed to the base; expected one that a joint moves"
            )
        self._model = model.pin_model.copy()
        frames = [self._add_frame(k, joint, spheres.in_joint(k)) for k, joint in enumerate(spheres.joints)]
        self._data = self._model.createData()
        oMf = self._data.oMf
        index = self._model.getFrameId(frame, pin.FrameType.BODY)
        camera, self.mount = oMf[index], self._model.frames[index].placement
        self.J: Vector = self._data.J
        self._R, self._t = camera.rotation.T, camera.translation
        self._centres = [oMf[k].translation for k in frames]
        self.carriers = moved = _carriers(model)
        self.camera_moved = moved[self.last]
        self.spheres_moved = moved[list(spheres.joints)].reshape(-1, model.n)
        self.place(pin.neutral(self._model))
        self.spin = -dot(vector(self.J[3:, self.last]), self.camera_axes()[2])
        self.moves = _moving(model, spheres)
        self.sinks = self._sinking(model, spheres)
        self.lever: Vector = motion_bounds(model)[list(spheres.bodies)].max(axis=0, initial=0.0)

    def _add_frame(self, number: int, joint: int, point: Vector) -> int:
        kind, placement = pin.FrameType.OP_FRAME, pin.SE3(np.eye(3), point)
        index: int = self._model.addFrame(
            pin.Frame(f"bounding sphere {number}", joint + 1, 0, placement, kind)
        )
        return index

    def _sinking(self, model: RobotModel, spheres: Spheres) -> NDArray[np.bool_]:
        """Return True for spheres whose height can change: not those that only turn about the vertical."""
        level = [
            model.joints[j].kind == "revolute" and model.parents[j] < 0 and abs(self.J[5, j]) > 1.0 - 1e-9
            for j in range(model.n)
        ]
        return np.array([not level[joint] for joint in spheres.joints], dtype=np.bool_)

    def place(self, q: Vector) -> None:
        """Update all results for q, (n,), rad or m."""
        pin.computeJointJacobians(self._model, self._data, q)
        pin.updateFramePlacements(self._model, self._data)

    def camera_axes(self) -> tuple[V3, V3, V3]:
        """Return e1, e2, e3 in world axes."""
        e1, e2, e3 = self._R.tolist()
        return (*e1,), (*e2,), (*e3,)

    def camera_point(self) -> V3:
        """Return x, the position of the lens in the world, m."""
        x, y, z = self._t.tolist()
        return x, y, z

    def centres(self) -> Vector:
        """Return the spheres' centres in the world, (k, 3), m."""
        return np.array(self._centres).reshape(-1, 3)


def _moving(model: RobotModel, spheres: Spheres) -> NDArray[np.bool_]:
    """Return `CameraArm.moves`."""
    places = [spheres.centres(q) for q in np.linspace(model.lower, model.upper, 5)]
    moves: NDArray[np.bool_] = np.ptp(places, axis=0).max(axis=1, initial=0.0) > 1e-6
    return moves


def _carriers(model: RobotModel) -> Vector:
    """Return `CameraArm.carriers`."""
    moved = np.eye(model.n)
    for joint, parent in enumerate(model.parents):
        if parent >= 0:
            moved[joint] += moved[parent]
    return moved
